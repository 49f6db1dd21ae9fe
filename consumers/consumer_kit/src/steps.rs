//! The loop of a program that answers every tick: in lockstep, one complete tick after the other.

use std::sync::Arc;
use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, Listener, names};

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
    /// Opened by the first [`Steps::next`], with the event that it listens to.
    wake: Option<(Listener, &'static str)>,
    /// Epoch and tick that were given out last.
    last: (u64, u64),
    owed: bool,
    next_join: Instant,
    restarts: u64,
}

/// What must have happened of a tick before it is given out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ready {
    /// The world has moved; frames of the tick may still be made.
    Begun,
    /// Every frame of it was sent.
    Complete,
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
        Ok(Steps {
            name: name.into(),
            lockstep: Some(Lockstep::join(bus, name, timeout)?),
            trail,
            wake: None,
            last: (0, 0),
            owed: false,
            next_join: Instant::now(),
            restarts: 0,
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
            if let Some(world) = self.look(bus, Ready::Complete)? {
                return Ok(Some(world));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return Ok(None);
            }
            self.wake(bus)?.wait(rest.min(crate::MAX_WAIT))?;
        }
    }

    /// The event to sleep on until the next tick may be complete.
    fn wake(&mut self, bus: &Bus) -> Result<&Listener, BusError> {
        let heard = self.wake.as_ref().map(|(_, event)| *event);
        let event = self.event().or(heard).unwrap_or(names::WORLD_SNAPSHOT);
        if heard != Some(event) {
            self.wake = None;
        }
        let (listener, _) = match self.wake.take() {
            Some(wake) => self.wake.insert(wake),
            None => self.wake.insert((bus.listener(event)?, event)),
        };
        Ok(listener)
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

    /// The newest tick, if it waits for this program, was not given out yet and is `ready`. Joins
    /// again if the simulator was restarted. For those who sleep on an event by themselves.
    ///
    /// # Errors
    /// [`LockstepError`].
    pub fn look(&mut self, bus: &Bus, ready: Ready) -> Result<Option<Arc<WorldAt>>, LockstepError> {
        let Some(world) = self.trail.newest(bus)? else {
            return Ok(None);
        };
        let now = (world.header.epoch, world.header.tick);
        if self.lockstep.as_ref().is_some_and(|at| at.epoch() != now.0) {
            self.lockstep = None;
            self.restarts += 1;
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
        if ready == Ready::Complete && !lockstep.is_complete(now.1)? {
            return Ok(None);
        }
        (self.last, self.owed) = (now, true);
        Ok(Some(world))
    }

    /// Whether every frame was sent of the tick that was given out last; also if its simulator was
    /// restarted, because no more will come then. `false` while there is no place in lockstep.
    ///
    /// # Errors
    /// As [`Lockstep::is_complete`].
    pub fn is_complete(&mut self) -> Result<bool, LockstepError> {
        match &mut self.lockstep {
            Some(lockstep) if lockstep.epoch() == self.last.0 => lockstep.is_complete(self.last.1),
            Some(_) => Ok(true),
            None => Ok(false),
        }
    }

    /// The event after which a tick may be complete; `None` while there is no place in lockstep.
    pub fn event(&self) -> Option<&'static str> {
        self.lockstep.as_ref().map(Lockstep::event)
    }

    /// First tick that waits for this program; `None` while there is no place in lockstep.
    pub fn first_tick(&self) -> Option<u64> {
        self.lockstep.as_ref().map(Lockstep::first_tick)
    }

    /// Number of times that the simulator was restarted.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    fn rejoin(&mut self, bus: &Bus) -> Result<(), LockstepError> {
        if Instant::now() < self.next_join {
            return Ok(());
        }
        self.next_join = Instant::now() + JOIN_EVERY;
        match Lockstep::join(bus, &self.name, JOIN_EVERY) {
            Ok(lockstep) => self.lockstep = Some(lockstep),
            Err(LockstepError::Bus(error)) => return Err(error.into()),
            // The new simulator is not ready yet, or still counts the old place.
            Err(other) => tracing::debug!(error = %other, "no place in lockstep yet"),
        }
        Ok(())
    }
}
