//! Runs: processes on a domain of their own, from their start to their end.
//!
//! The launcher, data sets, the benchmark and reruns all start Gantry's programs, wait for them,
//! step them and end them. What they share is here; what they measure or write is theirs.
//!
//! - A **private domain** ([`PrivateDomain`]) is a place in which processes meet nobody else: a
//!   domain name, a prefix of files in shared memory, and a temporary folder that holds iceoryx2's
//!   bookkeeping and is the processes' working folder. Dropped, it removes all three. A program that
//!   wants the machine's shared bus and only a free name asks [`domain_name`].
//! - A **program** ([`Program`]) says what is started: file, words, folder, variables, cores,
//!   priority, and what becomes of it if the process that starts it dies.
//! - A **process** ([`Process`]) runs. Its lines go into a log, to the terminal, or are collected.
//!   It is asked to end by the signals of its [`Ending`] in turn, each with its time, then it is
//!   killed; so it is when it is dropped. A process that ended too early is a [`RunError`] with its
//!   last lines.
//! - A **run** ([`Run`]) is a domain with its processes. They end in the reverse of the order in
//!   which they began, so readers end before what they read, and the domain after all of them. A
//!   [`register`] lets the next run clear what a killed one left behind.
//! - **Waits** ([`Watch`]) are for a condition, a document or a printed line. Every wait looks after
//!   the processes and the user's wish to stop, and has a limit.
//! - **Steps** ([`steps`]) let a simulator that waits for its cues pass ticks, and [`take`] is a
//!   whole recording: ticks before it, the recorder's place in lockstep, the ticks that are kept.
//! - **Launched processes** ([`Launched`]) are those of a launch file under `gantry up`. What the
//!   launcher does to them it writes as [`Note`]s into the folder of its run, one JSON object per
//!   line; nobody reads its log.
//! - A **matrix** ([`matrix`]) is the combinations of scenarios that shall run, with their names.
//!
//! In reading order: [`error`], [`domain`], [`program`], [`process`], [`register`], [`watch`],
//! [`run`], [`steps`], [`take`], [`notes`], [`launched`], [`matrix`].

#![warn(missing_docs)]

pub mod domain;
pub mod error;
pub mod launched;
pub mod matrix;
pub mod notes;
pub mod process;
pub mod program;
pub mod register;
pub mod run;
pub mod steps;
pub mod take;
pub mod watch;

pub use domain::{Naming, PrivateDomain, domain_name};
pub use error::{RunError, is_stopped};
pub use launched::Launched;
pub use notes::{NOTES, Note, NoteReader, NoteWriter};
pub use process::{Ending, Process};
pub use program::{Output, Program};
pub use run::Run;
pub use take::{Take, take};
pub use watch::{Watch, Watched};
