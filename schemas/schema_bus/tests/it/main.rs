//! Tests of `schema_bus`: one program for all of them, so that it is linked once.

mod bus;
mod connections;
mod hostile;
mod listeners;
mod looking;
mod place;
mod results;
