//! Tests of `test_render`: one program for all of them, so that it is linked once.

mod exact_random;
mod exact_towns;
mod lamps;
mod lens_colour;
mod tiles;
mod triangles;
mod weather;
