//! Tasks: what programs are asked, and what must be true to tell how right they are.

use schema_frames::{Modality, ResultType};
use serde::Deserialize;
use toml::Table;

/// What is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskKind {
    /// Boxes in an image.
    Boxes2d,
    /// Boxes in space.
    Boxes3d,
    /// Masks of objects.
    Masks,
    /// A class for every pixel.
    Semantic,
    /// Depth of every pixel.
    Depth,
    /// Disparity of a pair of cameras.
    Stereo,
    /// Optical flow from one image to the next.
    Flow,
    /// Optical flow from events, in windows of 100 ms.
    EventFlow,
    /// A class for every point of a cloud.
    LidarSemantic,
    /// Objects that keep their numbers.
    Tracking,
    /// Where the sensor is.
    Odometry,
    /// Lines of lanes.
    Lanes,
    /// Driving the ego vehicle.
    Driving,
}

/// Which sensor of the truth pass a modality belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TruthPlace {
    /// `SENSOR_truth`: the input's pose and settings, at every query.
    Queries,
    /// The input sensor itself, so that the frame's window is the input's.
    Input,
    /// `SENSOR_truth10`: the input's pose and settings, ten times a second.
    TenHz,
    /// `SENSOR_truth` of a lidar: the same rays at the same times.
    Lidar,
}

impl TaskKind {
    /// All kinds.
    pub const ALL: [TaskKind; 13] = [
        TaskKind::Boxes2d,
        TaskKind::Boxes3d,
        TaskKind::Masks,
        TaskKind::Semantic,
        TaskKind::Depth,
        TaskKind::Stereo,
        TaskKind::Flow,
        TaskKind::EventFlow,
        TaskKind::LidarSemantic,
        TaskKind::Tracking,
        TaskKind::Odometry,
        TaskKind::Lanes,
        TaskKind::Driving,
    ];

    /// Its name in suites and reports.
    pub fn name(self) -> &'static str {
        match self {
            TaskKind::Boxes2d => "boxes2d",
            TaskKind::Boxes3d => "boxes3d",
            TaskKind::Masks => "masks",
            TaskKind::Semantic => "semantic",
            TaskKind::Depth => "depth",
            TaskKind::Stereo => "stereo",
            TaskKind::Flow => "flow",
            TaskKind::EventFlow => "event_flow",
            TaskKind::LidarSemantic => "lidar_semantic",
            TaskKind::Tracking => "tracking",
            TaskKind::Odometry => "odometry",
            TaskKind::Lanes => "lanes",
            TaskKind::Driving => "driving",
        }
    }

    /// Types of results that can be scored.
    pub fn result_types(self) -> &'static [ResultType] {
        match self {
            TaskKind::Boxes2d => &[ResultType::Boxes2d],
            TaskKind::Boxes3d => &[ResultType::Boxes3d],
            TaskKind::Masks => &[ResultType::Masks],
            TaskKind::Semantic => &[ResultType::Semantic],
            TaskKind::Depth => &[ResultType::Depth],
            TaskKind::Stereo => &[ResultType::Image, ResultType::Tensor, ResultType::Depth],
            TaskKind::Flow | TaskKind::EventFlow => &[ResultType::Flow],
            TaskKind::LidarSemantic => &[ResultType::Tensor, ResultType::Points],
            TaskKind::Tracking => &[ResultType::Tracks],
            TaskKind::Odometry => &[ResultType::Odometry, ResultType::Pose],
            TaskKind::Lanes => &[ResultType::Keypoints, ResultType::Path],
            TaskKind::Driving => &[],
        }
    }

    /// Exact images and clouds that the truth needs beside snapshots, of an input that is a lidar or
    /// not.
    pub fn truth(self, is_lidar: bool) -> Vec<(TruthPlace, Modality)> {
        use Modality::{Depth, Flow, Instance, Semantic, SemanticLidar};
        let queries = |all: &[Modality]| all.iter().map(|it| (TruthPlace::Queries, *it)).collect();
        match self {
            TaskKind::Boxes3d | TaskKind::Tracking | TaskKind::LidarSemantic if is_lidar => {
                vec![(TruthPlace::Lidar, SemanticLidar)]
            }
            TaskKind::Boxes2d | TaskKind::Boxes3d | TaskKind::Masks | TaskKind::Tracking => {
                queries(&[Depth, Semantic, Instance])
            }
            TaskKind::Semantic => queries(&[Semantic]),
            TaskKind::Depth | TaskKind::Stereo => queries(&[Depth, Semantic]),
            TaskKind::Lanes => queries(&[Depth, Instance]),
            TaskKind::Flow => {
                let mut all: Vec<_> = queries(&[Depth, Semantic, Instance]);
                all.push((TruthPlace::Input, Flow));
                all
            }
            TaskKind::EventFlow => vec![(TruthPlace::TenHz, Flow)],
            TaskKind::LidarSemantic | TaskKind::Odometry | TaskKind::Driving => Vec::new(),
        }
    }

    /// Whether the program acts on the world, so that nothing can be recorded beforehand.
    pub fn acts(self) -> bool {
        self == TaskKind::Driving
    }
}

/// A task.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// What is asked.
    pub kind: TaskKind,
    /// Its name, unique in the suite; the kind's if it is empty.
    #[serde(default)]
    pub name: String,
    /// Name of the sensor that it is about; none if the program drives.
    #[serde(default)]
    pub sensor: Option<String>,
    /// The right camera of a stereo pair.
    #[serde(default)]
    pub partner: Option<String>,
    /// Classes that count; empty: those that are usual for the task.
    #[serde(default)]
    pub classes: Vec<String>,
    /// Topic of its results, if a program's `results` do not say it.
    #[serde(default)]
    pub topic: Option<String>,
    /// What is left out of the truth, and other values than the usual ones.
    #[serde(default)]
    pub ignore: Table,
    /// Further settings of the task.
    #[serde(default)]
    pub options: Table,
}

impl Task {
    /// The topic of its truth of one modality.
    pub fn truth_topic(&self, modality: Modality) -> String {
        let sensor = self.sensor.as_deref().unwrap_or_default();
        let name = modality.name();
        match (self.kind, modality) {
            (TaskKind::Flow, Modality::Flow) => format!("ego/{sensor}/{name}"),
            (TaskKind::EventFlow, _) => format!("ego/{sensor}_truth10/{name}"),
            _ => format!("ego/{sensor}_truth/{name}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_called_in_suites_as_in_reports() {
        for kind in TaskKind::ALL {
            let text = format!("kind = {:?}", kind.name());
            let task: Task = toml::from_str(&text).unwrap();
            assert_eq!(task.kind, kind);
        }
    }

    #[test]
    fn flow_is_the_inputs_own_and_all_else_stands_at_the_queries() {
        let topic = |kind: &str, modality| {
            let text = format!("kind = {kind:?}\nsensor = \"front\"");
            toml::from_str::<Task>(&text).unwrap().truth_topic(modality)
        };
        assert_eq!(topic("flow", Modality::Flow), "ego/front/flow");
        assert_eq!(topic("flow", Modality::Depth), "ego/front_truth/depth");
        assert_eq!(
            topic("event_flow", Modality::Flow),
            "ego/front_truth10/flow"
        );
    }
}
