//! Tests of `schema_recording`: one program for all of them, so that it is linked once.

mod codec;
mod read;
mod write;
