//! Rigs: sensors that share the first segment of their topics, and a wake-up per tick for those who
//! want all frames of a tick.

use std::rc::Rc;

use schema_bus::{Bus, Notifier, names};

/// All sensors with the same first topic segment. It ends with its last sensor.
pub struct Rig {
    /// First segment of its topics.
    pub name: String,
    /// Event `<rig>/tick`, for readers of several views and of whole ticks.
    wake: Notifier,
}

impl Rig {
    /// Opens the rig's event.
    pub fn open(bus: &Bus, name: &str) -> anyhow::Result<Rc<Rig>> {
        Ok(Rc::new(Rig {
            wake: bus.notifier(&names::rig_tick(name))?,
            name: name.to_owned(),
        }))
    }
}

/// Rigs whose frames of a tick are complete, each once. Readers of a single topic are woken by its
/// own event, see [`crate::topic::Topic::send`].
#[derive(Default)]
pub struct Waking(Vec<Rc<Rig>>);

impl Waking {
    /// Adds a rig that has a new frame.
    pub fn add(&mut self, rig: &Rc<Rig>) {
        if !self.0.iter().any(|known| Rc::ptr_eq(known, rig)) {
            self.0.push(rig.clone());
        }
    }

    /// Takes a rig out, because it is woken later.
    pub fn postpone(&mut self, rig: &Rc<Rig>) {
        self.0.retain(|known| !Rc::ptr_eq(known, rig));
    }

    /// Wakes the readers of all of them.
    pub fn wake(self) {
        for rig in self.0 {
            rig.wake.notify_listeners();
        }
    }
}
