//! Tests of `consumer_kit`: one program for all of them, so that it is linked once.

mod follow;
mod place;
mod program;
