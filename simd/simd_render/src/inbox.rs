//! Messages of the simulator that wait, and whether the world has gone on without this worker.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use schema_bus::{Bus, BusError, Life, Listener, Origin, SceneMessage, SceneReader, names};

/// Messages that wait.
pub struct Inbox {
    reader: RefCell<SceneReader>,
    waiting: RefCell<VecDeque<SceneMessage>>,
    sent: Listener,
    /// Tick that is being rendered.
    tick: Cell<u64>,
    /// Ticks that the world may be ahead of it.
    most_ahead: Cell<u64>,
    /// Process of the simulator.
    source: RefCell<Option<(Origin, Option<Life>)>>,
}

impl Inbox {
    /// Begins to listen.
    pub fn open(bus: &Bus) -> Result<Rc<Inbox>, BusError> {
        Ok(Rc::new(Inbox {
            sent: bus.listener(names::CONTROL_SCENE)?,
            reader: RefCell::new(bus.scene_reader()?),
            waiting: RefCell::default(),
            tick: Cell::new(0),
            most_ahead: Cell::new(u64::MAX),
            source: RefCell::default(),
        }))
    }

    /// The world may be so many ticks ahead; where it is more, it has given this worker's share to
    /// others.
    pub fn expect_at_most(&self, n_ticks: u64) {
        self.most_ahead.set(n_ticks);
    }

    /// Takes the next message.
    pub fn next(&self) -> Result<Option<SceneMessage>, BusError> {
        self.pull()?;
        let message = self.waiting.borrow_mut().pop_front();
        if let Some(message) = &message {
            self.tick.set(message.header().tick);
        }
        Ok(message)
    }

    /// Whether the world still counts on the frames of the tick that is being rendered.
    pub fn is_counted_on(&self) -> bool {
        // Messages that cannot be read say nothing; the tick loop meets the error.
        let _ = self.pull();
        let newest = self
            .waiting
            .borrow()
            .back()
            .map_or(0, |message| message.header().tick);
        newest.saturating_sub(self.tick.get()) <= self.most_ahead.get()
    }

    /// Sleeps until a message is sent.
    pub fn wait(&self, timeout: Duration) -> Result<bool, BusError> {
        self.sent.wait(timeout)
    }

    /// Whether the process that sends messages lives. One that restarted counts as gone.
    pub fn has_source(&self, bus: &Bus) -> bool {
        let mut source = self.source.borrow_mut();
        if let Some((_, Some(life))) = &*source {
            return life.goes_on();
        }
        bus.clean_dead_nodes();
        let now = self.reader.borrow().writer();
        let is_same = match (&*source, &now) {
            (Some((known, _)), Some(now)) => known.pid == now.pid,
            (_, now) => now.is_some(),
        };
        if let Some(now) = now {
            *source = Some((now.clone(), now.life()));
        }
        is_same
    }

    fn pull(&self) -> Result<(), BusError> {
        let (mut reader, mut waiting) = (self.reader.borrow_mut(), self.waiting.borrow_mut());
        loop {
            match reader.next() {
                Ok(Some(message)) => waiting.push_back(message),
                Ok(None) => return Ok(()),
                // As many wait here as may.
                Err(BusError::BorrowLimit { .. }) if !waiting.is_empty() => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }
}
