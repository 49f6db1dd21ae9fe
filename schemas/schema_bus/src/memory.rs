//! Shared memory: how much topics need, whose files it is in, how its pages are reserved, and what
//! happens where there is none left.

pub(crate) mod leftovers;
pub(crate) mod reserve;
pub(crate) mod root;
pub(crate) mod segment;
pub(crate) mod segment_files;
pub(crate) mod shortage;
pub(crate) mod sizes;
