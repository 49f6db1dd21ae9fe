//! What a task may say: town, vehicle, start, rules and when it counts as solved. The built-in ones
//! are files like users' own.

use serde::Deserialize;

use crate::error::TaskError;

const BUILT_IN: [(&str, &str); 2] = [
    ("LaneKeeping", include_str!("../tasks/lane_keeping.toml")),
    (
        "EmergencyBrake",
        include_str!("../tasks/emergency_brake.toml"),
    ),
];

/// A task.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Its name.
    pub name: String,
    /// The town that it is in.
    pub town: String,
    /// Catalogue id of the ego.
    pub vehicle: String,
    /// Length of a step, milliseconds.
    pub tick_ms: u32,
    /// Steps after which an episode is cut off (truncated).
    pub limit_steps: u32,
    /// Where an episode begins.
    pub start: Start,
    /// Rewards and ends.
    pub rules: Rules,
    /// When the task counts as solved.
    pub solved: Solved,
}

/// Where an episode begins, beside the place on the road, which is drawn by lot.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Greatest offset from the middle of the lane, as a share of half its width.
    pub offset_ratio: f64,
    /// Greatest angle to the lane, radians.
    pub heading_rad: f64,
    /// Least and greatest speed, m/s.
    pub speed_mps: [f64; 2],
}

/// Rewards and ends.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rules {
    /// Follow the lane at the speed that it allows.
    LaneKeeping(LaneKeeping),
    /// Stop for what is ahead, and for nothing else.
    EmergencyBrake(EmergencyBrake),
}

/// Reward of a step: the speed along the lane over its limit (as far below 1 as above it), less
/// `offset_weight` · (offset / half the lane)². Leaving the lane, contact and driving against it
/// end the episode with 0.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneKeeping {
    /// Weight of the offset.
    pub offset_weight: f64,
}

/// Reward of a step: `progress_weight` · seconds · speed over that of the start (at most 1), less
/// `jerk_weight` · |jerk| · seconds. Contact ends the episode with −(speed of impact / speed at the
/// start)²; a standstill ends it with −`needless_penalty` if nothing is near ahead, and with 0 if
/// something is. Leaving the lane ends it as a needless standstill does.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmergencyBrake {
    /// Share of the episodes with a car ahead that brakes to a halt.
    pub lead_share: f64,
    /// Share of the episodes with a person who crosses.
    pub person_share: f64,
    /// A standstill farther from the next obstacle is needless, metres.
    pub needless_gap_m: f64,
    /// Penalty of a needless standstill.
    pub needless_penalty: f64,
    /// Weight of the jerk, m/s³.
    pub jerk_weight: f64,
    /// Weight of the progress, 1/s.
    pub progress_weight: f64,
}

/// When a task counts as solved: all of it, over episodes of seeds that were not trained on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solved {
    /// Number of episodes.
    pub episodes: u32,
    /// Least mean of (sum of rewards / limit of steps).
    pub min_mean_return_ratio: f64,
    /// Greatest share of episodes that end by contact or off the lane.
    pub max_contact_share: f64,
    /// Greatest share of episodes that end by a needless standstill.
    pub max_needless_share: f64,
}

impl Task {
    /// Names of the built-in tasks.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// A built-in task.
    ///
    /// # Errors
    /// [`TaskError::Unknown`].
    pub fn built_in(name: &str) -> Result<Task, TaskError> {
        Task::from_toml(Task::text(name)?)
    }

    /// The file of a built-in task, which users copy and change.
    ///
    /// # Errors
    /// [`TaskError::Unknown`].
    pub fn text(name: &str) -> Result<&'static str, TaskError> {
        let found = BUILT_IN.iter().find(|(known, _)| *known == name);
        let unknown = || TaskError::Unknown {
            name: name.to_owned(),
            known: Task::names().collect::<Vec<_>>().join(", "),
        };
        found.map(|(_, text)| *text).ok_or_else(unknown)
    }

    /// A task from the text of a file.
    ///
    /// # Errors
    /// [`TaskError`].
    pub fn from_toml(text: &str) -> Result<Task, TaskError> {
        let task: Task = toml::from_str(text)?;
        task.check()?;
        Ok(task)
    }

    /// Length of a step, seconds.
    pub fn step_secs(&self) -> f64 {
        f64::from(self.tick_ms) * 1e-3
    }

    fn check(&self) -> Result<(), TaskError> {
        let within = |what, value: f64, [low, high]: [f64; 2], allowed| {
            // Comparisons with a number that is none are false.
            match value >= low && value <= high {
                true => Ok(()),
                false => Err(TaskError::Value {
                    task: self.name.clone(),
                    what,
                    value: value.to_string(),
                    allowed,
                }),
            }
        };
        let share = [0.0, 1.0];
        let weight = [0.0, 1000.0];
        within("tick_ms", self.tick_ms.into(), [1.0, 200.0], "1 to 200")?;
        let steps = self.limit_steps.into();
        within("limit_steps", steps, [1.0, 10_000.0], "1 to 10000")?;
        let start = &self.start;
        within(
            "start.offset_ratio",
            start.offset_ratio,
            [0.0, 0.9],
            "0 to 0.9",
        )?;
        within(
            "start.heading_rad",
            start.heading_rad,
            [0.0, 0.5],
            "0 to 0.5",
        )?;
        let [slow, fast] = start.speed_mps;
        within("start.speed_mps[0]", slow, [1.0, 50.0], "1 to 50")?;
        within("start.speed_mps[1]", fast, [slow, 50.0], "the first to 50")?;
        match &self.rules {
            Rules::LaneKeeping(rules) => {
                within("offset_weight", rules.offset_weight, weight, "0 to 1000")?;
            }
            Rules::EmergencyBrake(rules) => {
                within("lead_share", rules.lead_share, share, "0 to 1")?;
                let sum = rules.lead_share + rules.person_share;
                within("person_share", rules.person_share, share, "0 to 1")?;
                within("lead_share + person_share", sum, share, "0 to 1")?;
                within("needless_gap_m", rules.needless_gap_m, weight, "0 to 1000")?;
                let penalty = rules.needless_penalty;
                within("needless_penalty", penalty, weight, "0 to 1000")?;
                within("jerk_weight", rules.jerk_weight, weight, "0 to 1000")?;
                within(
                    "progress_weight",
                    rules.progress_weight,
                    weight,
                    "0 to 1000",
                )?;
            }
        }
        let solved = &self.solved;
        within(
            "solved.episodes",
            solved.episodes.into(),
            [1.0, 1e6],
            "1 to 1000000",
        )?;
        let least = solved.min_mean_return_ratio;
        within(
            "solved.min_mean_return_ratio",
            least,
            [-1e6, 1.0],
            "-1e6 to 1",
        )?;
        within(
            "solved.max_contact_share",
            solved.max_contact_share,
            share,
            "0 to 1",
        )?;
        within(
            "solved.max_needless_share",
            solved.max_needless_share,
            share,
            "0 to 1",
        )
    }
}
