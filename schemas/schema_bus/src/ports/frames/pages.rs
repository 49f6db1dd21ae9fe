//! Pages for a reader of frames that has just joined.

use iceoryx2::prelude::*;
use schema_frames::FrameHeader;

use crate::contract::error::BusError;
use crate::memory::reserve::{Need, reserve_for};
use crate::memory::segment_files::fixed_segment_file;
use crate::place::node::BusNode;
use crate::place::service::{Slices, capacity};

/// Reserves a place for each reader that the topic has now, in the segments of all its writers; for
/// a reader that has just joined. A segment that grows, or is another user's, is left to its writer.
///
/// # Errors
/// [`BusError::Memory`] if `/dev/shm` has no room for one more reader.
pub(crate) fn reserve_as_reader(
    node: &BusNode,
    service: &Slices<FrameHeader>,
) -> Result<(), BusError> {
    let ports = service.dynamic_config();
    let n_readers = ports.number_of_subscribers();
    let mut writers = Vec::new();
    ports.list_publishers(|port| {
        writers.push((
            port.publisher_id.value(),
            port.number_of_samples,
            port.max_slice_len,
        ));
        CallbackProgression::Continue
    });
    let qos = capacity(service);
    for (id, n_slots, max_payload_bytes) in writers {
        let need = Need {
            qos,
            max_loans: n_slots.saturating_sub(qos.slots(0)),
            max_payload_bytes,
        };
        if let Some(file) = fixed_segment_file(node.config(), id) {
            reserve_for(service.name().as_str(), &file, &need, n_readers)?;
        }
    }
    Ok(())
}
