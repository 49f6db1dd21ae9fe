//! A recording: its contents and its bytes.
//!
//! The file is a sequence of msgpack lists: the head, then one list per frame. A frame here is what
//! CARLA's recorder calls so: one recorded tick. Axes and units are CARLA's.
//! `docs/carla-recorder.md` has the table.

use std::collections::BTreeMap;
use std::io::{BufReader, Read};
use std::path::Path;

use crate::list;
use crate::recorder::changes::Changes;
use crate::recorder::extra::Extra;
use crate::wire::axes::Transform;
use crate::wire::description::Description;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::{self, DecodeError, Limits, Value};

/// First field of the head.
pub const MAGIC: &str = "GANTRY-CARLA-RECORDING";
/// Version of the format; CARLA's texts call it "Version".
pub const VERSION: u32 = 4;
/// Oldest version that can be read; it lacks the fields of [`Extra`] and [`Changes`].
const OLDEST: u32 = 2;
/// First version with the fields of [`Changes`].
const WITH_CHANGES: u32 = 4;
/// Longest recording that can be read, in frames: a day at 100 Hz.
const MAX_FRAMES: usize = 8_640_000;
/// Largest file that can be read, bytes.
const MAX_BYTES: u64 = 8 << 30;

/// The head of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// Version of the format.
    pub version: u32,
    /// Name of the map.
    pub map: String,
    /// When the recording was started, UTC.
    pub date: String,
}

/// An actor that appears.
#[derive(Clone, Debug, PartialEq)]
pub struct Born {
    /// Its id in the recorded run.
    pub id: u32,
    /// The actor that it was attached to; 0 if none.
    pub parent: u32,
    /// Type and attributes.
    pub description: Description,
    /// Its pose.
    pub at: Transform,
}

/// A vehicle's control as CARLA writes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pedals {
    /// Steering, −1 to 1, positive to the right.
    pub steer: f32,
    /// Throttle, 0 to 1.
    pub throttle: f32,
    /// Brake, 0 to 1.
    pub brake: f32,
    /// Whether the hand brake is on.
    pub hand_brake: bool,
    /// Gear; negative backwards.
    pub gear: i32,
}

/// What a traffic light shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// CARLA's number of the state.
    pub state: u8,
    /// Whether the light is frozen.
    pub frozen: bool,
    /// Seconds since the light changed to this state.
    pub elapsed_secs: f32,
}

/// Velocity (m/s) and angular velocity (degrees per second).
pub type Motion = [[f64; 3]; 2];

/// One recorded tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Number of the tick.
    pub tick: u64,
    /// Seconds since the recording began.
    pub elapsed_secs: f64,
    /// Length of the tick, seconds.
    pub delta_secs: f64,
    /// Actors that appeared.
    pub born: Vec<Born>,
    /// Actors that disappeared.
    pub gone: Vec<u32>,
    /// Poses of all actors that can move.
    pub poses: BTreeMap<u32, Transform>,
    /// Controls of vehicles.
    pub pedals: BTreeMap<u32, Pedals>,
    /// States of traffic lights.
    pub lights: BTreeMap<u32, Light>,
    /// Pairs of actors that began to touch; 0 is scenery.
    pub collisions: Vec<(u32, u32)>,
    /// Walking speeds that the gaits of walkers show, m/s.
    pub gaits: BTreeMap<u32, f32>,
    /// Lamps of vehicles, as CARLA's bits.
    pub lamps: BTreeMap<u32, u32>,
    /// Velocities, if the recording has additional data.
    pub motions: BTreeMap<u32, Motion>,
    /// Boxes and times, if the recording has additional data.
    pub extra: Extra,
    /// What is recorded on change only.
    pub changes: Changes,
}

/// Why a file cannot be used as a recording.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is no such file, or it cannot be opened.
    #[error("File {name} not found on server ({cause})")]
    NotFound {
        /// Name of the file.
        name: String,
        /// Why.
        cause: std::io::Error,
    },
    /// The file is too large.
    #[error("{name} has {n_bytes} bytes, at most {max} are read", max = MAX_BYTES)]
    TooLarge {
        /// Name of the file.
        name: String,
        /// Its size.
        n_bytes: u64,
    },
    /// The file's contents are no recording.
    #[error("{name} cannot be used: {cause}")]
    Contents {
        /// Name of the file.
        name: String,
        /// Why.
        cause: ReadError,
    },
}

/// Why bytes are no recording.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It does not begin as our recordings do.
    #[error("it is not a recording of gantry-carla (CARLA's own recordings have another format)")]
    Foreign,
    /// Its format is too old or too new.
    #[error(
        "its format is version {version}, but this program reads versions {oldest} to {newest}",
        oldest = OLDEST, newest = VERSION
    )]
    Version {
        /// Version of its format.
        version: u32,
    },
    /// A field is wrong.
    #[error(transparent)]
    Field(#[from] Wrong),
    /// A frame is no list.
    #[error("a frame is {kind}, but must be a list")]
    NoList {
        /// What it is.
        kind: &'static str,
    },
    /// Its bytes cannot be decoded.
    #[error(transparent)]
    Bytes(DecodeError),
    /// It is too long.
    #[error("it has more than {max} frames", max = MAX_FRAMES)]
    TooLong,
    /// It is empty.
    #[error("it has no frame")]
    Empty,
    /// Time runs backwards in it.
    #[error("its frames are not in the order of time")]
    Disorder,
}

/// A recording that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Head.
    pub head: Head,
    /// Frames in the order of time; at least one.
    pub frames: Vec<Frame>,
}

impl Head {
    /// Appends its bytes.
    pub fn write(&self, out: &mut Vec<u8>) {
        msgpack::write(
            out,
            &list![MAGIC, self.version, self.map.as_str(), self.date.as_str()],
        );
    }
}

fn floats(transform: &Transform) -> [Value; 6] {
    let ([x, y, z], [pitch, yaw, roll]) = (transform.location_m, transform.rotation_deg);
    [x, y, z, pitch, yaw, roll].map(Value::F64)
}

impl Frame {
    /// Appends its bytes.
    pub fn write(&self, out: &mut Vec<u8>) {
        let born = |born: &Born| {
            let attributes: Vec<Value> = born
                .description
                .attributes
                .iter()
                .map(|a| list![a.name.as_str(), a.kind, a.value.as_str()])
                .collect();
            let description = list![0u32, born.description.type_id.as_str(), attributes];
            list![born.id, born.parent, description, floats(&born.at).to_vec()]
        };
        let pose = |(id, at): (&u32, &Transform)| {
            Value::Array([&[Value::from(*id)][..], &floats(at)].concat())
        };
        let pedals = |(id, p): (&u32, &Pedals)| {
            list![*id, p.steer, p.throttle, p.brake, p.hand_brake, p.gear]
        };
        let motion = |(id, [v, w]): (&u32, &Motion)| list![*id, v[0], v[1], v[2], w[0], w[1], w[2]];
        let frame = list![
            self.tick,
            self.elapsed_secs,
            self.delta_secs,
            self.born.iter().map(born).collect::<Vec<_>>(),
            self.gone
                .iter()
                .map(|id| Value::from(*id))
                .collect::<Vec<_>>(),
            self.poses.iter().map(pose).collect::<Vec<_>>(),
            self.pedals.iter().map(pedals).collect::<Vec<_>>(),
            self.lights
                .iter()
                .map(|(id, light)| list![*id, light.state, light.frozen, light.elapsed_secs])
                .collect::<Vec<_>>(),
            self.collisions
                .iter()
                .map(|(a, b)| list![*a, *b])
                .collect::<Vec<_>>(),
            self.gaits
                .iter()
                .map(|(id, mps)| list![*id, *mps])
                .collect::<Vec<_>>(),
            self.lamps
                .iter()
                .map(|(id, bits)| list![*id, *bits])
                .collect::<Vec<_>>(),
            self.motions.iter().map(motion).collect::<Vec<_>>(),
        ];
        let Value::Array(mut fields) = frame else {
            return;
        };
        fields.extend(self.extra.values());
        fields.extend(self.changes.values());
        msgpack::write(out, &Value::Array(fields));
    }

    fn read(fields: &mut Fields<'_>, version: u32) -> Result<Frame, Wrong> {
        let mut frame = Frame {
            tick: fields.uint(u64::MAX)?,
            elapsed_secs: fields.f64()?,
            delta_secs: fields.f64()?,
            ..Frame::default()
        };
        for mut born in fields.each("an actor")? {
            let (id, parent, description) = (born.u32()?, born.u32()?, born.description()?);
            let at = place(&mut born.fields("a place")?)?;
            frame.born.push(Born {
                id,
                parent,
                description,
                at,
            });
        }
        let gone = fields.list()?;
        let mut ids = Fields::new("the actors that went", gone);
        for _ in gone {
            frame.gone.push(ids.u32()?);
        }
        for mut pose in fields.each("a pose")? {
            frame.poses.insert(pose.u32()?, place(&mut pose)?);
        }
        for mut given in fields.each("a control")? {
            let id = given.u32()?;
            let (steer, throttle, brake) = (given.f32()?, given.f32()?, given.f32()?);
            frame.pedals.insert(
                id,
                Pedals {
                    steer,
                    throttle,
                    brake,
                    hand_brake: given.bool()?,
                    gear: given.i32()?,
                },
            );
        }
        for mut light in fields.each("a light")? {
            let id = light.u32()?;
            frame.lights.insert(
                id,
                Light {
                    state: light.u8()?,
                    frozen: light.bool()?,
                    elapsed_secs: light.f32()?,
                },
            );
        }
        for mut pair in fields.each("a collision")? {
            frame.collisions.push((pair.u32()?, pair.u32()?));
        }
        for mut walker in fields.each("a gait")? {
            frame.gaits.insert(walker.u32()?, walker.f32()?);
        }
        for mut vehicle in fields.each("lamps")? {
            frame.lamps.insert(vehicle.u32()?, vehicle.u32()?);
        }
        for mut motion in fields.each("a motion")? {
            let id = motion.u32()?;
            let mut three = || Ok::<_, Wrong>([motion.f64()?, motion.f64()?, motion.f64()?]);
            frame.motions.insert(id, [three()?, three()?]);
        }
        if version > OLDEST {
            frame.extra = Extra::read(fields)?;
        }
        if version >= WITH_CHANGES {
            frame.changes = Changes::read(fields)?;
        }
        Ok(frame)
    }
}

fn place(fields: &mut Fields<'_>) -> Result<Transform, Wrong> {
    let location_m = [fields.f64()?, fields.f64()?, fields.f64()?];
    Ok(Transform {
        location_m,
        rotation_deg: [fields.f64()?, fields.f64()?, fields.f64()?],
    })
}

impl Recording {
    /// Reads a file. If its writer was killed, the recording ends with the last complete frame.
    ///
    /// # Errors
    /// If there is no such file, it is not a recording, or it is damaged.
    pub fn open(path: &Path) -> Result<Recording, OpenError> {
        let name = path
            .file_name()
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let file = match std::fs::File::open(path) {
            Ok(file) => file,
            Err(cause) => return Err(OpenError::NotFound { name, cause }),
        };
        let n_bytes = file.metadata().map_or(0, |about| about.len());
        if n_bytes > MAX_BYTES {
            return Err(OpenError::TooLarge { name, n_bytes });
        }
        Recording::read(&mut BufReader::new(file))
            .map_err(|cause| OpenError::Contents { name, cause })
    }

    /// Reads a recording's bytes.
    ///
    /// # Errors
    /// A sentence.
    pub fn read(reader: &mut impl Read) -> Result<Recording, ReadError> {
        let Ok(Value::Array(head)) = msgpack::read(
            reader,
            Limits {
                bytes: 1 << 16,
                values: 16,
                depth: 2,
            },
        ) else {
            return Err(ReadError::Foreign);
        };
        let mut fields = Fields::new("its head", &head);
        if fields.text() != Ok(MAGIC) {
            return Err(ReadError::Foreign);
        }
        let version = fields.u32()?;
        if !(OLDEST..=VERSION).contains(&version) {
            return Err(ReadError::Version { version });
        }
        let head = Head {
            version,
            map: fields.text()?.to_owned(),
            date: fields.text()?.to_owned(),
        };
        let mut frames: Vec<Frame> = Vec::new();
        loop {
            match msgpack::read(reader, Limits::default()) {
                Ok(Value::Array(items)) => {
                    frames.push(Frame::read(&mut Fields::new("a frame", &items), version)?)
                }
                Ok(other) => {
                    return Err(ReadError::NoList { kind: other.kind() });
                }
                Err(DecodeError::Closed | DecodeError::Io(_)) => break,
                Err(error) => return Err(ReadError::Bytes(error)),
            }
            if frames.len() > MAX_FRAMES {
                return Err(ReadError::TooLong);
            }
        }
        if frames.is_empty() {
            return Err(ReadError::Empty);
        }
        if !frames.is_sorted_by(|a, b| a.elapsed_secs < b.elapsed_secs) {
            return Err(ReadError::Disorder);
        }
        Ok(Recording { head, frames })
    }

    /// Time of the last frame, seconds.
    pub fn duration_secs(&self) -> f64 {
        self.frames.last().map_or(0.0, |frame| frame.elapsed_secs)
    }

    /// The description of every actor that appears, by id.
    pub fn names(&self) -> BTreeMap<u32, &Description> {
        self.frames
            .iter()
            .flat_map(|frame| &frame.born)
            .map(|born| (born.id, &born.description))
            .collect()
    }
}
