//! Tests of `gantry`: one program for all of them, so that it is linked once.

mod help;
mod look;
mod new;
mod own_programs;
mod screen;
mod supervise;
