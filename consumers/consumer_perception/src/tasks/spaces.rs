//! Where a result's numbers are: from its space into the world.

use std::collections::HashMap;

use nalgebra::{Isometry3, Vector3};
use schema_frames::{ResultHeader, Space};
use schema_types::Pose;

use crate::evidence::moment::Moment;
use crate::tasks::Unreadable;

/// The carrier's poses so far, for results in its space.
#[derive(Clone, Debug, Default)]
pub struct EgoPoses {
    world_from_ego: HashMap<u64, Isometry3<f64>>,
}

impl EgoPoses {
    /// Forgets all: a scenario begins.
    pub fn clear(&mut self) {
        self.world_from_ego.clear();
    }

    /// Sees a tick.
    pub fn watch(&mut self, moment: &Moment<'_>) {
        if let Some(ego) = moment.ego() {
            self.world_from_ego
                .insert(moment.set.tick, ego.world_from_ego);
        }
    }

    /// The carrier's pose at a tick that was seen.
    pub fn at(&self, tick: u64) -> Option<Isometry3<f64>> {
        self.world_from_ego.get(&tick).copied()
    }

    /// From a result's space into the world. In sensor or image space its header says it; in the
    /// vehicle's space too, unless it was left out, and then the vehicle's pose at the result's tick
    /// holds.
    ///
    /// # Errors
    /// A sentence if the space has no place in the world.
    pub fn world_from_space(&self, header: &ResultHeader) -> Result<Isometry3<f64>, Unreadable> {
        let said = header.world_from_space.isometry();
        match header.space() {
            Some(Space::World) => Ok(Isometry3::identity()),
            Some(Space::Sensor | Space::Image) => Ok(said),
            Some(Space::Vehicle) if header.world_from_space != Pose::IDENTITY => Ok(said),
            Some(Space::Vehicle) => {
                let pose = self.world_from_ego.get(&header.tick);
                pose.copied().ok_or_else(|| {
                    let tick = header.tick;
                    format!("is in the vehicle's space at tick {tick}, which was not recorded")
                        .into()
                })
            }
            Some(Space::None) | None => {
                Err("has no space; say sensor, vehicle or world when the topic is opened".into())
            }
        }
    }
}

/// Whether a pose's numbers can be used.
pub fn is_finite(pose: &Pose) -> bool {
    let rotation = pose.rotation_xyzw;
    let norm: f64 = rotation.iter().map(|part| part * part).sum();
    pose.translation_m.iter().all(|part| part.is_finite()) && (0.5..2.0).contains(&norm)
}

/// A pose with its quaternion made one of unit length.
pub fn normalised(pose: &Pose) -> Isometry3<f64> {
    let mut isometry = pose.isometry();
    isometry.rotation.renormalize();
    isometry
}

/// Distance on the ground, metres.
pub fn ground_distance_m(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    (a.xy() - b.xy()).norm()
}
