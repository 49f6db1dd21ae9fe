//! The other process in tests of this crate: `gpu_child ROLE` on the bus that its parent names in the
//! environment. CUDA's driver is loaded once per process, so that every reader and writer on a GPU is
//! one of its own, and some are killed.

#![expect(
    unsafe_code,
    reason = "addresses of the driver for tests are those of this process"
)]

#[path = "../../tests/it/common.rs"]
mod common;
mod frames;
mod results;

use schema_bus::Bus;

/// A role's name and what a child in it does.
type Role = (&'static str, fn(&Bus));

const ROLES: [Role; 20] = [
    ("read_frames", frames::read_frames),
    ("read_batch", frames::read_batch),
    ("compare", frames::compare),
    ("compare_batch", frames::compare_batch),
    ("drop_early", frames::drop_early),
    ("upload_frames", frames::upload_frames),
    ("lack_cuda", frames::lack_cuda),
    ("follow", frames::follow),
    ("publish", results::publish),
    ("read_results", results::read_results),
    ("hold", results::hold),
    ("grow", results::grow),
    ("read_all", results::read_all),
    ("lend", results::lend),
    ("read_whole", results::read_whole),
    ("chain", results::chain),
    ("upload_results", results::upload_results),
    ("publish_on_host", results::publish_on_host),
    ("lack_room", results::lack_room),
    ("be_refused", results::be_refused),
];

fn main() {
    let wanted = std::env::args().nth(1).unwrap_or_default();
    let Some((_, run)) = ROLES.iter().find(|(role, _)| *role == wanted) else {
        panic!(
            "there is no role {wanted:?}; roles: {:?}",
            ROLES.map(|(role, _)| role)
        );
    };
    run(&common::parents_bus());
}
