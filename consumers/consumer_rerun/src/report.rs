//! What came of the comparison: a table for people, an object for programs.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use crate::compare::Difference;

/// A difference at a tick.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct At {
    /// The tick.
    pub tick: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// Where.
    #[serde(flatten)]
    pub difference: Difference,
}

/// What came of one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TopicReport {
    /// Recorded frames that were compared.
    pub compared: u64,
    /// Those that are equal to the last byte.
    pub equal: u64,
    /// Recorded frames that the new run has not.
    pub missing: u64,
    /// Frames of the file that cannot be read.
    pub damaged: u64,
    /// The first difference.
    pub first: Option<At>,
}

impl TopicReport {
    /// Counts a comparison.
    pub fn count(&mut self, tick: u64, sim_nanos: u64, difference: Option<Difference>) {
        self.compared += 1;
        match difference {
            None => self.equal += 1,
            Some(difference) => {
                self.first.get_or_insert(At {
                    tick,
                    sim_nanos,
                    difference,
                });
            }
        }
    }

    fn differs(&self) -> bool {
        self.equal < self.compared || self.missing > 0
    }
}

/// What came of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Report {
    /// First and last tick that were compared.
    pub ticks: Option<(u64, u64)>,
    /// Simulated time of the last tick that was run, nanoseconds.
    pub end_nanos: u64,
    /// By topic; `world/snapshot` is the world itself.
    pub topics: BTreeMap<String, TopicReport>,
    /// Recorded topics that the new run does not publish.
    pub not_there: Vec<String>,
    /// What may be the reason of differences, said before the run.
    pub notes: Vec<String>,
    /// Whether everything that was compared is equal.
    pub is_equal: bool,
    /// Whether the recording could be read as a whole.
    pub is_undamaged: bool,
}

impl Report {
    /// The report of a topic.
    pub fn topic(&mut self, name: &str) -> &mut TopicReport {
        if !self.topics.contains_key(name) {
            self.topics.insert(name.to_owned(), TopicReport::default());
        }
        self.topics.get_mut(name).expect("it was just made")
    }

    /// Says something about the run at once, and keeps it for the report.
    pub fn note(&mut self, sentence: String) {
        tracing::warn!("{sentence}");
        self.notes.push(sentence);
    }

    /// Notes that a tick was compared.
    pub fn saw(&mut self, tick: u64) {
        let (first, _) = self.ticks.unwrap_or((tick, tick));
        self.ticks = Some((first.min(tick), tick));
    }

    /// The run is over.
    pub fn close(&mut self) {
        self.is_equal = self.not_there.is_empty()
            && self.topics.values().any(|topic| topic.compared > 0)
            && !self.topics.values().any(TopicReport::differs);
    }

    /// The first difference of all, and its topic; of several at one tick that of the world.
    pub fn first(&self) -> Option<(&str, &At)> {
        let rank = |name: &str| name != WORLD;
        self.topics
            .iter()
            .filter_map(|(name, topic)| topic.first.as_ref().map(|at| (name.as_str(), at)))
            .min_by_key(|(name, at)| (at.tick, rank(name)))
    }

    /// As a table with a sentence below.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let width = self
            .topics
            .keys()
            .map(String::len)
            .max()
            .unwrap_or(0)
            .max(5);
        let _ = writeln!(
            text,
            "{:width$}  {:>8}  {:>8}  first difference",
            "topic", "compared", "equal"
        );
        for (name, topic) in &self.topics {
            let mut first = topic.first.as_ref().map_or_else(
                || {
                    if topic.compared == 0 {
                        "not compared"
                    } else {
                        "-"
                    }
                    .to_owned()
                },
                |at| format!("tick {} ({}): {}", at.tick, secs(at.sim_nanos), place(at)),
            );
            for (n, what) in [
                (topic.missing, "not there now"),
                (topic.damaged, "damaged in the file"),
            ] {
                if n > 0 {
                    let _ = write!(first, "; {n} {what}");
                }
            }
            let _ = writeln!(
                text,
                "{name:width$}  {:>8}  {:>8}  {first}",
                topic.compared, topic.equal
            );
        }
        if !self.not_there.is_empty() {
            let _ = writeln!(
                text,
                "recorded, but not published by this run: {}",
                self.not_there.join(", ")
            );
        }
        text.push_str(&self.sentence());
        text.push('\n');
        text
    }

    /// The outcome in a sentence.
    pub fn sentence(&self) -> String {
        let Some((from, to)) = self.ticks else {
            return "nothing was compared: the recording has no frames or snapshots of the ticks that were run".into();
        };
        let n: u64 = self.topics.values().map(|topic| topic.compared).sum();
        match self.first() {
            None if self.is_equal => {
                format!("equal to the last byte: {n} samples of ticks {from} to {to}")
            }
            None => format!(
                "ticks {from} to {to}: what was compared is equal, but not all of the recording is there"
            ),
            Some((topic, at)) => format!(
                "the runs part at tick {} ({}): {topic} {}",
                at.tick,
                secs(at.sim_nanos),
                place(at)
            ),
        }
    }
}

/// The topic of snapshots.
pub const WORLD: &str = "world/snapshot";

fn place(at: &At) -> String {
    let Difference {
        place,
        recorded,
        now,
    } = &at.difference;
    format!("{place} was {recorded}, is {now}")
}

/// Simulated time in seconds.
pub fn secs(nanos: u64) -> String {
    format!("{:.3} s", nanos as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_earliest_difference_is_told_and_the_world_comes_first() {
        let mut report = Report::default();
        let difference = |place: &str| Some(Difference::new(place, "1", "2"));
        for tick in 1..=3 {
            report.saw(tick);
            report.topic("ego/front/rgb").count(
                tick,
                tick * 50_000_000,
                difference("pixel (0, 0)").filter(|_| tick == 2),
            );
            report.topic(WORLD).count(
                tick,
                tick * 50_000_000,
                difference("actor 7, part").filter(|_| tick >= 2),
            );
        }
        report.close();
        assert!(!report.is_equal);
        assert_eq!(
            report.sentence(),
            "the runs part at tick 2 (0.100 s): world/snapshot actor 7, part was 1, is 2"
        );
        assert!(report.text().contains("ego/front/rgb"), "{}", report.text());
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!(
            json["topics"]["ego/front/rgb"]["first"]["place"],
            "pixel (0, 0)"
        );
    }

    #[test]
    fn equal_runs_say_how_much_was_compared_and_nothing_is_not_equal() {
        let mut report = Report::default();
        report.close();
        assert!(!report.is_equal && report.sentence().starts_with("nothing was compared"));
        report.saw(4);
        report.topic(WORLD).count(4, 0, None);
        report.close();
        assert!(report.is_equal);
        assert_eq!(
            report.sentence(),
            "equal to the last byte: 1 samples of ticks 4 to 4"
        );
        report.topic("ego/imu/imu").missing = 1;
        report.close();
        assert!(!report.is_equal);
    }
}
