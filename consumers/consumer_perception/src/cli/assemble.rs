//! Puts a report together: what was shown, what the processes used, where it ran, and what a reader
//! must know before believing a figure.

use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

use launch_cli::Machine as ThisMachine;
use schema_frames::Modality;

use crate::capture::{Capture, Mode, Usage};
use crate::report::{Machine, ProcessUsage, REPORT_VERSION, Report, Run, ScenarioInfo, suite_hash};
use crate::run::{Options, Source};
use crate::suite::Suite;
use crate::truth_pass::TruthRecording;

/// How far the pace may be off before it is said.
const PACE_SLACK: f64 = 0.02;
/// Share of the processors that may be busy with other things before it is said.
const BUSY_SHARE: f64 = 0.25;

/// What tells runs apart: program, mode and speed.
type Key = (String, Mode, u64);

/// A report in the making.
#[derive(Debug)]
pub struct Assembly<'a> {
    suite: &'a Suite,
    source: Source,
    began: SystemTime,
    machine: ThisMachine,
    scenarios: Vec<ScenarioInfo>,
    adapter: String,
    used: BTreeMap<Key, BTreeMap<String, Used>>,
    faults: BTreeMap<Key, Vec<String>>,
    warnings: Vec<String>,
    /// Inputs that are truth on purpose.
    given_truth: Vec<String>,
    has_crash: bool,
}

/// What a process used in all scenarios.
#[derive(Clone, Copy, Debug, Default)]
struct Used {
    cpu_secs: f64,
    wall_secs: f64,
    peak_bytes: u64,
}

impl<'a> Assembly<'a> {
    /// Nothing was shown yet.
    pub fn new(suite: &'a Suite, source: Source, began: SystemTime) -> Assembly<'a> {
        Assembly {
            suite,
            source,
            began,
            machine: ThisMachine::read(),
            scenarios: Vec::new(),
            adapter: String::new(),
            used: BTreeMap::new(),
            faults: BTreeMap::new(),
            warnings: Vec::new(),
            given_truth: Vec::new(),
            has_crash: false,
        }
    }

    /// A scenario, and all runs in it.
    pub fn add(&mut self, truth: &TruthRecording, captures: &[Capture]) {
        self.adapter.clone_from(&truth.adapter);
        for input in &truth.inputs {
            // Results of the suite's own programs have no sensor.
            let is_given = input.sensor.is_empty()
                || is_truth(&input.topic)
                || self.suite.exact_inputs.contains(&input.topic);
            if is_given && !self.given_truth.contains(&input.topic) {
                self.given_truth.push(input.topic.clone());
            }
        }
        self.scenarios.push(ScenarioInfo {
            name: truth.scenario.name.clone(),
            settings: truth.scenario.settings(),
            secs: truth.end_nanos.saturating_sub(truth.scored_from_nanos) as f64 * 1e-9,
            frames_hash: truth.frames_hash.clone(),
            query_hz: self.suite.query_hz,
        });
        for capture in captures {
            self.has_crash |= capture.has_crashed;
            let key = (
                capture.program.clone(),
                capture.mode,
                capture.speed.to_bits(),
            );
            let faults = self.faults.entry(key.clone()).or_default();
            let sentences = capture.faults.iter();
            faults.extend(sentences.map(|what| format!("{}: {what}", capture.scenario)));
            let of_run = self.used.entry(key).or_default();
            for (process, used) in used(capture) {
                let all = of_run.entry(process).or_default();
                all.cpu_secs += used.cpu_secs;
                all.wall_secs += used.wall_secs;
                all.peak_bytes = all.peak_bytes.max(used.peak_bytes);
            }
            if let (Mode::Streaming, Some(pace)) = (capture.mode, capture.clock.pace())
                && (pace / capture.speed - 1.0).abs() > PACE_SLACK
            {
                self.warnings.push(format!(
                    "{} in {}: frames came at {:.2} of real time and not at {}; this machine is too slow or too busy for it",
                    capture.program, capture.scenario, pace, capture.speed
                ));
            }
        }
    }

    /// The report.
    pub fn report(mut self, mut runs: Vec<Run>, options: &Options, build: &str) -> Report {
        let load = self.machine.load_1min.parse().unwrap_or(0.0);
        if load > BUSY_SHARE * self.machine.n_cores as f64 {
            self.warnings.insert(
                0,
                format!(
                    "the machine was busy when this began: load {load} on {} processors",
                    self.machine.n_cores
                ),
            );
        }
        for run in &mut runs {
            self.fill(run, options);
        }
        let suite = self.suite;
        Report {
            version: REPORT_VERSION,
            suite: suite.name.clone(),
            suite_hash: suite_hash(&suite.text, build, suite.seed, suite.is_drawn),
            suite_text: self.suite.text.clone(),
            command: command(),
            settings: settings(self.source, options),
            build: build.to_owned(),
            seed: self.suite.seed,
            has_drawn_seed: self.suite.is_drawn,
            // Where programs drive, others drive beside them by the same snapshots.
            is_sealed: !self.suite.is_closed_loop(),
            given_truth: self.given_truth,
            has_crash: self.has_crash,
            training_maps: self.suite.matrix.training_maps.clone(),
            began: rfc3339(self.began),
            took_secs: self.began.elapsed().map_or(0.0, |took| took.as_secs_f64()),
            machine: Machine {
                cpu: self.machine.cpu.clone(),
                n_cpus: self.machine.n_cores,
                memory_bytes: memory_bytes(),
                adapter: self.adapter,
                kernel: self.machine.kernel.clone(),
                load,
            },
            scenarios: self.scenarios,
            runs,
            warnings: self.warnings,
        }
    }

    /// What only the benchmark knows about a run.
    fn fill(&self, run: &mut Run, options: &Options) {
        let program = self.suite.program(&run.program);
        let processes = program.map(|program| program.processes.as_slice());
        let processes = processes.unwrap_or_default();
        run.command = program.map(|program| program.command()).unwrap_or_default();
        let mut cores: Vec<u32> = processes.iter().flat_map(|it| it.cores.clone()).collect();
        if cores.is_empty() {
            cores.clone_from(&options.cores_program);
        }
        cores.sort_unstable();
        cores.dedup();
        run.cores = cores;
        run.nice = processes.iter().find_map(|process| process.nice);
        let key = (run.program.clone(), run.mode, run.speed.to_bits());
        let faults = self.faults.get(&key).cloned().unwrap_or_default();
        run.faults.splice(0..0, faults);
        let n_answered = run.counts.n_answered;
        let of_run = self.used.get(&key).cloned().unwrap_or_default();
        run.usage = of_run
            .into_iter()
            .map(|(process, used)| ProcessUsage {
                of_program: processes.iter().any(|it| it.name == process),
                process,
                cpu_cores: ratio(used.cpu_secs, used.wall_secs),
                cpu_ms_per_frame: ratio(used.cpu_secs * 1e3, n_answered as f64),
                peak_bytes: used.peak_bytes,
            })
            .collect();
    }
}

/// Whether an input is truth itself: an exact image.
fn is_truth(topic: &str) -> bool {
    let last = topic.rsplit('/').next().unwrap_or_default();
    matches!(
        Modality::from_name(last),
        Some(
            Modality::Depth
                | Modality::Semantic
                | Modality::Instance
                | Modality::Flow
                | Modality::Normals
        )
    )
}

/// The command as a user repeats it.
fn command() -> Vec<String> {
    let words = ["gantry", "bench"].map(str::to_owned).into_iter();
    words.chain(std::env::args().skip(1)).collect()
}

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

/// What each process used between the first and the last tick: starting does not count.
fn used(capture: &Capture) -> BTreeMap<String, Used> {
    let mut samples: BTreeMap<&str, Vec<&Usage>> = BTreeMap::new();
    for usage in &capture.usage {
        samples.entry(&usage.process).or_default().push(usage);
    }
    let begin = capture.clock.mono_span().map_or(0, |(begin, _)| begin);
    let of_process = |samples: Vec<&Usage>| {
        // The last look before the first tick.
        let at = samples.partition_point(|usage| usage.mono_nanos <= begin);
        let samples = &samples[at.saturating_sub(1)..];
        let (first, last) = (samples.first()?, samples.last()?);
        Some(Used {
            cpu_secs: (last.cpu_secs - first.cpu_secs).max(0.0),
            wall_secs: (last.mono_nanos - first.mono_nanos) as f64 * 1e-9,
            peak_bytes: samples.iter().map(|usage| usage.own_bytes).max()?,
        })
    };
    samples
        .into_iter()
        .filter_map(|(name, samples)| Some((name.to_owned(), of_process(samples)?)))
        .collect()
}

fn settings(source: Source, options: &Options) -> BTreeMap<String, String> {
    let cores = |cores: &[u32]| match cores {
        [] => "all".to_owned(),
        cores => {
            let words: Vec<String> = cores.iter().map(u32::to_string).collect();
            words.join(",")
        }
    };
    let mut settings = BTreeMap::new();
    let mut say = |key: &str, value: String| drop(settings.insert(key.to_owned(), value));
    let from = match source {
        Source::Replay => "recording",
        Source::Live => "live simulator",
    };
    say("source", from.into());
    say("world cores", cores(&options.cores_world));
    say("program cores", cores(&options.cores_program));
    if options.added_delay_nanos > 0 {
        let ms = options.added_delay_nanos as f64 * 1e-6;
        say("added delay", format!("{ms} ms"));
    }
    settings
}

/// Memory of the machine, bytes.
fn memory_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

/// `2026-01-31T23:59:59Z`.
fn rfc3339(time: SystemTime) -> String {
    let secs = time.duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs());
    let (days, of_day) = (secs / 86_400, secs % 86_400);
    // Years that begin in March, so that the day of a leap year is the last one.
    let mut day = days + 719_468;
    let cycle = day / 146_097;
    day %= 146_097;
    let year_of_cycle = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = cycle * 400 + year_of_cycle + u64::from(month <= 2);
    format!(
        "{year:04}-{month:02}-{day_of_month:02}T{:02}:{:02}:{:02}Z",
        of_day / 3600,
        of_day / 60 % 60,
        of_day % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn times_are_written_as_the_standard_says() {
        // From `date -u -d @SECS +%FT%TZ`.
        for (secs, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (1_735_689_599, "2024-12-31T23:59:59Z"),
        ] {
            assert_eq!(rfc3339(UNIX_EPOCH + Duration::from_secs(secs)), text);
        }
    }

    #[test]
    fn what_a_process_used_before_the_first_tick_does_not_count() {
        let mut capture = Capture {
            program: "quick".into(),
            scenario: "town".into(),
            mode: Mode::Streaming,
            speed: 1.0,
            added_delay_nanos: 0,
            clock: crate::capture::Clock::default(),
            results: Vec::new(),
            abouts: BTreeMap::new(),
            frames: Vec::new(),
            n_lost: 0,
            n_refused: 0,
            usage: Vec::new(),
            faults: Vec::new(),
            has_crashed: false,
            drive_recording: None,
        };
        const SEC: u64 = 1_000_000_000;
        capture.clock.push(0, 5 * SEC);
        capture.clock.push(SEC, 6 * SEC);
        for (at, cpu_secs) in [(1, 0.0), (4, 3.0), (6, 4.0)] {
            capture.usage.push(Usage {
                process: "quick".into(),
                mono_nanos: at * SEC,
                cpu_secs,
                own_bytes: at,
            });
        }
        let used = used(&capture)["quick"];
        assert_eq!(
            (used.cpu_secs, used.wall_secs, used.peak_bytes),
            (1.0, 2.0, 6)
        );
    }
}
