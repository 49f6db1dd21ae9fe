//! `gantry-record`
fn main() {}
