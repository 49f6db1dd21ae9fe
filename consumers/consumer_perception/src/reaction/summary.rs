//! What the trials say: the whole of `reaction.json`, of which terminal and page show parts.

use std::collections::BTreeMap;

use consumer_report::Spread;
use serde::{Deserialize, Serialize};

use super::scene::Plan;
use super::suite::{Kind, Suite};

/// Number of this form; it rises when a field changes its meaning or goes.
pub const REACTION_VERSION: u32 = 1;

/// Name of the row that says when the car really brakes.
pub const BRAKES: &str = "car brakes";

/// All trials of a suite.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Reactions {
    /// [`REACTION_VERSION`].
    pub version: u32,
    /// The suite, with every default.
    pub suite: Suite,
    /// Command of the program that was added with `-- CMD…`; empty without one.
    pub command: Vec<String>,
    /// The machine and the build.
    pub machine: serde_json::Value,
    /// When it began, seconds since 1970.
    pub began_unix_secs: u64,
    /// How long it took, seconds.
    pub took_secs: f64,
    /// Whether it was stopped before all trials were done.
    pub stopped: bool,
    /// By kind of trial.
    pub kinds: Vec<KindReport>,
    /// What a reader must know before believing a figure.
    pub warnings: Vec<String>,
    /// Every trial, in order.
    pub trials: Vec<Trial>,
}

/// All trials of a kind.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct KindReport {
    /// What happened.
    pub kind: Kind,
    /// Trials that were begun.
    pub n_trials: u32,
    /// Trials that count; the others failed.
    pub n_counted: u32,
    /// Number of failed trials by reason.
    pub failed: BTreeMap<String, u32>,
    /// By stage, in the suite's order, and behind them when the car really braked.
    pub stages: Vec<StageReport>,
}

/// A stage in all counted trials of a kind. Each trial is a reaction, a miss or a false alarm.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StageReport {
    /// Name of the stage.
    pub stage: String,
    /// Trials with a correct result within the window.
    pub n_reactions: u32,
    /// Trials without one.
    pub n_misses: u32,
    /// Trials in which it was correct, or braked, before anything could be seen; neither reaction
    /// nor miss, because what follows is no answer to the stimulus.
    pub n_false_alarms: u32,
    /// Results of that kind in all trials.
    pub n_alarming_results: u64,
    /// From the stimulus to the publication of the first correct result, wall clock.
    pub wall_ms: Spread,
    /// The same in simulated time.
    pub sim_ms: Spread,
    /// Of it: from the stimulus to the publication of the sensor's frame that is answered.
    pub sensor_ms: Spread,
    /// From the reaction of the stage before it in the same trial, where that came first.
    pub step_ms: Spread,
    /// By how much a single time may be too late, the worst of all: controls carry no time of their
    /// own.
    pub within_ms: f64,
}

/// One trial.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Trial {
    /// Its numbers.
    pub plan: Plan,
    /// Why it does not count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
    /// When something could be seen; `None` if nothing could.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stimulus: Option<Stimulus>,
    /// By stage, in the order of the report.
    #[serde(default)]
    pub stages: Vec<Outcome>,
}

/// The first tick that could show it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stimulus {
    /// The tick.
    pub tick: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// When the world was in this state: its snapshot was published, nanoseconds of the monotonic
    /// clock.
    pub mono_nanos: u64,
    /// Visible pixels.
    pub visible_pixels: u32,
    /// Ticks before it of which the truth camera sent no image, so that it may have been one of
    /// them.
    pub unseen_ticks: u64,
    /// From the command to it, simulated milliseconds.
    pub after_command_ms: f64,
    /// Distance between the ego's and the subject's origins, metres.
    pub distance_m: f64,
    /// The ego's speed, m/s.
    pub ego_mps: f64,
    /// Simulated seconds per second of the wall clock in this trial.
    pub pace: f64,
}

/// A stage in a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Name of the stage.
    pub stage: String,
    /// The first correct result after the stimulus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reaction: Option<Reaction>,
    /// Results that were correct before the stimulus.
    pub n_alarms: u64,
    /// Results in the trial.
    pub n_results: u64,
}

/// A reaction; times in nanoseconds since the stimulus.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reaction {
    /// Tick that it answers.
    pub tick: u64,
    /// Wall clock.
    pub wall_nanos: u64,
    /// Simulated time.
    pub sim_nanos: u64,
    /// By how much the first two may be too late.
    pub within_nanos: u64,
    /// Publication of the sensor's frame behind it, wall clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor_nanos: Option<u64>,
}

/// Adds up the trials of each kind, in the suite's order.
pub fn kinds(trials: &[Trial]) -> Vec<KindReport> {
    let mut reports: Vec<KindReport> = Vec::new();
    for kind in Kind::ALL {
        let of_kind: Vec<&Trial> = trials.iter().filter(|it| it.plan.kind == kind).collect();
        if of_kind.is_empty() {
            continue;
        }
        let mut failed: BTreeMap<String, u32> = BTreeMap::new();
        for reason in of_kind.iter().filter_map(|it| it.failed.as_ref()) {
            *failed.entry(reason.clone()).or_default() += 1;
        }
        let counted: Vec<&Trial> = of_kind
            .iter()
            .copied()
            .filter(|it| it.failed.is_none())
            .collect();
        let names: Vec<&str> = counted
            .first()
            .map(|it| it.stages.iter().map(|stage| stage.stage.as_str()).collect())
            .unwrap_or_default();
        let stages = (0..names.len()).map(|index| stage(&counted, index, names[index]));
        reports.push(KindReport {
            kind,
            n_trials: of_kind.len() as u32,
            n_counted: counted.len() as u32,
            failed,
            stages: stages.collect(),
        });
    }
    reports
}

fn stage(trials: &[&Trial], index: usize, name: &str) -> StageReport {
    let outcomes = || trials.iter().filter_map(|trial| trial.stages.get(index));
    // What follows a false alarm is no answer to the stimulus.
    let reaction = |outcome: &Outcome| outcome.reaction.filter(|_| outcome.n_alarms == 0);
    let reactions = || outcomes().filter_map(reaction);
    let steps = trials.iter().filter_map(|trial| {
        let now = reaction(trial.stages.get(index)?)?;
        let before = reaction(trial.stages.get(index.checked_sub(1)?)?)?;
        now.wall_nanos.checked_sub(before.wall_nanos)
    });
    let n_alarmed = outcomes().filter(|it| it.n_alarms > 0).count() as u32;
    let n_reactions = reactions().count() as u32;
    StageReport {
        stage: name.to_owned(),
        n_reactions,
        n_misses: outcomes().count() as u32 - n_alarmed - n_reactions,
        n_false_alarms: n_alarmed,
        n_alarming_results: outcomes().map(|it| it.n_alarms).sum(),
        wall_ms: Spread::of(reactions().map(|it| it.wall_nanos)),
        sim_ms: Spread::of(reactions().map(|it| it.sim_nanos)),
        sensor_ms: Spread::of(reactions().filter_map(|it| it.sensor_nanos)),
        step_ms: Spread::of(steps),
        within_ms: reactions().map(|it| it.within_nanos).max().unwrap_or(0) as f64 / 1e6,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn trial(kind: Kind, number: u32, stages: &[(Option<u64>, u64)]) -> Trial {
        let outcome = |(index, (ms, n_alarms)): (usize, &(Option<u64>, u64))| Outcome {
            stage: ["detector", "brake"][index].to_owned(),
            reaction: ms.map(|ms| Reaction {
                tick: 5,
                wall_nanos: ms * 1_000_000,
                sim_nanos: ms * 2_000_000,
                within_nanos: 300_000,
                sensor_nanos: Some(20_000_000),
            }),
            n_alarms: *n_alarms,
            n_results: 10,
        };
        Trial {
            plan: Plan {
                kind,
                number,
                wait_s: 1.0,
                distance_m: 20.0,
                speed_mps: 2.0,
                brake_ratio: 1.0,
                side: 1.0,
                type_id: "walker".into(),
            },
            failed: None,
            stimulus: None,
            stages: stages.iter().enumerate().map(outcome).collect(),
        }
    }

    #[test]
    fn every_counted_trial_is_a_reaction_a_miss_or_a_false_alarm() {
        let kind = Kind::PedestrianStepsOut;
        let mut broken = trial(kind, 4, &[]);
        broken.failed = Some("clusters ended".into());
        let trials = [
            trial(kind, 0, &[(Some(80), 0), (Some(100), 0)]),
            trial(kind, 1, &[(Some(120), 0), (None, 0)]),
            trial(kind, 2, &[(None, 0), (None, 0)]),
            trial(kind, 3, &[(Some(10), 3), (Some(50), 0)]),
            broken,
        ];
        let report = &kinds(&trials)[0];
        assert_eq!((report.n_trials, report.n_counted), (5, 4));
        assert_eq!(report.failed["clusters ended"], 1);
        let counts = |index: usize| {
            let stage = &report.stages[index];
            (stage.n_reactions, stage.n_misses, stage.n_false_alarms)
        };
        assert_eq!((counts(0), counts(1)), ((2, 1, 1), (2, 2, 0)));
        let (detector, brake) = (&report.stages[0], &report.stages[1]);
        assert_eq!(detector.n_alarming_results, 3);
        // 80 and 120 ms; the alarm's 10 ms does not count.
        assert!(
            (detector.wall_ms.min - 80.0).abs() < 0.2 && (detector.wall_ms.max - 120.0).abs() < 0.2
        );
        assert!((detector.sim_ms.max - 240.0).abs() < 0.5);
        // Only the first trial has both; the fourth's detector raised an alarm.
        assert_eq!(brake.step_ms.n, 1);
        assert!(
            (brake.step_ms.max - 20.0).abs() < 0.05,
            "{}",
            brake.step_ms.max
        );
        assert!((brake.within_ms - 0.3).abs() < 1e-9);
    }
}
