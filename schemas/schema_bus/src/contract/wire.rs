//! Our headers and records as iceoryx2 sees them: the same bytes under the fixed type names of the
//! contract.
//!
//! iceoryx2 compares the name, size and alignment of header and payload when a service is opened.
//! Its derive macro refuses `repr(align)` and would use the module path as the name, so the names
//! are given by hand here.

use iceoryx2::prelude::ZeroCopySend;
use schema_frames::{
    AckRecord, CompleteRecord, DocumentHeader, FrameHeader, RenderedRecord, ResultHeader,
    SceneHeader, SnapshotHeader, command::RequestHeader, control::ControlHeader,
};

/// A plain-data type with the name that the contract gives it.
pub trait OnBus: bytemuck::Pod + std::fmt::Debug {
    /// Name that every language gives to iceoryx2.
    const NAME: &'static str;
}

impl OnBus for FrameHeader {
    const NAME: &'static str = "GantryFrameHeader";
}
impl OnBus for SnapshotHeader {
    const NAME: &'static str = "GantrySnapshotHeader";
}
impl OnBus for DocumentHeader {
    const NAME: &'static str = "GantryDocumentHeader";
}
impl OnBus for ControlHeader {
    const NAME: &'static str = "GantryControlHeader";
}
impl OnBus for ResultHeader {
    const NAME: &'static str = "GantryResultHeader";
}
impl OnBus for RequestHeader {
    const NAME: &'static str = "GantryRequestHeader";
}
impl OnBus for SceneHeader {
    const NAME: &'static str = "GantrySceneHeader";
}
impl OnBus for RenderedRecord {
    const NAME: &'static str = "GantryRendered";
}
impl OnBus for AckRecord {
    const NAME: &'static str = "GantryAck";
}
impl OnBus for CompleteRecord {
    const NAME: &'static str = "GantryComplete";
}

/// A header or record as iceoryx2 sees it.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub struct Wire<H>(pub H);

impl<H: OnBus> Default for Wire<H> {
    fn default() -> Self {
        Wire(bytemuck::Zeroable::zeroed())
    }
}

// SAFETY: `ZeroCopySend` asks for a type that is self-contained, has a uniform layout in every
// process and no drop. `OnBus` implies `Pod`: `repr(C)` or `repr(transparent)`, no pointers, no
// padding, any bit pattern valid, `Copy` hence no drop; `repr(transparent)` passes all of that on.
// The name is unique per type in the list above.
unsafe impl<H: OnBus> ZeroCopySend for Wire<H> {
    unsafe fn type_name() -> &'static str {
        H::NAME
    }
}
