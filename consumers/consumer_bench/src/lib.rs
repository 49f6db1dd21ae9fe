//! `gantry-bench`: how long a frame takes from its writer to its reader, what a running simulator
//! delivers, which processes grow, and how well and how soon programs perceive.
//!
//! Every figure comes from real processes and is printed with p50, p99, p99.9 and the maximum,
//! beside the number of lost frames.

#![forbid(unsafe_code)]

mod ages;
mod chain;
mod latency;
mod lockstep;
mod memory;
mod output;
mod pages;
mod part;
mod tick;
mod topics;
mod wakes;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use launch_cli::args::DEFAULT_DOMAIN;
use launch_cli::{BasicArgs, DomainArgs};

const EXAMPLES: &str = "Examples:
  gantry-bench latency                                    all sizes, 1 and 8 readers, beside TCP and memcpy
  gantry-bench latency --sizes 1920000 --readers 1 --rate 200 --count 5000 --json latency.json
  gantry-bench wakes                                      what waking readers costs a writer
  gantry-bench ages --each 20s                            age of quick sensors while cameras render
  gantry-bench chain                                      camera → a → b → c: what each process adds
  gantry-bench lockstep                                   ticks per second with 1 to 8 participants
  gantry-bench topics --for 30s                           what the running simulator delivers
  gantry-bench tick --profile                             what a tick costs, stage by stage
  gantry-bench perception launch/bench/smoke.toml -- python my_detector.py
  gantry-bench reaction launch/bench/reaction.toml        from the first visible pixel to the brake
  gantry-bench compare A.json B.json                      what changed between two reports beyond noise
  gantry-bench verify report.json                         whether its frames are made again
  gantry-bench memory --pids 1200,1204 --for 10m --every 5s
  gantry-bench report                                     tables of docs/benchmarks from their JSON";

/// Measures latency, topics and memory with real processes, and scores programs that perceive
#[derive(Debug, Parser)]
#[command(name = "gantry-bench", version, about, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    basic: BasicArgs,
    #[command(subcommand)]
    command: Bench,
}

/// A benchmark that meets others on the bus; all others have a domain of their own, or none.
#[derive(Debug, clap::Args)]
struct OnDomain<T: clap::Args> {
    #[command(flatten)]
    args: T,
    #[command(flatten)]
    on: DomainArgs,
}

#[derive(Debug, Subcommand)]
enum Bench {
    /// Publish → another process holds the frame, through shared memory, beside loopback TCP and a
    /// memcpy
    Latency(latency::LatencyArgs),
    /// What it costs a writer to wake its readers, by the rig's event or by each topic's own
    Wakes(wakes::WakesArgs),
    /// Age of quick sensors' frames in a reader's hand while a running simulator renders
    Ages(OnDomain<ages::AgesArgs>),
    /// A pipeline of processes that hand an image on: what each hop adds, asleep and polled
    Chain(chain::ChainArgs),
    /// Ticks per second of a simulator that waits for programs in lockstep
    Lockstep(lockstep::LockstepArgs),
    /// Rate, losses, age and complete sets of every topic of frames and results
    Topics(OnDomain<topics::TopicsArgs>),
    /// Processor time that a tick of the running simulator takes, by process and stage
    Tick(OnDomain<tick::TickArgs>),
    /// How long a chain of programs takes from the first visible pixel of an obstacle to its brake
    Reaction(consumer_perception::reaction::ReactionArgs),
    /// Latency and accuracy of programs that perceive, against exact truth
    Perception(Box<consumer_perception::cli::PerceptionArgs>),
    /// What changed between two reports of the perception benchmark beyond noise
    Compare(consumer_perception::compare::CompareArgs),
    /// Makes the frames of a report of the perception benchmark again, and compares them
    Verify(consumer_perception::cli::verify::VerifyArgs),
    /// Tables and page of a report of the perception benchmark again
    Show(consumer_perception::show::ShowArgs),
    /// Memory of processes over time
    Memory(memory::MemoryArgs),
    /// Builds the tables of docs/benchmarks from the results in raw/
    Report(pages::ReportArgs),
    /// One reader of `latency`, started by it
    #[command(hide = true)]
    LatencyReader(OnDomain<latency::reader::ReaderArgs>),
    /// One process of `chain`, started by it
    #[command(hide = true)]
    ChainLink(OnDomain<chain::LinkArgs>),
    /// One participant of `lockstep`, started by it
    #[command(hide = true)]
    LockstepParticipant(OnDomain<lockstep::ParticipantArgs>),
    /// One reader of `wakes` and `ages`, started by them
    #[command(hide = true)]
    WakeReader(OnDomain<wakes::reader::WakeReaderArgs>),
}

/// The program `gantry-bench`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    launch_cli::run(|args: Args| {
        args.basic.init_logging();
        // The benchmarks of programs have a domain of their own for every run.
        let common = args.basic.on(DEFAULT_DOMAIN);
        match &args.command {
            Bench::Latency(latency) => latency::run(latency),
            Bench::Wakes(wakes) => wakes::run(wakes),
            Bench::Ages(OnDomain { args, on }) => ages::run(args, &on.domain),
            Bench::Chain(chain) => chain::run(chain),
            Bench::ChainLink(OnDomain { args, on }) => chain::link(args, &on.domain),
            Bench::Lockstep(lockstep) => lockstep::run(lockstep),
            Bench::LockstepParticipant(OnDomain { args, on }) => {
                lockstep::participant(args, &on.domain)
            }
            Bench::WakeReader(OnDomain { args, on }) => wakes::reader::run(args, &on.domain),
            Bench::Topics(OnDomain { args, on }) => topics::run(args, &on.domain),
            Bench::Tick(OnDomain { args, on }) => tick::run(args, &on.domain),
            Bench::Perception(perception) => consumer_perception::cli::run(perception, &common),
            Bench::Reaction(reaction) => consumer_perception::reaction::run(reaction, &common),
            Bench::Compare(compare) => consumer_perception::compare::run(compare, common.color),
            Bench::Show(show) => consumer_perception::show::run(show, common.color),
            Bench::Verify(verify) => consumer_perception::cli::verify::run(verify),
            Bench::Memory(memory) => memory::run(memory),
            Bench::Report(report) => pages::run(report),
            Bench::LatencyReader(OnDomain { args, on }) => latency::reader::run(args, &on.domain),
        }
    })
}
