//! Turns signals to the launcher into events of the supervisor.

use std::io::Read;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use anyhow::Context as _;

use super::child::Event;

/// The supervisor's event queue, with the signals to this process. It is made before the first
/// child, so that no signal is missed.
pub struct Signals {
    pub events: Sender<Event>,
    pub inbox: Receiver<Event>,
}

impl Signals {
    pub fn install() -> anyhow::Result<Self> {
        let (events, inbox) = channel();
        let wanted = [
            signal_hook::consts::SIGINT,
            signal_hook::consts::SIGTERM,
            signal_hook::consts::SIGHUP,
        ];
        let mut signals =
            signal_hook::iterator::Signals::new(wanted).context("cannot listen for signals")?;
        let sender = events.clone();
        std::thread::spawn(move || {
            signals
                .forever()
                .take_while(|_| sender.send(Event::Signal).is_ok())
                .for_each(drop)
        });
        Ok(Signals { events, inbox })
    }

    /// Heeds somebody else, too: every byte that comes counts as a signal, and so does the end of
    /// what comes, when the other side is gone.
    pub fn heed(&self, mut other: impl Read + Send + 'static) {
        let sender = self.events.clone();
        std::thread::spawn(move || {
            let mut byte = [0];
            while other.read_exact(&mut byte).is_ok() {
                if sender.send(Event::Signal).is_err() {
                    return;
                }
            }
            let _ = sender.send(Event::Signal);
        });
    }

    /// Waits so long for a signal, before the supervisor takes them. Returns whether one came.
    pub fn asked_within(&self, time: Duration) -> bool {
        self.inbox.recv_timeout(time).is_ok()
    }
}
