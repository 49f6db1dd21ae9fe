//! From a suite's tasks and what a program published to what is scored: topics, inputs, truth.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use consumer_truth::scenario::Scenario;
use schema_frames::document::Weather;
use schema_frames::{Modality, StepMode, WorldInfo};

use super::work::{Inputs, Wanted};
use crate::capture::{Capture, CapturedResult, Mode, SentFrame};
use crate::evidence::ignore::Rules;
use crate::suite::SuiteFault;
use crate::suite::{Suite, Task, TaskKind};
use crate::tasks::classes;
use crate::tasks::dense::depth::Depth;
use crate::tasks::dense::event_flow::EventFlow;
use crate::tasks::dense::flow::Flow;
use crate::tasks::dense::lidar_semantic::LidarSemantic;
use crate::tasks::dense::semantic::Semantic;
use crate::tasks::dense::stereo::Stereo;
use crate::tasks::motion::driving::Driving;
use crate::tasks::motion::lanes::Lanes;
use crate::tasks::motion::odometry::Odometry;
use crate::tasks::objects::boxes2d::Boxes2d;
use crate::tasks::objects::boxes3d::Boxes3d;
use crate::tasks::objects::masks::Masks;
use crate::tasks::objects::tracking::Tracking;
use crate::tasks::{AnyTask, Options, Plan, Spec, TaskRun};
use crate::truth_pass::TruthRecording;

/// Checks what a suite says about a task beyond its sensor.
///
/// # Errors
/// A sentence with the task, the key, its value and what is allowed.
pub fn check(task: &Task) -> Result<(), SuiteFault> {
    let name = &task.name;
    rules(task)?;
    options(task)?;
    let checked = match task.kind {
        TaskKind::Boxes2d | TaskKind::Boxes3d | TaskKind::Masks | TaskKind::Tracking => {
            classes::targets(&task.classes).map(drop)
        }
        TaskKind::Semantic | TaskKind::LidarSemantic => {
            classes::semantic_targets(&task.classes).map(drop)
        }
        _ if task.classes.is_empty() => Ok(()),
        kind => Err(format!("{} knows no classes; leave them out", kind.name()).into()),
    };
    checked.map_err(|fault| format!("task {name:?}: {fault}").into())
}

fn rules(task: &Task) -> Result<Rules, SuiteFault> {
    let found: Result<Rules, _> = task.ignore.clone().try_into();
    let found = found.map_err(|error: toml::de::Error| SuiteFault::from(error.message()));
    let found = found.and_then(|rules| rules.check().map(|()| rules));
    found.map_err(|fault| format!("task {:?}: ignore: {fault}", task.name).into())
}

fn options(task: &Task) -> Result<Options, SuiteFault> {
    let name = &task.name;
    let found: Result<Options, _> = task.options.clone().try_into();
    let found = found.map_err(|error| format!("task {name:?}: options: {}", error.message()))?;
    for (key, value) in [("baseline_m", found.baseline_m), ("route_m", found.route_m)] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(
                format!("task {name:?}: options.{key} is {value}, but must be 0 or more").into(),
            );
        }
    }
    if task.kind == TaskKind::Driving && found.route_m <= 0.0 {
        return Err(format!(
            "task {name:?}: options.route_m is missing; say how many metres the route has"
        )
        .into());
    }
    Ok(found)
}

/// A task, ready for its first scenario.
///
/// # Errors
/// A sentence if it cannot be scored.
pub(super) fn task(spec: &Spec, mode: Mode, plan: &Plan) -> Result<Box<dyn AnyTask>, SuiteFault> {
    macro_rules! run {
        ($measure:expr) => {
            Box::new(TaskRun::new(spec.clone(), mode, plan.clone(), $measure))
        };
    }
    Ok(match spec.kind {
        TaskKind::Boxes2d => run!(Boxes2d::new(spec)?),
        TaskKind::Boxes3d => run!(Boxes3d::new(spec)?),
        TaskKind::Masks => run!(Masks::new(spec)?),
        TaskKind::Semantic => run!(Semantic::new(spec)?),
        TaskKind::Depth => run!(Depth::new(spec)),
        TaskKind::Stereo => run!(Stereo::new(spec)),
        TaskKind::Flow => run!(Flow::new(spec)),
        TaskKind::EventFlow => run!(EventFlow::new(spec)),
        TaskKind::LidarSemantic => run!(LidarSemantic::new(spec)?),
        TaskKind::Tracking => run!(Tracking::new(spec)?),
        TaskKind::Odometry => run!(Odometry::new(spec)),
        TaskKind::Lanes => run!(Lanes::new(spec)),
        TaskKind::Driving => Box::new(Driving::new(spec)),
    })
}

/// From which simulated time on a capture counts.
pub(super) fn from_nanos(suite: &Suite, truth: &TruthRecording, capture: &Capture) -> u64 {
    let own = suite.program(&capture.program);
    let warm_up_s = own.map_or(0.0, |program| program.warm_up_s);
    truth.scored_from_nanos + (warm_up_s * 1e9) as u64
}

/// All frames that were sent to a program, in order: those that the benchmark saw, and of the topics
/// that it saw all that were recorded up to the last one, because its own reader may be too slow for
/// some on a busy machine. When those were published is not known.
pub(super) fn sent(truth: &TruthRecording, capture: &Capture) -> Vec<SentFrame> {
    let mut all = capture.frames.clone();
    let epochs: HashSet<u64> = all.iter().map(|frame| frame.epoch).collect();
    let last = all.iter().map(|frame| frame.tick).max();
    let (Some(last), 1) = (last, epochs.len()) else {
        return all;
    };
    let seen: HashSet<(Arc<str>, u64)> = all
        .iter()
        .map(|frame| (frame.topic.clone(), frame.tick))
        .collect();
    let topics: HashSet<Arc<str>> = all.iter().map(|frame| frame.topic.clone()).collect();
    for topic in topics {
        let recorded = truth.sent(&topic).into_iter();
        let unseen = recorded.filter(|frame| {
            frame.tick <= last && !seen.contains(&(frame.topic.clone(), frame.tick))
        });
        let epoch = epochs.iter().next().copied().unwrap_or(0);
        all.extend(unseen.map(|frame| SentFrame { epoch, ..frame }));
    }
    all.sort_by_key(|frame| (frame.sim_nanos, frame.tick));
    all
}

/// The topics of a program's results and the task of each.
fn topics<'a>(suite: &'a Suite, capture: &Capture) -> Vec<(Arc<str>, &'a Task)> {
    let mut first: BTreeMap<&Arc<str>, &CapturedResult> = BTreeMap::new();
    for result in &capture.results {
        first.entry(&result.topic).or_insert(result);
    }
    let program = suite.program(&capture.program);
    let mut found: Vec<(Arc<str>, &Task)> = Vec::new();
    for (topic, result) in first {
        let task = match (program, result.header.kind()) {
            (Some(program), Some(kind)) => suite.task_of(program, topic, kind, &result.inputs),
            _ => None,
        };
        found.extend(task.map(|task| (topic.clone(), task)));
    }
    // What a program was to answer and never did is scored as well.
    let promised: Vec<(Arc<str>, &Task)> = match program {
        Some(program) if !program.results.is_empty() => {
            let of = program.results.iter();
            of.filter_map(|(topic, name)| Some((Arc::from(topic.as_str()), suite.task(name)?)))
                .collect()
        }
        _ if found.is_empty() => {
            let of = suite.tasks.iter().filter(|task| !task.kind.acts());
            of.map(|task| (Arc::from(task.topic.as_deref().unwrap_or_default()), task))
                .collect()
        }
        _ => Vec::new(),
    };
    for (topic, task) in promised {
        if !found.iter().any(|(other, _)| *other == topic) || topic.is_empty() {
            found.push((topic, task));
        }
    }
    let acts = suite.tasks.iter().filter(|task| task.kind.acts());
    if capture.drive_recording.is_some() {
        found.extend(acts.map(|task| (Arc::from(task.topic.as_deref().unwrap_or_default()), task)));
    }
    found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.name.cmp(&b.1.name)));
    found.dedup_by(|a, b| a.0 == b.0 && a.1.name == b.1.name);
    found
}

/// The input topic that a task's results answer: the one of its sensor that they name, else the
/// sensor's own, else what they name most of all inputs.
fn input(truth: &TruthRecording, capture: &Capture, topic: &str, task: &Task) -> String {
    let sent: HashSet<&str> = capture.frames.iter().map(|frame| &*frame.topic).collect();
    let is_of_sensor = |name: &str| {
        let sensor = name.split('/').nth(1);
        task.sensor.is_some() && sensor == task.sensor.as_deref()
    };
    let mut named: BTreeMap<String, usize> = BTreeMap::new();
    let own = capture.results.iter();
    for result in own.filter(|result| *result.topic == *topic).take(200) {
        for record in &result.inputs {
            *named.entry(record.topic()).or_default() += 1;
        }
    }
    named.retain(|name, _| sent.contains(name.as_str()));
    let most = |of: &dyn Fn(&str) -> bool| {
        let found = named.iter().filter(|(name, _)| of(name));
        found.max_by_key(|(_, n)| **n).map(|(name, _)| name.clone())
    };
    let of_sensor = || {
        let all = truth.inputs.iter().map(|input| input.topic.clone());
        let mut own: Vec<String> = all.filter(|name| is_of_sensor(name)).collect();
        let usual = |name: &String| match task.kind {
            TaskKind::EventFlow => name.ends_with("/dvs"),
            _ => name.ends_with("/rgb") || name.ends_with("/lidar"),
        };
        own.sort_by_key(|name| (!sent.contains(name.as_str()), !usual(name)));
        own.into_iter().next()
    };
    most(&is_of_sensor)
        .or_else(|| of_sensor().filter(|name| sent.contains(name.as_str())))
        .or_else(|| most(&|_| true))
        .or_else(of_sensor)
        .or_else(|| truth.inputs.first().map(|input| input.topic.clone()))
        .unwrap_or_default()
}

/// Whether a task's sensor is a lidar.
fn is_lidar(truth: &TruthRecording, task: &Task) -> bool {
    let sensor = task.sensor.as_deref().unwrap_or_default();
    truth.topics.iter().any(|topic| {
        let mut words = topic.split('/');
        words.nth(1) == Some(sensor) && words.next().is_some_and(|word| word.contains("lidar"))
    })
}

/// The sensor of a task's truth of a modality, `rig/sensor`.
fn truth_sensor(truth: &TruthRecording, task: &Task, modality: Modality) -> String {
    let topic = truth.truth_topic(task, modality);
    topic
        .rsplit_once('/')
        .map_or("", |(sensor, _)| sensor)
        .into()
}

/// Everything that is scored of a capture.
pub(super) fn specs(suite: &Suite, truth: &TruthRecording, capture: &Capture) -> Vec<Spec> {
    let of = topics(suite, capture).into_iter().map(|(topic, task)| {
        let lidar = is_lidar(truth, task);
        let main = match task.kind {
            TaskKind::Boxes3d | TaskKind::Tracking | TaskKind::LidarSemantic if lidar => {
                Some(Modality::SemanticLidar)
            }
            TaskKind::Boxes2d
            | TaskKind::Boxes3d
            | TaskKind::Masks
            | TaskKind::Tracking
            | TaskKind::Lanes => Some(Modality::Instance),
            TaskKind::Semantic => Some(Modality::Semantic),
            TaskKind::Depth | TaskKind::Stereo => Some(Modality::Depth),
            TaskKind::Flow | TaskKind::EventFlow => Some(Modality::Flow),
            TaskKind::LidarSemantic => Some(Modality::SemanticLidar),
            TaskKind::Odometry | TaskKind::Driving => None,
        };
        let mut own_options = options(task).unwrap_or_default();
        own_options.in_space |= task.kind == TaskKind::Tracking && lidar;
        own_options.query_hz = 1e9 / truth.query_nanos.max(1) as f64;
        own_options.partner = task.partner.clone().unwrap_or_default();
        Spec {
            name: task.name.clone(),
            kind: task.kind,
            input: input(truth, capture, &topic, task),
            topic: topic.to_string(),
            truth: main.map_or_else(String::new, |of| truth_sensor(truth, task, of)),
            images: truth_sensor(truth, task, Modality::Instance),
            classes: task.classes.clone(),
            rules: rules(task).unwrap_or_default(),
            options: own_options,
        }
    });
    of.collect()
}

/// The topics of results that are scored, with their inputs; of programs under stress too.
pub(super) fn inputs_by_topic(suite: &Suite, truth: &TruthRecording, capture: &Capture) -> Inputs {
    let specs = specs(suite, truth, capture).into_iter();
    let of = specs.filter(|spec| spec.kind != TaskKind::Driving);
    of.map(|spec| (Arc::from(spec.topic.as_str()), spec.input))
        .collect()
}

/// Which frames of a recording some tasks need.
pub(super) fn wanted(specs: &[&Spec], truth: &TruthRecording, suite: &Suite) -> Wanted {
    let mut topics: HashSet<Arc<str>> = HashSet::new();
    let mut views: Vec<Arc<str>> = Vec::new();
    for spec in specs {
        let Some(task) = suite.task(&spec.name) else {
            continue;
        };
        for (_, modality) in task.kind.truth(is_lidar(truth, task)) {
            topics.insert(truth.truth_topic(task, modality).as_str().into());
        }
        let view = match spec.kind {
            TaskKind::Flow => Some(&spec.images),
            TaskKind::Boxes2d
            | TaskKind::Boxes3d
            | TaskKind::Masks
            | TaskKind::Tracking
            | TaskKind::Lanes => Some(&spec.truth),
            _ => None,
        };
        views.extend(view.map(|view| Arc::from(view.as_str())));
        if spec.kind == TaskKind::LidarSemantic {
            topics.insert(spec.input.as_str().into());
        }
    }
    views.sort();
    views.dedup();
    Wanted { topics, views }
}

/// A scenario of which nothing was recorded beforehand, because programs act in it.
pub(super) fn nothing_recorded(truth: &TruthRecording, index: u32) -> Scenario {
    Scenario {
        name: truth.scenario.name.clone(),
        index,
        split: String::new(),
        rig: truth.rig.clone(),
        carrier_id: 0,
        info: WorldInfo {
            source: "live".into(),
            version: String::new(),
            epoch: "0".into(),
            episode: 1,
            map: truth.scenario.map.clone(),
            seed: truth.scenario.seed,
            mode: StepMode::Stepped,
            period_nanos: truth.query_nanos,
            episode_start_nanos: 0,
            lockstep: Vec::new(),
            weather: Weather::default(),
            adapter: truth.adapter.clone(),
            cpu_copies: 0,
            batches: Vec::new(),
            cameras: Vec::new(),
        },
        start_nanos: truth.begin_nanos,
        end_nanos: truth.end_nanos,
        sensors: Vec::new(),
        opendrive: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn task(text: &str) -> Task {
        toml::from_str(text).expect("a task")
    }

    #[test]
    fn tasks_that_cannot_be_scored_are_refused_with_key_and_value() {
        for (text, words) in [
            ("kind = \"boxes2d\"\nclasses = [\"chair\"]", "chair"),
            ("kind = \"depth\"\nclasses = [\"car\"]", "knows no classes"),
            ("kind = \"semantic\"\nclasses = [\"unicorn\"]", "unicorn"),
            ("kind = \"masks\"\nignore = { min_pixel = 3 }", "min_pixel"),
            (
                "kind = \"masks\"\nignore = { min_visible = 3 }",
                "min_visible is 3",
            ),
            (
                "kind = \"stereo\"\noptions = { baseline_m = -1 }",
                "baseline_m",
            ),
            ("kind = \"stereo\"\noptions = { base = 1 }", "base"),
            ("kind = \"driving\"", "route_m"),
        ] {
            let sentence = check(&task(text)).expect_err(text);
            assert!(sentence.to_string().contains(words), "{text}: {sentence}");
        }
        for text in [
            "kind = \"boxes2d\"\nclasses = [\"vehicle\", \"person\"]",
            "kind = \"semantic\"\nclasses = [\"road\", \"Sky\"]",
            "kind = \"driving\"\noptions = { route_m = 50 }",
            "kind = \"tracking\"\noptions = { in_space = true }\nignore = { max_distance_m = 30 }",
        ] {
            assert_eq!(check(&task(text)), Ok(()), "{text}");
        }
    }
}
