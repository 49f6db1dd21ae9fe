//! Recordings as they are read: frame by frame, in Gantry's format and in CARLA's.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use crate::recorder::carla_file::{self, CarlaFile};
use crate::recorder::frame::{Born, Frame, Head, Origin};
use crate::recorder::own_file::OwnFile;
use crate::recorder::read_error::{OpenError, ReadError, name};

/// Longest recording that can be read, in frames: a day at 100 Hz.
pub const MAX_FRAMES: u64 = 8_640_000;
/// Largest recording that can be read, bytes.
pub const MAX_BYTES: u64 = 8 << 30;
/// Most actors in a recording.
const MAX_ACTORS: usize = 65_536;
/// Most bytes of what is remembered of all of them.
const MAX_ACTOR_BYTES: usize = 64 << 20;

/// Reads a recording frame by frame.
#[derive(Debug)]
pub struct Reader<R> {
    head: Head,
    source: R,
    format: Format,
    n_frames: u64,
    last_secs: f64,
    is_cut: bool,
}

#[derive(Debug)]
enum Format {
    Own(OwnFile),
    Carla(CarlaFile),
}

impl Reader<BufReader<File>> {
    /// Opens a file.
    ///
    /// # Errors
    /// If there is no such file or it does not begin as a recording.
    pub fn open(path: &Path) -> Result<Self, OpenError> {
        let name = name(path);
        let (file, n_bytes) = match launch_cli::files::open_plain(path) {
            Ok(opened) => opened,
            Err(cause) => return Err(OpenError::NotFound { name, cause }),
        };
        if n_bytes > MAX_BYTES {
            let max = MAX_BYTES;
            return Err(OpenError::TooLarge { name, n_bytes, max });
        }
        Reader::new(BufReader::new(file)).map_err(|cause| OpenError::Contents { name, cause })
    }
}

impl<R: BufRead> Reader<R> {
    /// Reads the head.
    ///
    /// # Errors
    /// If it is not that of a recording of a known version.
    pub fn new(mut source: R) -> Result<Self, ReadError> {
        let begin = source.fill_buf()?;
        let is_carlas = begin
            .get(size_of::<u16>()..)
            .is_some_and(|rest| rest.starts_with(carla_file::BEGIN));
        let (format, head) = if is_carlas {
            let (file, head) = CarlaFile::begin(&mut source)?;
            (Format::Carla(file), head)
        } else {
            let (file, head) = OwnFile::begin(&mut source)?;
            (Format::Own(file), head)
        };
        Ok(Reader {
            head,
            source,
            format,
            n_frames: 0,
            last_secs: f64::NEG_INFINITY,
            is_cut: false,
        })
    }

    /// The head.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Whether the file ended within a frame, which is left out then.
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// The next frame; `None` at the end. If the writer was killed, the recording ends with its
    /// last whole frame.
    ///
    /// # Errors
    /// If the file is damaged or has no frame at all.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, ReadError> {
        let (frame, is_cut) = match &mut self.format {
            Format::Own(file) => file.next(&mut self.source)?,
            Format::Carla(file) => file.next(&mut self.source)?,
        };
        self.is_cut |= is_cut;
        let Some(mut frame) = frame else {
            return if self.n_frames == 0 {
                Err(ReadError::Empty)
            } else {
                Ok(None)
            };
        };
        self.n_frames += 1;
        if self.n_frames > MAX_FRAMES {
            return Err(ReadError::TooLong { max: MAX_FRAMES });
        }
        // CARLA's time stands still in a tick without length.
        let in_order = match self.head.origin {
            Origin::Gantry => frame.elapsed_secs > self.last_secs,
            Origin::Carla => frame.elapsed_secs >= self.last_secs.max(0.0),
        };
        if !(in_order && frame.elapsed_secs.is_finite()) {
            return Err(ReadError::Disorder);
        }
        self.last_secs = frame.elapsed_secs;
        if self.head.origin == Origin::Gantry {
            frame.number = self.n_frames;
        }
        Ok(Some(frame))
    }
}

/// The actors that appear in a recording, by id.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cast {
    actors: BTreeMap<u32, Born>,
    n_bytes: usize,
}

impl Cast {
    /// Notes the actors that appear in a frame.
    ///
    /// # Errors
    /// If there are too many.
    pub fn note(&mut self, frame: &Frame) -> Result<(), ReadError> {
        for born in &frame.born {
            let attributes = &born.description.attributes;
            self.n_bytes += size_of::<Born>()
                + attributes
                    .iter()
                    .map(|a| size_of_val(a) + a.name.len() + a.value.len())
                    .sum::<usize>()
                + born.description.type_id.len();
            self.actors.insert(born.id, born.clone());
            if self.actors.len() > MAX_ACTORS || self.n_bytes > MAX_ACTOR_BYTES {
                return Err(ReadError::ManyActors { max: MAX_ACTORS });
            }
        }
        Ok(())
    }

    /// An actor.
    pub fn get(&self, id: u32) -> Option<&Born> {
        self.actors.get(&id)
    }

    /// All actors in the order of their ids.
    pub fn iter(&self) -> impl Iterator<Item = &Born> {
        self.actors.values()
    }

    /// The type of an actor; empty if unknown.
    pub fn type_of(&self, id: u32) -> &str {
        self.get(id)
            .map_or("", |born| born.description.type_id.as_str())
    }

    /// Whether an actor is the hero.
    pub fn is_hero(&self, id: u32) -> bool {
        self.get(id)
            .is_some_and(|born| born.description.attribute("role_name") == Some("hero"))
    }
}

/// A recording that was read once, so that its length and its actors are known and it is known to
/// be whole; its frames are read again while it is played.
#[derive(Debug)]
pub struct Recording {
    /// Reads it again, from the first frame on.
    pub reader: Reader<BufReader<File>>,
    /// Its actors.
    pub cast: Cast,
    /// Time of its last frame, seconds.
    pub duration_secs: f64,
    /// Whether its file ends within a frame, which is left out.
    pub is_cut: bool,
}

impl Recording {
    /// Reads a file once.
    ///
    /// # Errors
    /// If there is no such file, it is not a recording, or it is damaged.
    pub fn open(path: &Path) -> Result<Recording, OpenError> {
        let wrong = |cause| OpenError::of(path, cause);
        let mut reader = Reader::open(path)?;
        let mut cast = Cast::default();
        while let Some(frame) = reader.next_frame().map_err(wrong)? {
            cast.note(&frame).map_err(wrong)?;
        }
        Ok(Recording {
            cast,
            duration_secs: reader.last_secs,
            is_cut: reader.is_cut,
            reader: Reader::open(path)?,
        })
    }
}
