//! The queues of a device: the one that draws, the one that copies, and the semaphores by which
//! they wait for each other.

mod copying;
mod drawing;
mod family;
mod raw_copy;
mod reads;
mod room;
mod timeline;

pub(crate) use copying::{CopyMarks, CopyQueue};
pub(crate) use drawing::DrawingQueue;
pub use family::CopyPath;
pub(crate) use family::{Family, MAX_QUEUES, family_for};
pub(crate) use raw_copy::{RawCopies, RawCopy, Release};
pub use reads::Reads;
pub use timeline::MAX_GPU_WAIT;
pub(crate) use timeline::{AWAKE, Moment, N_WAIT_SLICES, WAIT_SLICE, wait_for};
