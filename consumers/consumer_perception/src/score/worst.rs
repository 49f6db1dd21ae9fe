//! The worst frames as pictures: truth and result side by side.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use consumer_truth::recording::TickReader;
use consumer_truth::scenario::Scenario;
use schema_frames::Modality;
use schema_recording::read::RecordingFile;

use super::work::{Wanted, Work, is_query};
use crate::evidence::moment::Moment;
use crate::picture::Picture;
use crate::report::WorstFrame;
use crate::tasks::Scored;
use crate::truth_pass::TruthRecording;

/// Draws the worst frames of a task and writes them to `pictures/` in `out`.
pub(super) fn draw(
    work: &mut Work<'_>,
    scored: &Scored,
    file: &RecordingFile,
    about: &Scenario,
    wanted: &Wanted,
    truth: &TruthRecording,
    out: &Path,
) -> anyhow::Result<Vec<WorstFrame>> {
    let Some(colour) = colour_topic(work, truth) else {
        return Ok(Vec::new());
    };
    let mut topics: HashSet<Arc<str>> = wanted.topics.clone();
    topics.insert(colour.clone());
    let mut drawn = Vec::new();
    for (number, worst) in scored.worst.iter().enumerate() {
        let times = (worst.sim_nanos, worst.sim_nanos + 1);
        let mut ticks = TickReader::new(file, times, &topics)?;
        let Some(set) = ticks.next_tick()? else {
            continue;
        };
        let Some(frame) = set.frames.iter().find(|frame| frame.topic == colour) else {
            continue;
        };
        let mut moment = Moment::new(&set, about.carrier_id, &wanted.views);
        moment.is_query = is_query(truth, about, set.sim_nanos);
        let (mut of_truth, mut of_result) = (Picture::of(frame), Picture::of(frame));
        work.task.draw(
            &mut of_truth,
            &mut of_result,
            &moment,
            work.capture,
            worst.result,
        );
        let spec = work.task.spec();
        let stem = [
            &truth.scenario.name,
            &work.capture.program,
            work.capture.mode.name(),
            &spec.name,
        ]
        .map(tame)
        .join("-");
        let (speed, delay) = (
            work.capture.speed,
            work.capture.added_delay_nanos / 1_000_000,
        );
        let stem = format!("{stem}-{speed}-{delay}-{}", number + 1);
        let save = |picture: &Picture, what: &str| -> anyhow::Result<String> {
            let name = format!("pictures/{stem}-{what}.jpg");
            let path = out.join(&name);
            let cannot = || format!("cannot write {}", path.display());
            std::fs::create_dir_all(out.join("pictures")).with_context(cannot)?;
            std::fs::write(&path, picture.jpeg()?).with_context(cannot)?;
            Ok(name)
        };
        drawn.push(WorstFrame {
            task: spec.name.clone(),
            secs: set.sim_nanos.saturating_sub(truth.begin_nanos) as f64 / 1e9,
            why: match worst.result {
                Some(_) => worst.bad.why.clone(),
                None => format!("{}; no result", worst.bad.why),
            },
            truth_image: save(&of_truth, "truth")?,
            result_image: save(&of_result, "result")?,
        });
    }
    Ok(drawn)
}

/// The colour images over which a task is drawn: its own input, else any camera's that programs get.
fn colour_topic(work: &Work<'_>, truth: &TruthRecording) -> Option<Arc<str>> {
    let is_colour = |topic: &str| topic.rsplit('/').next() == Some(Modality::Rgb.name());
    let input = &work.task.spec().input;
    if is_colour(input) {
        return Some(input.as_str().into());
    }
    let all = truth.inputs.iter().map(|input| input.topic.as_str());
    let found = all.filter(|topic| is_colour(topic)).min_by_key(|topic| {
        // The sensor that looks ahead, if there is one.
        (!topic.contains("front"), topic.len())
    });
    found.map(Arc::from)
}

fn tame(name: impl AsRef<str>) -> String {
    let tame = |c: char| {
        let fine = c.is_ascii_alphanumeric() || c == '_' || c == '.';
        if fine { c } else { '_' }
    };
    name.as_ref().chars().map(tame).collect()
}
