//! `libgantry.so`: the ports of `schema_bus` and the lockstep and snapshots of `consumer_kit` for
//! programs in C and C++.
//!
//! The public interface is `include/gantry/gantry.h`, which says units, ownership, errors and
//! threads of every function, and `include/gantry/gantry.hpp` on top of it. Layouts of frames and
//! results are in `include/gantry/layout.h`, which a test of `schema_frames` makes from the Rust
//! types. Like the Python package, this crate holds no rules of its own: what is checked, counted
//! and waited for is what every Rust consumer does.
//!
//! A handle of C is a box, and functions take it as `Option<&mut T>` or `Option<Box<T>>`, of which C
//! sees a pointer that may be null. No panic crosses the border: [`border::call`] catches it.
//!
//! Modules in reading order: `border`, `wait`, `place` (a domain, its commands and documents),
//! `read`, `publish`, `world`, `lockstep` and `control`.

#![warn(missing_docs)]
#![expect(
    unsafe_code,
    reason = "names that C finds, and the texts and lists that it hands over; each block proves itself"
)]

mod border;
mod control;
mod lockstep;
mod place;
mod publish;
mod read;
mod wait;
mod world;
