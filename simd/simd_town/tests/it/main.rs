//! Tests of `simd_town`: one program for all of them, so that it is linked once.

mod characters;
mod clear_lanes;
mod guide;
mod imported;
mod kerbs;
mod lines;
mod parked_cars;
mod scenery;
mod town;
