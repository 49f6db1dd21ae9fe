//! Tests of `consumer_c`: one program for all of them, so that it is linked once.

mod compiler;
mod header;
mod programs;
