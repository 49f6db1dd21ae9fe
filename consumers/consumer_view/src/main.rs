//! `gantry-view`
fn main() {}
