//! One command of a batch, and what reads it.

use schema_frames::{Command, VehicleControlRecord};

use crate::wire::description::Description;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;

/// One command of a batch, read.
pub(crate) enum Item<'v> {
    /// For the simulator; `actor` is what the answer names.
    Ask { actor: u32, command: Command },
    /// A new actor, and what follows.
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
    /// Accepted without effect.
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

/// Reads the fields behind the actor's id of one kind of command.
pub(crate) type Read = for<'v> fn(u32, &mut Fields<'v>) -> Result<Item<'v>, Wrong>;

/// Commands of one area: their numbers on the wire, and what reads them. Each area's module has a
/// table `BATCH`.
pub(crate) type Commands = &'static [(u8, Read)];
