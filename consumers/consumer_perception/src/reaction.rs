//! Reaction time, live: how long a chain of programs takes from the first pixel that could show an
//! obstacle to the first correct result of each of its processes and to the brake.
//!
//! The chain runs with the simulator in real time, started by `gantry up` in a domain of its own. A
//! trial goes back to one checkpoint, waits for a random time, and lets something happen: a person
//! steps out, a car cuts in or brakes, a light turns red. A camera that sees labels and colours from
//! the place of the chain's sensor says which tick shows it first; that is the stimulus, and time
//! runs from the moment at which the world was in that state. The benchmark only watches the bus, so
//! the programs are those that run anywhere else.
//!
//! In reading order: [`suite`] (what is asked), [`scene`] and [`steering`] (what happens), [`visible`]
//! (when it shows), [`stage`] (what is correct), [`observer`], [`session`] and [`trial`] (how it is
//! measured), [`summary`] and [`output`] (what is said).

use std::path::PathBuf;
use std::time::{Instant, SystemTime};

use anyhow::{Context as _, bail};
use indicatif::{ProgressBar, ProgressStyle};
use launch_cli::{CommonArgs, Exit, Machine, Shutdown};
use serde_json::json;

pub mod observer;
pub mod output;
pub mod scene;
pub mod session;
pub mod stage;
pub mod steering;
pub mod suite;
pub mod summary;
pub mod trial;
pub mod visible;

use scene::Plan;
use session::{Chain, Session};
use suite::{Kind, Suite};
use summary::{REACTION_VERSION, Reactions, Trial};
use trial::Ended;

/// Starts in a row after which the processes are given up.
const MAX_STARTS: u32 = 3;
/// Trials after which the log says how far it is.
const SAY_EVERY: usize = 25;
/// Pace below which wall times say little about a car, simulated seconds per second.
const LEAST_PACE: f64 = 0.95;
/// Uncertainty of the time of a control from which on it is said, nanoseconds.
const COARSE_NANOS: u64 = 2_000_000;

/// Measures reaction times of a chain of programs.
#[derive(Clone, Debug, clap::Args)]
pub struct ReactionArgs {
    /// Suite: launch files of the chain, kinds of trials, and what a correct result is
    #[arg(value_name = "SUITE.toml")]
    pub suite: PathBuf,

    /// Trials of each kind, in place of the suite's numbers
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(suite::MAX_TRIALS)))]
    pub trials: Option<u32>,

    /// Seed, in place of the suite's
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,

    /// Folder for reaction.json, the page and the distributions
    #[arg(long, value_name = "DIR", default_value = "reaction")]
    pub out: PathBuf,

    /// A program that is started beside those of the launch files, with its words
    #[arg(last = true, value_name = "CMD")]
    pub command: Vec<String>,
}

/// Runs all trials of a suite, writes the report and prints its tables. Ctrl-C stops it and keeps
/// what is done.
///
/// # Errors
/// [`launch_cli::wrong_usage`] for a suite or launch file with mistakes; an error if the chain does
/// not run at all.
pub fn run(args: &ReactionArgs, _common: &CommonArgs) -> anyhow::Result<Exit> {
    let mut suite = Suite::read(&args.suite)?;
    suite.seed = args.seed.unwrap_or(suite.seed);
    if let Some(trials) = args.trials {
        suite.trials = trials;
        suite
            .kind
            .values_mut()
            .for_each(|it| it.trials = it.trials.filter(|n| *n == 0));
    }
    let chain = Chain::read(&suite, &args.command)?;
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    let shutdown = Shutdown::install()?;
    let machine = Machine::read();
    println!("{}", machine.heading());
    let began = Instant::now();
    let began_unix_secs = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0, |it| it.as_secs());
    let mut runner = Runner {
        suite: &suite,
        chain: &chain,
        args,
        session: None,
        n_sessions: 0,
        remarks: Vec::new(),
    };
    let trials = runner.trials(&|| shutdown.requested())?;
    drop(runner.session.take());
    let reactions = Reactions {
        version: REACTION_VERSION,
        command: args.command.clone(),
        machine: json!(machine),
        began_unix_secs,
        took_secs: began.elapsed().as_secs_f64(),
        stopped: shutdown.requested(),
        kinds: summary::kinds(&trials),
        warnings: warnings(&trials, runner.remarks, chain.tick_secs),
        trials,
        suite: suite.clone(),
    };
    output::write(&reactions, &args.out)?;
    print!("{}", output::terminal(&reactions));
    println!("{}", args.out.join("reaction.html").display());
    match reactions.kinds.iter().any(|kind| kind.n_counted > 0) {
        true => Ok(Exit::Done),
        false if reactions.stopped => Ok(Exit::Done),
        false => Ok(Exit::Failed),
    }
}

/// Runs trial after trial, and starts the processes again if they are lost.
struct Runner<'a> {
    suite: &'a Suite,
    chain: &'a Chain,
    args: &'a ReactionArgs,
    session: Option<Session>,
    n_sessions: u32,
    remarks: Vec<String>,
}

impl Runner<'_> {
    fn trials(&mut self, stop: &dyn Fn() -> bool) -> anyhow::Result<Vec<Trial>> {
        let suite = self.suite;
        let plans: Vec<Plan> = Kind::ALL
            .into_iter()
            .flat_map(|kind| (0..suite.n_trials(kind)).map(move |n| (kind, n)))
            .map(|(kind, number)| Plan::draw(suite, kind, number))
            .collect();
        let bar = ProgressBar::new(plans.len() as u64);
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} trials, {eta} left {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let mut trials = Vec::with_capacity(plans.len());
        let mut n_lost = 0;
        for plan in &plans {
            let session = match self.started(stop) {
                Ok(session) => session,
                Err(_) if stop() => break,
                // Without a single trial there is nothing that could be kept.
                Err(error) if trials.is_empty() => return Err(error),
                Err(error) => {
                    self.remarks
                        .push(format!("the trials ended early: {error:#}"));
                    break;
                }
            };
            let ended = trial::run(session, suite, plan, stop);
            if stop() {
                break;
            }
            let (trial, is_lost) = match ended {
                Ended::Over(trial) => (trial, false),
                Ended::Lost(trial) => (trial, true),
            };
            if let Some(reason) = &trial.failed {
                tracing::warn!(
                    kind = plan.kind.name(),
                    number = plan.number,
                    "a trial failed: {reason}"
                );
            }
            n_lost = if is_lost { n_lost + 1 } else { 0 };
            trials.push(*trial);
            bar.inc(1);
            // Without a terminal there is no bar.
            if bar.is_hidden() && trials.len().is_multiple_of(SAY_EVERY) {
                tracing::info!(of = plans.len(), "{} trials are done", trials.len());
            }
            if is_lost {
                self.end_session();
            }
            if n_lost >= MAX_STARTS {
                self.remarks.push(format!(
                    "the trials ended early: the processes were lost {MAX_STARTS} times in a row"
                ));
                break;
            }
        }
        self.end_session();
        bar.finish_and_clear();
        Ok(trials)
    }

    /// The session, started if there is none.
    fn started(&mut self, stop: &dyn Fn() -> bool) -> anyhow::Result<&mut Session> {
        if self.session.is_none() {
            let mut last = None;
            // A chain that never ran has a mistake that no further attempt will mend.
            let attempts = if self.n_sessions == 0 { 1 } else { MAX_STARTS };
            for _ in 0..attempts {
                self.n_sessions += 1;
                let number = self.n_sessions;
                let domain = launch_run::domain_name("bench");
                let folder = self.args.out.join(format!("processes/{number}"));
                tracing::info!(%domain, "starting the chain");
                match Session::start(self.chain, self.suite, &folder, &domain, stop) {
                    Ok(session) => {
                        self.session = Some(session);
                        break;
                    }
                    Err(error) if stop() => return Err(error),
                    Err(error) if error.is::<launch_cli::WrongUsage>() => return Err(error),
                    Err(error) if attempts == 1 => return Err(error),
                    Err(error) => {
                        tracing::warn!("the chain did not start: {error:#}");
                        last = Some(error);
                    }
                }
            }
            if let (None, Some(error)) = (&self.session, last) {
                return Err(error);
            }
        }
        match &mut self.session {
            Some(session) => Ok(session),
            None => bail!("the chain did not start"),
        }
    }

    fn end_session(&mut self) {
        if let Some(session) = self.session.take() {
            self.remarks
                .extend(session.observer.remarks.iter().cloned());
        }
    }
}

/// What a reader must know before believing the figures.
fn warnings(trials: &[Trial], mut remarks: Vec<String>, tick_secs: f64) -> Vec<String> {
    remarks.sort();
    remarks.dedup();
    let stimuli: Vec<_> = trials.iter().filter_map(|trial| trial.stimulus).collect();
    let slow = stimuli.iter().filter(|it| it.pace < LEAST_PACE).count();
    if slow > 0 {
        let least = stimuli
            .iter()
            .map(|it| it.pace)
            .fold(f64::INFINITY, f64::min);
        remarks.push(format!(
            "in {slow} of {} trials the simulator ran slower than real time (down to {least:.2}): look at the simulated times, or take a smaller rig",
            stimuli.len()
        ));
    }
    let reactions = trials
        .iter()
        .flat_map(|trial| &trial.stages)
        .filter_map(|stage| stage.reaction);
    let coarse: Vec<u64> = reactions
        .map(|it| it.within_nanos)
        .filter(|nanos| *nanos > COARSE_NANOS)
        .collect();
    if let Some(worst) = coarse.iter().max() {
        remarks.push(format!(
            "{} controls were timed to more than {} ms only (the worst to {:.1} ms), because the benchmark itself had to wait for a processor",
            coarse.len(),
            COARSE_NANOS / 1_000_000,
            *worst as f64 * 1e-6
        ));
    }
    let unseen = stimuli.iter().filter(|it| it.unseen_ticks > 0).count();
    if unseen > 0 {
        let most = stimuli.iter().map(|it| it.unseen_ticks).max().unwrap_or(0);
        remarks.push(format!(
            "in {unseen} of {} trials the truth camera lost images before the stimulus, which may have been up to {most} ticks ({:.0} ms) earlier",
            stimuli.len(),
            most as f64 * tick_secs * 1e3
        ));
    }
    remarks
}
