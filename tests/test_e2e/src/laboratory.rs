//! A laboratory for faults: real processes, struck by signals at chosen moments, at random from a
//! seed.
//!
//! An episode begins a simulator with all of its company ([`cast`]), strikes it several times and
//! ends it. Which process is struck, by which signal and at which moment ([`table`]), follows from the
//! episode's seed alone; a process is stopped at its moment by watching the system calls of one of
//! its threads ([`strike`]). After every fault the laboratory asks what must hold whoever dies
//! ([`episode`]); what does not hold is a [`Violation`], which names the seed and the step.
//!
//! In reading order: [`table`], [`strike`], [`cast`], [`episode`], [`repeatable`], [`shared`].

pub mod cast;
pub mod episode;
pub mod repeatable;
pub mod shared;
pub mod strike;
pub mod table;

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

pub use table::{Count, Tally};

/// Something that must hold and did not.
#[derive(Debug)]
pub struct Violation {
    /// Seed of the episode.
    pub seed: u64,
    /// Steps of the episode until then, with their faults.
    pub story: Vec<String>,
    /// What did not hold.
    pub sentence: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "violation in episode {}, step {}; repeat it with: ./gantry soak --faults --seed {} --episodes 1",
            self.seed,
            self.story.len(),
            self.seed
        )?;
        for (n, step) in self.story.iter().enumerate() {
            writeln!(f, "  step {}: {step}", n + 1)?;
        }
        write!(f, "  {}", self.sentence)
    }
}

/// Runs one episode of `n_steps` faults.
///
/// # Errors
/// With what did not hold.
pub fn run_episode(seed: u64, n_steps: usize, tally: &mut Tally) -> Result<(), Violation> {
    let mut story = Vec::new();
    let outcome = catch_unwind(AssertUnwindSafe(|| match seed % 8 {
        7 => repeatable::run(seed, n_steps, &mut story, tally),
        6 => shared::run(seed, n_steps, &mut story, tally),
        _ => episode::run(seed, n_steps, &mut story, tally),
    }));
    tally.n_episodes += 1;
    outcome.map_err(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        Violation {
            seed,
            story,
            sentence: text.unwrap_or_else(|| "a panic without words".into()),
        }
    })
}
