//! Sending vehicle controls.

use std::sync::Arc;

use schema_bus::{ControlWriter, Notifier, names};
use schema_frames::VehicleControlRecord;

use crate::border::{List, Out, Status, Text, ask, call, hand_over, needed};
use crate::place::{BusHandle, Place};

/// The handle `gantry_controls`.
#[derive(Debug)]
pub struct Controls {
    // Ports go before their node.
    writer: ControlWriter,
    wake: Notifier,
    _place: Arc<Place>,
}

/// Opens `control/vehicles` as a writer.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_controls_open(
    bus: Option<&BusHandle>,
    name: Text<'_>,
    controls: Out<'_, Option<Box<Controls>>>,
) -> Status {
    call(|| {
        let place = needed(bus, "bus")?.place.clone();
        let name = name.needed("name")?;
        let controls = needed(controls, "controls")?;
        let made = Controls {
            writer: place.bus.control_writer(name)?,
            wake: place.bus.notifier(names::CONTROL_WAKE)?,
            _place: place,
        };
        Ok(hand_over(controls, made))
    })
}

/// Sends controls that answer the snapshot of `tick`.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_controls_send(
    controls: Option<&mut Controls>,
    tick: u64,
    records: List<'_, VehicleControlRecord>,
    n_records: usize,
) -> Status {
    call(|| {
        let controls = needed(controls, "controls")?;
        let records = records.read(n_records, "records")?;
        controls.writer.send(tick, records)?;
        controls.wake.notify();
        Ok(Status::Ok)
    })
}

/// Stops sending; vehicles keep what they were told last.
#[unsafe(no_mangle)]
pub extern "C" fn gantry_controls_close(controls: Option<Box<Controls>>) {
    ask((), || drop(controls));
}

const _: () = {
    const fn moves<T: Send>() {}
    moves::<Controls>();
};
