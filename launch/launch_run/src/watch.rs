//! Waits that look after processes.

use std::time::{Duration, Instant};

use schema_bus::{Bus, Document};

use crate::error::RunError;

/// Pause between two looks at a process or at the bus.
pub const LOOK_EVERY: Duration = Duration::from_millis(20);

/// What has to run while somebody waits.
pub trait Watched {
    /// Fails if a process has ended.
    ///
    /// # Errors
    /// Which, how, and what it said last.
    fn must_run(&mut self) -> Result<(), RunError>;

    /// Where more is to be seen when nothing happens, as the end of a sentence.
    fn hint(&self) -> String;
}

/// Processes, and the user's wish to stop.
pub struct Watch<'a> {
    /// The processes.
    pub watched: &'a mut dyn Watched,
    /// Whether the user asked to stop.
    pub stop: &'a dyn Fn() -> bool,
}

impl Watch<'_> {
    /// Looks after both.
    ///
    /// # Errors
    /// [`RunError::Stopped`], or those of [`Watched::must_run`].
    pub fn look(&mut self) -> Result<(), RunError> {
        if (self.stop)() {
            return Err(RunError::Stopped);
        }
        self.watched.must_run()
    }

    /// Looks after both, and pauses; gives up if nothing has happened since `since` for `stall`.
    ///
    /// # Errors
    /// Those of [`Watch::look`], or [`RunError::Stalled`].
    pub fn rest(&mut self, since: Instant, stall: Duration) -> Result<(), RunError> {
        self.look()?;
        if since.elapsed() > stall {
            return Err(RunError::Stalled {
                secs: stall.as_secs(),
                hint: self.watched.hint(),
            });
        }
        std::thread::sleep(LOOK_EVERY);
        Ok(())
    }

    /// Waits until `done`, which is asked several times a second; `otherwise` says what did not
    /// happen.
    ///
    /// # Errors
    /// Those of `done` and of [`Watch::look`], or [`RunError::TooLong`].
    pub fn until(
        &mut self,
        within: Duration,
        otherwise: &str,
        done: &mut dyn FnMut() -> Result<bool, RunError>,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        while !done()? {
            self.look()?;
            if start.elapsed() > within {
                return Err(RunError::TooLong {
                    otherwise: otherwise.to_owned(),
                    secs: within.as_secs(),
                });
            }
            std::thread::sleep(LOOK_EVERY);
        }
        Ok(())
    }

    /// Waits for a document of the simulator.
    ///
    /// # Errors
    /// As [`Watch::until`].
    pub fn document(
        &mut self,
        bus: &Bus,
        name: &str,
        within: Duration,
    ) -> Result<Document, RunError> {
        let (mut found, mut reader) = (None, None);
        loop {
            self.until(within, &format!("there is no {name}"), &mut || {
                if reader.is_none() && bus.exists(name) {
                    reader = Some(bus.document_reader(name)?);
                }
                found = match &mut reader {
                    Some(reader) => reader.latest()?,
                    None => None,
                };
                Ok(found.is_some())
            })?;
            if let Some(document) = found.take() {
                return Ok(document);
            }
        }
    }
}
