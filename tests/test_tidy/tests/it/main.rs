//! Tests of `test_tidy`: one program for all of them, so that it is linked once.

mod dependencies;
mod foreign_files;
mod limits;
mod pages;
mod rooms;
mod tidy;
