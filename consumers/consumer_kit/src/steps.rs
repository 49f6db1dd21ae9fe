//! The loop of a program that answers every tick: in lockstep, one complete tick after the other.

use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Listener};

use crate::lockstep::{Lockstep, LockstepError};
use crate::snapshots::{SnapshotTrail, WorldAt};

/// How often a simulator that was restarted is asked for a place again.
const JOIN_EVERY: Duration = Duration::from_secs(1);

/// Ticks one by one. The simulator begins no tick before the last one that was given out is
/// acknowledged, which the next call of [`Steps::next`] does. Dropped, it leaves.
///
/// ```no_run
/// use std::time::Duration;
/// use consumer_kit::{Follower, Steps, Take};
///
/// let mut follower = Follower::open("gantry", "my-detector")?;
/// let camera = follower.follow("ego/front/rgb", Take::All);
/// let mut steps = Steps::join(&mut follower, "my-detector", Duration::from_secs(10))?;
/// while let Some(world) = steps.next(follower.bus(), Duration::from_secs(60))? {
///     // Every frame of this tick is there; a sensor that did not fire has none.
///     while let Some(image) = follower.take(camera)? {
///         println!("tick {}: {} bytes", world.header.tick, image.len());
///     }
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Steps {
    name: String,
    /// `None` between the end of a simulator and joining the next.
    lockstep: Option<Lockstep>,
    trail: SnapshotTrail,
    wake: Listener,
    /// The event that `wake` listens to.
    event: &'static str,
    /// Epoch and tick that were given out last.
    last: (u64, u64),
    owed: bool,
    next_join: Instant,
}

impl Steps {
    /// Joins as `name`, after a look for the topics of `follower`: what is found before is read
    /// from the first tick on.
    ///
    /// # Errors
    /// [`LockstepError`].
    pub fn join(
        follower: &mut crate::Follower,
        name: &str,
        timeout: Duration,
    ) -> Result<Steps, LockstepError> {
        follower.wait(Duration::ZERO)?;
        Steps::join_on(follower.bus(), name, timeout)
    }

    /// Joins as `name`. Open what is read before, so that nothing of the first tick is missed.
    ///
    /// # Errors
    /// [`LockstepError`].
    pub fn join_on(bus: &Bus, name: &str, timeout: Duration) -> Result<Steps, LockstepError> {
        let mut trail = SnapshotTrail::new();
        trail.newest(bus)?;
        let lockstep = Lockstep::join(bus, name, timeout)?;
        let event = lockstep.event();
        Ok(Steps {
            name: name.into(),
            lockstep: Some(lockstep),
            trail,
            wake: bus.listener(event)?,
            event,
            last: (0, 0),
            owed: false,
            next_join: Instant::now(),
        })
    }

    /// Acknowledges the last tick and waits for the next, until everything of it was sent. `None`
    /// after `timeout`. If the simulator was restarted, it goes on with the new one.
    ///
    /// # Errors
    /// [`LockstepError`].
    pub fn next(
        &mut self,
        bus: &Bus,
        timeout: Duration,
    ) -> Result<Option<Arc<WorldAt>>, LockstepError> {
        self.acknowledge()?;
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(world) = self.look(bus)? {
                return Ok(Some(world));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return Ok(None);
            }
            self.wake.wait(rest.min(crate::MAX_WAIT))?;
        }
    }

    /// Acknowledges the last tick now, for a program that has to wait for something else.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn acknowledge(&mut self) -> Result<(), BusError> {
        match &self.lockstep {
            Some(lockstep) if std::mem::take(&mut self.owed) && lockstep.epoch() == self.last.0 => {
                lockstep.ack(self.last.1)
            }
            _ => Ok(()),
        }
    }

    /// The newest tick, if it waits for this program, was not given out yet and is complete.
    fn look(&mut self, bus: &Bus) -> Result<Option<Arc<WorldAt>>, LockstepError> {
        let Some(world) = self.trail.newest(bus)? else {
            return Ok(None);
        };
        let now = (world.header.epoch, world.header.tick);
        if self.lockstep.as_ref().is_some_and(|at| at.epoch() != now.0) {
            self.lockstep = None;
        }
        if self.lockstep.is_none() {
            self.rejoin(bus)?;
        }
        let Some(lockstep) = &mut self.lockstep else {
            return Ok(None);
        };
        if lockstep.epoch() != now.0 || now.1 < lockstep.first_tick() || now == self.last {
            return Ok(None);
        }
        if !lockstep.is_complete(now.1)? {
            return Ok(None);
        }
        (self.last, self.owed) = (now, true);
        Ok(Some(world))
    }

    fn rejoin(&mut self, bus: &Bus) -> Result<(), LockstepError> {
        if Instant::now() < self.next_join {
            return Ok(());
        }
        self.next_join = Instant::now() + JOIN_EVERY;
        match Lockstep::join(bus, &self.name, JOIN_EVERY) {
            Ok(lockstep) => {
                if lockstep.event() != self.event {
                    self.event = lockstep.event();
                    self.wake = bus.listener(self.event)?;
                }
                self.lockstep = Some(lockstep);
            }
            Err(LockstepError::Bus(error)) => return Err(error.into()),
            // The new simulator is not ready yet, or still counts the old place.
            Err(other) => tracing::debug!(error = %other, "no place in lockstep yet"),
        }
        Ok(())
    }
}
