//! Where the parts of a sample lie in a slot of its writer's segment.

use iceoryx2::service::static_config::message_type_details::MessageTypeDetails;

/// A slot of a writer's segment, bytes: iceoryx2's header, our header, the payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Slot {
    /// Offset and length of our header.
    pub header: (usize, usize),
    /// Offset of the payload.
    pub payload: usize,
    /// Size of one element of the payload.
    pub element: usize,
    /// Slots begin at multiples of this.
    pub align: usize,
}

impl Slot {
    pub fn of(types: &MessageTypeDetails) -> Slot {
        let parts = [&types.header, &types.user_header, &types.payload];
        Self::from_parts(parts.map(|part| (part.size(), part.alignment())))
    }

    /// From size and alignment of iceoryx2's header, of ours, and of an element.
    pub fn from_parts(parts: [(usize, usize); 3]) -> Slot {
        let [own, user, element] = parts.map(|(size, align)| (size, align.max(1)));
        let header = own.0.next_multiple_of(user.1);
        Slot {
            header: (header, user.0),
            payload: (header + user.0).next_multiple_of(element.1),
            element: element.0,
            align: own.1.max(user.1).max(element.1),
        }
    }

    /// Bytes from one slot to the next if the longest payload has `max_payload_bytes`.
    pub fn stride(&self, max_payload_bytes: usize) -> usize {
        let bytes = self.payload.saturating_add(max_payload_bytes);
        bytes.checked_next_multiple_of(self.align).unwrap_or(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_slot_lie_at_multiples_of_their_alignments() {
        // iceoryx2's header of 48 bytes, a frame's header of 256 at 64, bytes.
        let slot = Slot::from_parts([(48, 8), (256, 64), (1, 1)]);
        assert_eq!(
            (slot.header, slot.payload, slot.align),
            ((64, 256), 320, 64)
        );
        assert_eq!(slot.stride(12_288), 12_608);
        // No header, records of 32 bytes.
        let slot = Slot::from_parts([(48, 8), (0, 1), (32, 8)]);
        assert_eq!((slot.header, slot.payload, slot.align), ((48, 0), 48, 8));
        assert_eq!(slot.stride(32), 80);
    }
}
