//! The frames around a moment of a recording that is played; a frame is read when its time comes.

use std::fs::File;
use std::io::BufReader;
use std::sync::Arc;

use crate::recorder::file::Reader;
use crate::recorder::frame::{Frame, Origin};
use crate::recorder::read_error::ReadError;

/// Plays a recording once, forwards.
#[derive(Debug)]
pub struct Playback {
    reader: Reader<BufReader<File>>,
    now: Option<Arc<Frame>>,
    next: Option<Arc<Frame>>,
}

impl Playback {
    /// Prepares to play what a reader has ahead.
    ///
    /// # Errors
    /// If the first frame cannot be read.
    pub fn begin(mut reader: Reader<BufReader<File>>) -> Result<Playback, ReadError> {
        let next = playable(&mut reader)?;
        Ok(Playback {
            reader,
            now: None,
            next,
        })
    }

    /// The next frame on the way to a time, which is the current one from then on; `None` once that
    /// time is reached. The first frame is shown until its time comes, too.
    ///
    /// # Errors
    /// If the file was changed meanwhile and is no recording any more.
    pub fn reach(&mut self, secs: f64) -> Result<Option<Arc<Frame>>, ReadError> {
        let is_due = |next: &Arc<Frame>| self.now.is_none() || next.elapsed_secs <= secs;
        if !self.next.as_ref().is_some_and(is_due) {
            return Ok(None);
        }
        self.now = self.next.take();
        self.next = playable(&mut self.reader)?;
        Ok(self.now.clone())
    }

    /// The current frame and the one after it.
    pub fn around(&self) -> (Option<Arc<Frame>>, Option<Arc<Frame>>) {
        (self.now.clone(), self.next.clone())
    }
}

/// The next frame, without what CARLA's files say in terms of its own towns and bodies: its numbers
/// of street lights are not those of this map, the bones of its walkers have other axes, and its
/// replayer leaves physics control alone, too.
fn playable(reader: &mut Reader<BufReader<File>>) -> Result<Option<Arc<Frame>>, ReadError> {
    let mut frame = reader.next_frame()?;
    if let Some(frame) = &mut frame
        && reader.head().origin == Origin::Carla
    {
        frame.changes.street_lights.clear();
        frame.changes.bones.clear();
        frame.changes.physics.clear();
    }
    Ok(frame.map(Arc::new))
}
