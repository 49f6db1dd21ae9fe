//! Tests of `schema_roads`: one program for all of them, so that it is linked once.

mod common;
mod fuzz;
mod small_maps;
