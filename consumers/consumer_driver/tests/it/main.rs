//! Tests of `consumer_driver`: one program for all of them, so that it is linked once.

mod junction_map;
mod parameters;
mod right_of_way;
mod traffic;
