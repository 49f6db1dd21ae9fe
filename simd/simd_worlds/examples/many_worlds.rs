//! Steps many worlds with a driver of a few lines, says how its episodes ended, and measures steps,
//! resets and forks a second of processor time on two threads.
//!
//! `cargo run --release -p simd_worlds --example many_worlds [-- --worlds N] [--steps N] [--json
//! FILE]`; results are in `docs/benchmarks/worlds.md`.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use launch_cli::bench::{self, BenchResult, anyhow};
use simd_worlds::{Autoreset, Course, INFO_NAMES, Outputs, STATE_NAMES, Task, Worlds};

/// Arguments of this bench.
#[derive(Parser, Debug)]
struct Args {
    /// Number of worlds.
    #[arg(long, default_value_t = 256)]
    worlds: usize,
    /// Steps of each world.
    #[arg(long, default_value_t = 500)]
    steps: usize,
    /// Threads.
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

/// Steers towards the way 10 m ahead, holds the limit, and brakes so as to stop 5 m before an
/// obstacle that is on the lane or comes to it.
fn drive(state: &[f32]) -> [f32; 2] {
    let (speed_mps, limit_mps) = (30.0 * state[3], 30.0 * state[4]);
    let steer = (1.6 * state[9]).clamp(-1.0, 1.0);
    let mut pedal = (0.5 * (limit_mps - speed_mps)).clamp(-1.0, 0.7);
    let (offset, to_left) = (state[15], state[17]);
    let comes = offset.abs() < 1.0 || offset * to_left < 0.0;
    if state[13] > 0.5 && state[14] > -0.02 && comes {
        let gap_m = (100.0 * state[14] - 5.0).max(0.1);
        let its_mps = (30.0 * state[16]).max(0.0);
        let needed_mps2 = (speed_mps * speed_mps - its_mps * its_mps) / (2.0 * gap_m);
        if its_mps < 1.0 && gap_m < 3.0 {
            pedal = -1.0;
        } else if needed_mps2 > 2.5 {
            pedal = -(needed_mps2 / 8.0).clamp(0.0, 1.0);
        }
    }
    [steer, pedal]
}

fn actions(outputs: &Outputs, into: &mut Vec<f32>) {
    into.clear();
    into.extend(outputs.state.chunks(STATE_NAMES.len()).flat_map(drive));
}

fn main() -> ExitCode {
    bench::run("many_worlds", |args: &Args, result| measure(args, result))
}

fn measure(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    for name in Task::names() {
        let course = Arc::new(Course::new(Task::built_in(name)?, 1)?);
        let mut worlds = Worlds::new(course, args.worlds, args.threads, Autoreset::SameStep)?;
        worlds.reset_all(1)?;
        let mut wanted = Vec::new();
        let (mut n_ended, mut sums, mut reward) = (0, [0.0; INFO_NAMES.len()], 0.0);
        let begin = Instant::now();
        for _ in 0..args.steps {
            actions(worlds.outputs(), &mut wanted);
            worlds.step(&wanted)?;
            let out = worlds.outputs();
            reward += out.reward.iter().map(|x| f64::from(*x)).sum::<f64>();
            let ended = out.terminated.iter().zip(&out.truncated);
            for (row, _) in out
                .info
                .chunks(INFO_NAMES.len())
                .zip(ended)
                .filter(|(_, (end, cut))| **end || **cut)
            {
                n_ended += 1;
                let columns = sums.iter_mut().zip(row);
                columns.for_each(|(sum, value)| *sum += f64::from(*value));
            }
        }
        let n_steps = (args.worlds * args.steps) as f64;
        let steps_per_sec = n_steps / begin.elapsed().as_secs_f64();
        let (mask, seeds) = (
            vec![true; args.worlds],
            (0..args.worlds as u64).collect::<Vec<_>>(),
        );
        let n_rounds = 20;
        let begin = Instant::now();
        for _ in 0..n_rounds {
            worlds.reset(&mask, &seeds)?;
        }
        let each = (n_rounds * args.worlds) as f64;
        let resets_per_sec = each / begin.elapsed().as_secs_f64();
        let all: Vec<usize> = (0..args.worlds).collect();
        let begin = Instant::now();
        for _ in 0..n_rounds {
            worlds.fork(0, &all)?;
        }
        let forks_per_sec = each / begin.elapsed().as_secs_f64();
        println!(
            "{name}: {steps_per_sec:.0} steps/s, {resets_per_sec:.0} resets/s, {forks_per_sec:.0} forks/s; {n_ended} episodes ended, mean reward of a step {:.3}",
            reward / n_steps
        );
        for (of, sum) in INFO_NAMES.iter().zip(sums) {
            println!(
                "  {of}, mean at the end: {:.3}",
                sum / f64::from(n_ended.max(1))
            );
        }
        result.row(
            name,
            &[
                ("worlds", args.worlds as f64),
                ("threads", args.threads as f64),
                ("steps_per_sec", steps_per_sec),
                ("resets_per_sec", resets_per_sec),
                ("forks_per_sec", forks_per_sec),
            ],
        );
    }
    Ok(())
}
