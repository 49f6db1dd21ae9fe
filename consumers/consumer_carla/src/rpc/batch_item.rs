//! One command of a batch, and the type of the functions that read it.

use schema_frames::{Command, VehicleControlRecord};

use crate::wire::description::Description;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;

/// One command of a batch.
pub(crate) enum Item<'v> {
    /// A command for the simulator; the answer names `actor`.
    Ask { actor: u32, command: Command },
    /// A new actor, and the commands that follow its spawn.
    Spawn {
        description: Description,
        parent: u32,
        command: Command,
        then: &'v [Value],
    },
    /// A vehicle's control.
    Control {
        actor: u32,
        record: VehicleControlRecord,
    },
    /// A new place for an actor, which keeps its rotation.
    Move { actor: u32, location_m: [f64; 3] },
    /// Accepted without effect; `what` is logged once.
    Nothing {
        actor: u32,
        what: Option<&'static str>,
    },
}

impl Item<'_> {
    /// A command for the simulator.
    pub(crate) fn ask(actor: u32, command: Command) -> Self {
        Item::Ask { actor, command }
    }
}

/// Reads one kind of command: its fields after the actor's id.
pub(crate) type Read = for<'v> fn(u32, &mut Fields<'v>) -> Result<Item<'v>, Wrong>;

/// The commands of one area: their numbers on the wire and the functions that read them. Each
/// area's module has a table `BATCH`.
pub(crate) type Commands = &'static [(u8, Read)];
