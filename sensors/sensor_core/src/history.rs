//! Where moving things were at the ticks before: what flow compares with, and what rays of a turning
//! lidar meet that were fired before the tick.

use std::collections::VecDeque;

use nalgebra::Isometry3;
use schema_types::{ActorId, SimTime};

use crate::scene::{DynamicInstance, Past, Scene};

/// Most earlier ticks that are kept.
pub const MAX_PAST_TICKS: usize = 512;

/// A part that went faster than this, and than twice its velocity, was put where it is, m/s.
const JUMP_MPS: f64 = 100.0;

/// Poses of all dynamic instances at one tick, sorted by (actor, part).
#[derive(Clone, Debug, Default)]
pub struct InstancePoses(Vec<((u32, u16), Isometry3<f64>)>);

impl InstancePoses {
    /// The poses in a scene.
    pub fn of(scene: &Scene) -> Self {
        let mut poses: Vec<_> = scene
            .dynamics
            .iter()
            .map(|instance| (instance.key(), instance.world_from_mesh))
            .collect();
        poses.sort_by_key(|(key, _)| *key);
        InstancePoses(poses)
    }

    /// The pose of an actor's part, looked for first at its number among the parts of a scene: from
    /// tick to tick most stay where they were.
    pub fn get_near(&self, number: usize, key: (u32, u16)) -> Option<&Isometry3<f64>> {
        match self.0.get(number) {
            Some((known, pose)) if *known == key => Some(pose),
            _ => self.get(key),
        }
    }

    /// The pose of an actor's part.
    pub fn get(&self, key: (u32, u16)) -> Option<&Isometry3<f64>> {
        self.0
            .binary_search_by_key(&key, |(known, _)| *known)
            .ok()
            .map(|i| &self.0[i].1)
    }
}

/// A tick that is over.
#[derive(Clone, Debug)]
struct PastTick {
    sim_time: SimTime,
    poses: InstancePoses,
    /// Actors that were put elsewhere since the tick before, by rising id.
    jumped: Vec<ActorId>,
}

/// The ticks before the current one, the newest first, as far back as a turning lidar looks.
#[derive(Clone, Debug, Default)]
pub struct PoseHistory(VecDeque<PastTick>);

impl PoseHistory {
    /// Where the parts of a scene were. `jumped` names the actors that were put elsewhere since the
    /// newest tick that was pushed, by rising id.
    pub fn past_of(&self, scene: &Scene, jumped: &[ActorId]) -> Past {
        let mut past = Past {
            ages_nanos: self
                .0
                .iter()
                .map(|tick| scene.sim_time.0 - tick.sim_time.0)
                .collect(),
            ..Past::default()
        };
        let mut way = Vec::with_capacity(self.0.len());
        for (place, instance) in (0..).zip(&scene.dynamics) {
            way.clear();
            self.follow(instance, scene.sim_time, jumped, &mut way);
            let was_elsewhere = way.iter().any(|pose| *pose != instance.world_from_mesh);
            if was_elsewhere {
                let first = *way.last().unwrap_or(&instance.world_from_mesh);
                way.resize(self.0.len(), first);
                past.moved.push(place);
                past.poses.extend_from_slice(&way);
            }
        }
        if past.moved.is_empty() {
            return Past::default();
        }
        past
    }

    /// Appends the poses of a part from tick to tick, back to where it appeared.
    fn follow(
        &self,
        instance: &DynamicInstance,
        now: SimTime,
        jumped: &[ActorId],
        way: &mut Vec<Isometry3<f64>>,
    ) {
        let (mut later, mut later_time, mut jumped) = (instance.world_from_mesh, now, jumped);
        let fastest_mps = JUMP_MPS.max(2.0 * instance.velocity_in_world_mps.norm());
        for tick in &self.0 {
            let Some(pose) = tick.poses.get(instance.key()) else {
                return;
            };
            let way_m = (pose.translation.vector - later.translation.vector).norm();
            let secs = (later_time.0 - tick.sim_time.0) as f64 * 1e-9;
            let is_too_fast = way_m.is_nan() || way_m > fastest_mps * secs;
            if is_too_fast || jumped.binary_search(&instance.actor).is_ok() {
                return;
            }
            way.push(*pose);
            (later, later_time, jumped) = (*pose, tick.sim_time, &tick.jumped);
        }
    }

    /// Adds the tick of a scene, and drops what is older than the newest tick at or before
    /// `keep_from`. A time that does not lie ahead begins the history anew.
    pub fn push(&mut self, scene: &Scene, jumped: Vec<ActorId>, keep_from: SimTime) {
        if self
            .0
            .front()
            .is_some_and(|tick| tick.sim_time >= scene.sim_time)
        {
            self.0.clear();
        }
        self.0.push_front(PastTick {
            sim_time: scene.sim_time,
            poses: InstancePoses::of(scene),
            jumped,
        });
        let is_needed = |tick: &PastTick| tick.sim_time > keep_from;
        let n_needed = self.0.iter().take_while(|tick| is_needed(tick)).count() + 1;
        self.0.truncate(n_needed.min(MAX_PAST_TICKS));
    }

    /// Forgets everything: the world jumped to another state, or nobody looks back.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::{UnitQuaternion, Vector3};
    use schema_frames::document::Weather;
    use schema_types::Tick;

    use super::*;
    use crate::scene::{MeshId, Overlay, SceneAssets};

    const TICK_NANOS: u64 = 50_000_000;

    /// A scene of parts (actor, part) at places along x, each with a velocity.
    fn scene(tick: u64, parts: &[(u32, u16, f64, f64)]) -> Scene {
        let part = |(actor, part, x, speed): &(u32, u16, f64, f64)| DynamicInstance {
            actor: ActorId(*actor),
            part: *part,
            mesh: MeshId(0),
            world_from_mesh: Isometry3::from_parts(
                [*x, 0.0, 0.0].into(),
                UnitQuaternion::identity(),
            ),
            tint_rgb: [0; 3],
            lamps: 0,
            velocity_in_world_mps: Vector3::x() * *speed,
        };
        Scene {
            tick: Tick(tick),
            sim_time: SimTime(tick * TICK_NANOS),
            period_nanos: TICK_NANOS,
            assets: Arc::new(SceneAssets::default()),
            dynamics: parts.iter().map(part).collect(),
            past: Past::default(),
            weather: Weather::default(),
            lidar_extinction_per_m: 0.0,
            debug: Vec::new(),
            overlay: Overlay::default(),
        }
    }

    fn xs(past: &Past) -> Vec<f64> {
        past.poses.iter().map(|pose| pose.translation.x).collect()
    }

    #[test]
    fn what_moved_has_a_pose_for_each_tick_and_what_rests_has_none() {
        let mut history = PoseHistory::default();
        for tick in 1..=3 {
            let at = tick as f64;
            history.push(
                &scene(tick, &[(1, 0, at, 20.0), (2, 0, 5.0, 0.0)]),
                Vec::new(),
                SimTime(0),
            );
        }
        let past = history.past_of(&scene(4, &[(1, 0, 4.0, 20.0), (2, 0, 5.0, 0.0)]), &[]);
        assert_eq!(past.ages_nanos, [1, 2, 3].map(|n| n * TICK_NANOS));
        assert_eq!(
            (&past.moved[..], xs(&past)),
            (&[0][..], vec![3.0, 2.0, 1.0])
        );
        let rest = history.past_of(&scene(4, &[(2, 0, 5.0, 0.0)]), &[]);
        assert_eq!(rest, Past::default());
    }

    #[test]
    fn what_appeared_or_was_put_elsewhere_stands_where_it_appeared() {
        let mut history = PoseHistory::default();
        history.push(
            &scene(1, &[(1, 0, 0.0, 20.0), (3, 0, 0.0, 0.0)]),
            Vec::new(),
            SimTime(0),
        );
        // Actor 1 is put 2 m on, actor 2 appears, actor 3 goes 50 m in a tick, 1000 m/s.
        let parts = [(1, 0, 3.0, 20.0), (2, 0, 7.0, 20.0), (3, 0, 50.0, 0.0)];
        history.push(&scene(2, &parts), vec![ActorId(1)], SimTime(0));
        let parts = [(1, 0, 4.0, 20.0), (2, 0, 8.0, 20.0), (3, 0, 51.0, 20.0)];
        let past = history.past_of(&scene(3, &parts), &[]);
        assert_eq!(past.moved, [0, 1, 2]);
        assert_eq!(xs(&past), [3.0, 3.0, 7.0, 7.0, 50.0, 50.0]);
        let jumped = history.past_of(&scene(3, &parts), &[ActorId(1), ActorId(2), ActorId(3)]);
        assert_eq!(jumped, Past::default());
    }

    #[test]
    fn ticks_that_nobody_looks_back_to_are_dropped() {
        let mut history = PoseHistory::default();
        for tick in 1..=9 {
            history.push(
                &scene(tick, &[(1, 0, tick as f64, 20.0)]),
                Vec::new(),
                SimTime(6 * TICK_NANOS),
            );
        }
        let now = scene(10, &[(1, 0, 10.0, 20.0)]);
        assert_eq!(xs(&history.past_of(&now, &[])), [9.0, 8.0, 7.0, 6.0]);
        for tick in 10..2000 {
            history.push(&scene(tick, &[(1, 0, 0.0, 0.0)]), Vec::new(), SimTime(0));
        }
        assert_eq!(history.0.len(), MAX_PAST_TICKS);
        history.push(&scene(5, &[(1, 0, 0.0, 0.0)]), Vec::new(), SimTime(0));
        assert_eq!(history.0.len(), 1);
    }
}
