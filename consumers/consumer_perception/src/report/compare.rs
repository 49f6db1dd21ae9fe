//! `gantry bench compare A.json B.json`: what changed beyond noise. Values are paired by scenario;
//! the interval of their mean difference comes from resampling scenarios.

mod change;
mod pairs;
mod text;

use std::path::PathBuf;

use anyhow::Context as _;
pub use consumer_report::interval::interval;
use launch_cli::values::number;
use launch_cli::{ColorWhen, Exit, wrong_usage};

use super::terminal;
use super::types::Report;
use super::write::read;
pub use change::{Change, Comparison, Verdict};
use pairs::Metric;

const EXAMPLES: &str = "Examples:
  gantry bench compare main/report.json branch/report.json
  gantry bench compare main branch --fail-on worse --at-least 0.02 --json changes.json
  gantry bench compare report.json report.json --as slow=fast      two programs of one report";

/// What changed between two reports beyond noise
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct CompareArgs {
    /// The report from before: report.json or its folder
    #[arg(value_name = "A.json")]
    pub a: PathBuf,

    /// The report that is compared with it
    #[arg(value_name = "B.json")]
    pub b: PathBuf,

    /// Compare program X of A with program Y of B; may be repeated
    #[arg(long = "as", value_name = "X=Y", value_parser = renamed)]
    pub renamed: Vec<(String, String)>,

    /// Compare reports of other suites, seeds, builds or frames too, by the names of scenarios
    #[arg(long)]
    pub any: bool,

    /// Every metric, not only those of the report's own tables
    #[arg(long)]
    pub all: bool,

    /// A change counts only from this share of A's value on, e.g. 0.02
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = number("share", 0.0..=10.0))]
    pub at_least: f64,

    /// Confidence of the intervals
    #[arg(long, value_name = "SHARE", default_value_t = 0.95, value_parser = number("confidence", 0.5..=0.9999))]
    pub confidence: f64,

    /// How often scenarios are drawn anew
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    pub resamples: u32,

    /// Seed of the drawing
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// End with exit code 1 if something got worse, or changed at all
    #[arg(long, value_name = "WHAT")]
    pub fail_on: Option<FailOn>,

    /// Write the comparison as JSON; - is stdout, in place of the table
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What ends a comparison with exit code 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum FailOn {
    /// Something got worse
    Worse,
    /// Something got better, worse, or changed in a direction that means neither
    Changed,
}

fn renamed(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((a, b)) if !a.is_empty() && !b.is_empty() => Ok((a.into(), b.into())),
        _ => Err(
            "write the name of a program of A, = and the name of one of B, such as slow=fast"
                .into(),
        ),
    }
}

/// Compares two reports and prints what changed.
///
/// # Errors
///
/// A file is no report, or the reports cannot be compared.
pub fn run(args: &CompareArgs, color: ColorWhen) -> anyhow::Result<Exit> {
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let comparison = compare(&a, &b, args)?;
    let is_json_only = args
        .json
        .as_deref()
        .is_some_and(|path| path.as_os_str() == "-");
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&comparison)? + "\n";
        if is_json_only {
            print!("{text}");
        } else {
            std::fs::write(path, text)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
    }
    if !is_json_only {
        print!("{}", text::text(&comparison, terminal::colours(color)));
    }
    let has = |verdicts: &[Verdict]| {
        comparison
            .changes
            .iter()
            .any(|it| verdicts.contains(&it.verdict))
    };
    let failed = match args.fail_on {
        None => false,
        Some(FailOn::Worse) => has(&[Verdict::Worse]),
        Some(FailOn::Changed) => has(&[Verdict::Worse, Verdict::Better, Verdict::Changed]),
    };
    Ok(if failed { Exit::Failed } else { Exit::Done })
}

/// Compares two reports.
///
/// # Errors
///
/// They are of other suites, have no scenario or run in common, or have one scenario only while an
/// exit code is asked for that one scenario cannot justify.
pub fn compare(a: &Report, b: &Report, args: &CompareArgs) -> anyhow::Result<Comparison> {
    let reasons = pairs::reasons_against(a, b);
    if !reasons.is_empty() && !args.any {
        return Err(wrong_usage(format!(
            "the reports do not show the same: {}; run both with one suite, seed and build, or say --any to compare what has the same name",
            reasons.join("; ")
        )));
    }
    let scenarios = pairs::scenarios(a, b);
    let runs = pairs::runs(a, b, &args.renamed);
    if scenarios.is_empty() || runs.is_empty() {
        let programs = |report: &Report| super::rows::programs(report).join(", ");
        return Err(wrong_usage(format!(
            "the reports have no {} in common: A has the programs {}, B has {}; say --as X=Y to compare program X of A with program Y of B",
            if runs.is_empty() { "run" } else { "scenario" },
            programs(a),
            programs(b)
        )));
    }
    if scenarios.len() < 2 && args.fail_on.is_some() && args.at_least == 0.0 {
        return Err(wrong_usage(
            "one scenario has no interval, so --fail-on cannot tell a change from noise: run a suite with at least two scenarios, or say with --at-least SHARE from which change on to fail",
        ));
    }
    let mut changes = Vec::new();
    for (run_a, run_b) in &runs {
        let label = match run_a.program == run_b.program {
            true => run_a.label(),
            false => format!("{} as {}", run_a.label(), run_b.program),
        };
        for metric in pairs::metrics_of(run_a, args.all) {
            changes.extend(compared(&label, &metric, run_a, run_b, &scenarios, args));
        }
    }
    let notes = notes(&reasons, a, b, &runs, &scenarios, &changes, args);
    Ok(Comparison {
        suites: [a.suite.clone(), b.suite.clone()],
        builds: [a.build.clone(), b.build.clone()],
        scenarios,
        confidence: args.confidence,
        resamples: args.resamples,
        seed: args.seed,
        at_least: args.at_least,
        changes,
        notes,
    })
}

fn compared(
    label: &str,
    metric: &Metric,
    a: &super::types::Run,
    b: &super::types::Run,
    scenarios: &[String],
    args: &CompareArgs,
) -> Option<Change> {
    let value = |run: &super::types::Run, name: &str| {
        let one = run.scenarios.iter().find(|it| it.scenario == name)?;
        metric.of_scenario(one)
    };
    let pairs: Vec<(f64, f64)> = scenarios
        .iter()
        .filter_map(|name| Some((value(a, name)?, value(b, name)?)))
        .collect();
    let (whole_a, whole_b) = (metric.of_run(a)?, metric.of_run(b)?);
    let differences: Vec<f64> = pairs.iter().map(|(a, b)| b - a).collect();
    let n = differences.len();
    let (difference, before) = match n {
        0 => (whole_b - whole_a, whole_a),
        n => (
            differences.iter().sum::<f64>() / n as f64,
            pairs.iter().map(|(a, _)| a).sum::<f64>() / n as f64,
        ),
    };
    let interval = interval(
        &differences,
        args.confidence,
        args.resamples as usize,
        args.seed,
    );
    let is_large = difference.abs() >= args.at_least * before.abs() && difference != 0.0;
    let is_beyond_noise = match interval {
        Some((low, high)) => Some(low > 0.0 || high < 0.0),
        // Without an interval a size that was asked for decides, if one was.
        None if args.at_least > 0.0 || difference == 0.0 => Some(true),
        None => None,
    };
    let verdict = match (is_beyond_noise, is_large, metric.higher_is_better) {
        (None, ..) => Verdict::Unknown,
        (Some(false), ..) | (_, false, _) => Verdict::Same,
        (.., None) => Verdict::Changed,
        (.., Some(higher)) if higher == (difference > 0.0) => Verdict::Better,
        _ => Verdict::Worse,
    };
    Some(Change {
        run: label.to_owned(),
        group: metric.group.clone(),
        metric: metric.name.clone(),
        a: whole_a,
        b: whole_b,
        n_scenarios: n,
        difference,
        interval: interval.map(|(low, high)| [low, high]),
        higher_is_better: metric.higher_is_better,
        verdict,
    })
}

/// Scenarios below which the interval is clearly narrower than its confidence says.
const FEW: usize = 8;

fn notes(
    reasons: &[String],
    a: &Report,
    b: &Report,
    runs: &[(&super::types::Run, &super::types::Run)],
    scenarios: &[String],
    changes: &[Change],
    args: &CompareArgs,
) -> Vec<String> {
    let mut notes = Vec::new();
    if !reasons.is_empty() {
        notes.push(format!(
            "the reports do not show the same: {}",
            reasons.join("; ")
        ));
    }
    if a.machine.cpu != b.machine.cpu || a.machine.n_cpus != b.machine.n_cpus {
        notes.push(format!(
            "the machines differ ({}, {} cores; {}, {} cores), so latency and everything in real time does too",
            a.machine.cpu, a.machine.n_cpus, b.machine.cpu, b.machine.n_cpus
        ));
    }
    let percent = args.confidence * 100.0;
    match scenarios.len() {
        1 => notes.push(
            "there is one scenario, so no interval exists and nothing tells a change from noise".into(),
        ),
        n if n < FEW => notes.push(format!(
            "{n} scenarios are few: resampling them gives intervals narrower than {percent:.0} % says"
        )),
        _ => {}
    }
    let n_judged = changes.iter().filter(|it| it.interval.is_some()).count();
    let by_chance = n_judged as f64 * (1.0 - args.confidence);
    if by_chance >= 0.5 {
        notes.push(format!(
            "of {n_judged} intervals about {by_chance:.0} would miss zero by chance alone"
        ));
    }
    let left_out = |report: &Report, of: &dyn Fn(&super::types::Run) -> bool| -> Vec<String> {
        let alone = report.runs.iter().filter(|run| !of(run));
        alone.map(super::types::Run::label).collect()
    };
    let only_a = left_out(a, &|run| runs.iter().any(|(it, _)| std::ptr::eq(*it, run)));
    let only_b = left_out(b, &|run| runs.iter().any(|(_, it)| std::ptr::eq(*it, run)));
    for (name, only) in [("A", only_a), ("B", only_b)] {
        if !only.is_empty() {
            notes.push(format!("only {name} has {}", only.join(", ")));
        }
    }
    notes
}
