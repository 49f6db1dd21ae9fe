//! What is replayed, how fast, and for whom.

use std::path::PathBuf;

use launch_cli::values::{WrongValue, number};
use schema_bus::BusOptions;
use schema_frames::Seal;
use schema_recording::pattern::matches;

/// What is replayed, how fast, and for whom.
#[derive(Clone, Debug)]
pub struct Options {
    /// The recording.
    pub file: PathBuf,
    /// First part of every topic's name.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
    /// How fast.
    pub rate: Rate,
    /// Whether to begin again at the end.
    pub again: bool,
    /// First simulated time; `None` for the beginning.
    pub from_nanos: Option<u64>,
    /// First simulated time that is not replayed; `None` for the end.
    pub to_nanos: Option<u64>,
    /// Patterns of frames; none for all.
    pub topics: Vec<String>,
    /// Topics under another name: one topic, or all below a name.
    pub renamed: Vec<(String, String)>,
    /// Which results.
    pub results: Results,
    /// Number of lockstep participants that the first tick waits for.
    pub n_awaited: usize,
    /// Names of those that it waits for.
    pub awaited: Vec<String>,
    /// Wait after which a living participant is removed.
    pub lockstep_timeout_nanos: Option<u64>,
    /// Whether to begin in stepped mode.
    pub paused: bool,
    /// Whether to stay at the end, instead of ending.
    pub hold: bool,
    /// Whether keys of the terminal are read.
    pub keys: bool,
    /// What is shown of the recorded world, if programs are scored against it.
    pub seal: Option<Seal>,
}

impl Options {
    /// The whole of a file at its own speed, with the defaults of the program.
    pub fn new(domain: &str, file: PathBuf) -> Options {
        Options {
            file,
            domain: domain.to_string(),
            bus: BusOptions::default(),
            rate: Rate::Ratio(1.0),
            again: false,
            from_nanos: None,
            to_nanos: None,
            topics: Vec::new(),
            renamed: Vec::new(),
            results: Results::All,
            n_awaited: 0,
            awaited: Vec::new(),
            lockstep_timeout_nanos: None,
            paused: false,
            hold: false,
            keys: false,
            seal: None,
        }
    }

    /// Whether a topic of frames is replayed.
    pub fn has_frames_of(&self, topic: &str) -> bool {
        let is_sealed = self
            .seal
            .as_ref()
            .is_some_and(|seal| !seal.shows(&self.name_of(topic)));
        !is_sealed && (self.topics.is_empty() || any(&self.topics, topic))
    }

    /// Whether a topic of results is replayed.
    pub fn has_results_of(&self, topic: &str) -> bool {
        match &self.results {
            Results::All => self.has_frames_of(topic) || self.topics.is_empty(),
            Results::None => false,
            Results::Matching(patterns) => any(patterns, topic),
        }
    }

    /// The name under which a topic is published.
    pub fn name_of(&self, topic: &str) -> String {
        let renamed = self.renamed.iter().find_map(|(from, to)| {
            let rest = topic.strip_prefix(from.as_str())?;
            (rest.is_empty() || rest.starts_with('/')).then(|| format!("{to}{rest}"))
        });
        renamed.unwrap_or_else(|| topic.to_string())
    }
}

fn any(patterns: &[String], topic: &str) -> bool {
    patterns.iter().any(|pattern| matches(pattern, topic))
}

/// How fast a recording goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Simulated seconds per second.
    Ratio(f64),
    /// As fast as the disk and the participants of the lockstep allow.
    Max,
}

/// Which results of users' programs are replayed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Results {
    /// Those whose topic is among the topics that are replayed.
    All,
    /// None, so that a new program can publish under their names.
    None,
    /// Those that match a pattern.
    Matching(Vec<String>),
}

/// Reads how long a participant may be idle, seconds, as nanoseconds.
///
/// # Errors
/// [`WrongValue`].
pub fn idle_nanos(text: &str) -> Result<u64, WrongValue> {
    let seconds = number("number of seconds", 0.001..=86_400.0)(text)?;
    Ok((seconds * 1e9).round() as u64)
}

/// Reads a speed: a ratio, or `max`.
///
/// # Errors
/// [`WrongValue`].
pub fn rate(text: &str) -> Result<Rate, WrongValue> {
    if text == "max" {
        return Ok(Rate::Max);
    }
    let (least, most) = schema_frames::command::SPEED_RATIO;
    let ratio = number("speed", least..=most)(text.trim_end_matches('x'));
    ratio
        .map(Rate::Ratio)
        .map_err(|_| WrongValue::new(text, "speed", format!("{least} to {most}, or max")))
}

/// Reads `a=b`.
///
/// # Errors
/// A sentence with what is allowed.
pub fn renaming(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((from, to)) if !from.is_empty() && !to.is_empty() && !to.contains('=') => Ok((
            from.trim_end_matches('/').to_string(),
            to.trim_end_matches('/').to_string(),
        )),
        _ => Err(format!(
            "{text:?} is no renaming; say OLD=NEW, e.g. ego/front=car/front"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_read_and_nonsense_is_refused() {
        assert_eq!(rate("2"), Ok(Rate::Ratio(2.0)));
        assert_eq!(rate("0.5x"), Ok(Rate::Ratio(0.5)));
        assert_eq!(rate("max"), Ok(Rate::Max));
        for bad in ["0", "-1", "fast", "101", "NaN", "inf", ""] {
            assert!(
                rate(bad).unwrap_err().to_string().contains("0.01 to 100"),
                "{bad}"
            );
        }
    }

    #[test]
    fn a_topic_or_all_below_a_name_is_renamed() {
        let mut options = Options::new("d", "a.mcap".into());
        options.renamed = vec![
            renaming("ego/front=car/nose").unwrap(),
            renaming("ego/=car").unwrap(),
        ];
        assert_eq!(options.name_of("ego/front/rgb"), "car/nose/rgb");
        assert_eq!(options.name_of("ego/roof/lidar"), "car/roof/lidar");
        assert_eq!(options.name_of("egon/a/rgb"), "egon/a/rgb");
        assert!(renaming("ego").is_err() && renaming("=b").is_err() && renaming("a=").is_err());
    }

    #[test]
    fn a_seal_leaves_out_what_it_does_not_name() {
        let mut options = Options::new("d", "a.mcap".into());
        options.seal = Some(Seal {
            topics: vec!["ego/front/rgb".into()],
            ..Seal::default()
        });
        assert!(options.has_frames_of("ego/front/rgb"));
        assert!(!options.has_frames_of("ego/front_truth/depth"));
    }

    #[test]
    fn results_follow_the_topics_unless_they_are_chosen() {
        let mut options = Options::new("d", "a.mcap".into());
        assert!(options.has_results_of("detector/boxes"));
        options.topics = vec!["ego/*".into()];
        assert!(!options.has_results_of("detector/boxes"));
        options.results = Results::Matching(vec!["detector/*".into()]);
        assert!(options.has_results_of("detector/boxes") && !options.has_results_of("plan/path"));
        options.results = Results::None;
        assert!(!options.has_results_of("ego/front/rgb"));
    }
}
