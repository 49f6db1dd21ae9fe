//! Where a result's numbers are: from its space into the world.

use std::collections::HashMap;

use nalgebra::{Isometry3, Vector3};
use schema_frames::{ResultHeader, Space};
use schema_types::Pose;

use crate::evidence::moment::Moment;
use crate::tasks::{Context, Unreadable};

/// The carrier's poses so far, for results in its space.
#[derive(Clone, Debug, Default)]
pub struct EgoPoses {
    world_from_ego: HashMap<u64, Isometry3<f64>>,
    is_sealed: bool,
}

impl EgoPoses {
    /// Forgets all: a scenario begins.
    pub fn begin(&mut self, context: &Context<'_>) {
        self.world_from_ego.clear();
        self.is_sealed = context.is_sealed;
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

    /// The carrier's pose at a result's tick.
    ///
    /// # Errors
    /// A sentence if that tick was not seen.
    pub fn of(&self, header: &ResultHeader) -> Result<Isometry3<f64>, Unreadable> {
        let tick = header.tick;
        self.at(tick).ok_or_else(|| {
            format!("answers tick {tick}, of which the vehicle's pose was not recorded").into()
        })
    }

    /// The place in the world of what a result's header says: of its sensor, or of its space.
    ///
    /// # Errors
    /// As [`EgoPoses::of`].
    pub fn said(&self, header: &ResultHeader) -> Result<Isometry3<f64>, Unreadable> {
        let said = header.world_from_space.isometry();
        match self.is_sealed {
            true => Ok(self.of(header)? * said),
            false => Ok(said),
        }
    }

    /// From a result's space into the world. In sensor or image space its header says it; in the
    /// vehicle's space too, unless it was left out, and then the vehicle's pose at the result's tick
    /// holds.
    ///
    /// # Errors
    /// A sentence if the space has no place in the world.
    pub fn world_from_space(&self, header: &ResultHeader) -> Result<Isometry3<f64>, Unreadable> {
        match header.space() {
            Some(Space::World) => Ok(Isometry3::identity()),
            Some(Space::Vehicle) if header.world_from_space == Pose::IDENTITY => self.of(header),
            Some(Space::Sensor | Space::Image | Space::Vehicle) => self.said(header),
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
