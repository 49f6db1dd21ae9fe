//! Takes a topic's samples for the link, copied out of shared memory.

use bytemuck::bytes_of;
use consumer_kit::{Domain, TopicId};
use schema_bus::BusError;
use schema_frames::FrameHeader;

use crate::announce::Kind;

/// Samples in a row that are refused before other topics are looked at.
const MAX_REFUSED: usize = 64;

/// One sample, copied out of shared memory.
#[derive(Debug)]
pub struct Taken {
    /// Its user header, and what stands behind it in the envelope.
    pub header: Vec<u8>,
    /// The header of a frame.
    pub frame: Option<FrameHeader>,
    /// Its payload; of a result its body.
    pub payload: Vec<u8>,
}

/// The next sample of a topic, if one waits. Samples that break the contract are passed over.
///
/// # Errors
/// [`BusError`].
pub fn take(domain: &mut Domain, id: TopicId, kind: Kind) -> Result<Option<Taken>, BusError> {
    for _ in 0..MAX_REFUSED {
        match try_take(domain, id, kind) {
            Err(BusError::BadSample { .. }) => {}
            taken => return taken,
        }
    }
    Ok(None)
}

fn try_take(domain: &mut Domain, id: TopicId, kind: Kind) -> Result<Option<Taken>, BusError> {
    Ok(match kind {
        Kind::Frames => domain.take_frame(id)?.map(|frame| Taken {
            header: bytes_of(frame.header()).to_vec(),
            frame: Some(*frame.header()),
            payload: frame.to_vec(),
        }),
        Kind::Results => domain.take_result(id)?.map(|result| Taken {
            header: [
                bytes_of(result.header()),
                bytemuck::cast_slice(result.inputs()),
            ]
            .concat(),
            frame: None,
            payload: result.to_vec(),
        }),
        Kind::Snapshot => domain.take_snapshot(id)?.map(|snapshot| Taken {
            header: bytes_of(snapshot.header()).to_vec(),
            frame: None,
            payload: bytemuck::cast_slice(snapshot.records()).to_vec(),
        }),
        Kind::Document => domain.take_document(id)?.map(|document| Taken {
            header: bytes_of(&document.header).to_vec(),
            frame: None,
            payload: document.text.clone().into_bytes(),
        }),
    })
}
