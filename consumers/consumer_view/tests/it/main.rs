//! Tests of `consumer_view`: one program for all of them, so that it is linked once.

mod live;
mod results;
