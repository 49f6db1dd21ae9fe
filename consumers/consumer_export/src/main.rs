//! `gantry-export`: writes training sets from recordings.

fn main() {}
