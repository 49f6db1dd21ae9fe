//! The bus side of sharing vehicles with other processes: hears what they answer, and says when one
//! has fallen silent or is back.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, ControlReader};

use crate::share::{Colleagues, Share};

/// Ticks without an answer after which a process that takes part in lockstep is silent: the world
/// waits for it, so that one missed tick tells.
const LOCKSTEP_TICKS: u64 = 3;
/// The same for one that does not: in simulated time, and as long by the clock.
const SILENT: Duration = Duration::from_millis(500);
/// After this, a process that was never heard is asked for.
const UNHEARD: Duration = Duration::from_secs(3);

/// A tick of one run of the simulator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct TickId {
    /// Run of the simulator.
    pub epoch: u64,
    /// Tick.
    pub tick: u64,
}

/// The processes with which the vehicles are shared.
pub(crate) struct Peers {
    colleagues: Colleagues,
    /// Names by number less one.
    names: Vec<String>,
    heard_at: Vec<Instant>,
    since: Instant,
    has_asked: bool,
    epoch: u64,
    reader: ControlReader,
}

/// The name under which a share of the vehicles `whom` writes its controls.
pub(crate) fn writer_name(whom: &str, share: Option<Share>) -> String {
    let part = share.map_or(String::new(), |share| format!("-{share}"));
    let room = 40 - "drive-".len() - part.len();
    let whom: String = whom.chars().take(room).collect();
    format!("drive-{whom}{part}")
}

impl Peers {
    /// # Errors
    /// The bus fails, or too many read the controls.
    pub fn open(bus: &Bus, whom: &str, share: Share) -> Result<Peers, BusError> {
        let name = |number: u32| writer_name(whom, Some(Share { number, ..share }));
        let now = Instant::now();
        Ok(Peers {
            colleagues: Colleagues::new(share),
            names: (1..=share.of).map(name).collect(),
            heard_at: vec![now; share.of as usize],
            since: now,
            has_asked: false,
            epoch: 0,
            reader: bus.control_reader()?,
        })
    }

    /// Hears who has answered, and notes who has not.
    ///
    /// # Errors
    /// The bus fails.
    pub fn listen(
        &mut self,
        now: TickId,
        period_nanos: u64,
        in_lockstep: bool,
    ) -> Result<(), BusError> {
        if self.epoch != now.epoch {
            self.colleagues.restart();
            self.epoch = now.epoch;
        }
        for batch in self.reader.drain()? {
            let Some(idx) = self.names.iter().position(|name| *name == batch.writer) else {
                continue;
            };
            self.heard_at[idx] = Instant::now();
            if self.colleagues.heard(idx as u32 + 1, batch.tick) {
                tracing::info!("{} is back and drives its vehicles", batch.writer);
            }
        }
        let n_ticks = if in_lockstep {
            LOCKSTEP_TICKS
        } else {
            (SILENT.as_nanos() as u64 / period_nanos.max(1)).max(LOCKSTEP_TICKS)
        };
        let heard_at = &self.heard_at;
        let is_late = |number: u32| in_lockstep || heard_at[number as usize - 1].elapsed() > SILENT;
        let since = now.tick.saturating_sub(n_ticks);
        for number in self.colleagues.fallen_silent(since, is_late) {
            tracing::warn!(
                "{} has fallen silent; the others drive its vehicles until it is back",
                self.names[number as usize - 1]
            );
        }
        if !self.has_asked && self.since.elapsed() > UNHEARD {
            self.has_asked = true;
            for number in self.colleagues.unheard() {
                tracing::warn!(
                    "{} has not been heard yet: nobody drives its vehicles until it is started",
                    self.names[number as usize - 1]
                );
            }
        }
        Ok(())
    }

    /// Whether this process drives a vehicle.
    pub fn drives(&self, id: u32) -> bool {
        self.colleagues.drives(id)
    }

    /// Grows whenever [`Peers::drives`] may answer otherwise.
    pub fn revision(&self) -> u64 {
        self.colleagues.revision()
    }
}
