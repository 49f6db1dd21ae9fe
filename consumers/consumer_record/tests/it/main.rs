//! Tests of `consumer_record`: one program for all of them, so that it is linked once.

mod files;
mod live;
mod oracle;
mod results;
mod sample;
mod stored;
mod video;
