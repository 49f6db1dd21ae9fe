//! Tests of `consumer_gpu`: one program for all of them, so that it is linked once.

mod batches;
mod common;
mod cuda;
mod frames;
mod moves;
mod results;
