//! Tests of `consumer_driver`: one program for all of them, so that it is linked once.

mod parameters;
mod traffic;
