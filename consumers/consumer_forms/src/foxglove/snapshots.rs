//! Converts snapshots and documents into messages: actors as transforms, boxes and odometry, and
//! everything losslessly.

use std::collections::{BTreeMap, BTreeSet};

use consumer_kit::KEPT_SNAPSHOTS;
use foxglove::messages as fox;
use schema_frames::document::DocumentHeader;
use schema_frames::{
    ActorKind, ActorList, ActorRecord, BodyBox, FrameHeader, SensorKind, SnapshotHeader,
};
use schema_types::{Class, Pose, space};

use super::frames::{TopicName, quaternion, timestamp, vector};
use schema_recording::messages::{Content, Entry};
use schema_recording::wire::{put_bytes, put_fixed64};

/// Foxglove's id of the world's axes.
pub const WORLD_FRAME: &str = "map";
/// Topic of all transforms.
pub const TRANSFORMS_TOPIC: &str = "/tf";
/// Topic of the actors' boxes.
pub const BOXES_TOPIC: &str = "/world/boxes";

/// Converts snapshots; remembers what later messages need about actors and sensors.
#[derive(Debug, Default)]
pub struct SnapshotConverter {
    boxes: BTreeMap<u32, BodyBox>,
    names: BTreeMap<u32, String>,
    rigs: BTreeMap<u32, String>,
    shown: BTreeSet<u32>,
    poses: Vec<(u64, Vec<(u32, Pose)>)>,
    calibrated: BTreeMap<String, u64>,
}

impl SnapshotConverter {
    /// Sets the names and boxes of the actors.
    pub fn set_actors(&mut self, list: &ActorList) {
        self.boxes = list
            .actors
            .iter()
            .map(|actor| (actor.id, actor.body_box))
            .collect();
        self.names = list
            .actors
            .iter()
            .map(|actor| (actor.id, format!("{} {}", actor.type_id, actor.id)))
            .collect();
    }

    /// The messages of a snapshot: boxes, transforms and odometry of the rigs seen so far, and the
    /// lossless message.
    pub fn snapshot_entries(
        &mut self,
        header: &SnapshotHeader,
        records: &[ActorRecord],
    ) -> Vec<Entry> {
        let poses = records
            .iter()
            .map(|record| (record.id, record.world_from_actor))
            .collect();
        self.poses.push((header.tick, poses));
        if self.poses.len() > KEPT_SNAPSHOTS {
            self.poses.remove(0);
        }
        let mut entries = vec![snapshot(header, records), self.boxes_entry(header, records)];
        let rigs = records
            .iter()
            .filter_map(|record| Some((record, self.rigs.get(&record.id)?)));
        let mut transforms = Vec::new();
        for (record, rig) in rigs {
            transforms.push(transform(
                header.sim_nanos,
                WORLD_FRAME,
                rig,
                &record.world_from_actor,
            ));
            entries.push(odometry(header.sim_nanos, rig, record));
        }
        if !transforms.is_empty() {
            entries.push(transforms_entry(transforms));
        }
        entries
    }

    /// Transforms and calibration that go with a frame, once per sensor and tick.
    pub fn frame_extras(&mut self, name: &TopicName, header: &FrameHeader) -> Vec<Entry> {
        if self.calibrated.get(&name.frame_id) == Some(&header.tick) {
            return Vec::new();
        }
        self.calibrated.insert(name.frame_id.clone(), header.tick);
        let mut transforms = self.sensor_transforms(name, header);
        let mut entries = Vec::new();
        if header.sensor_kind() == Some(SensorKind::Camera) {
            let rotation = space::sensor_from_camera();
            let optical = Pose::from(nalgebra::Isometry3::from_parts(
                nalgebra::Translation3::identity(),
                rotation,
            ));
            transforms.push(transform(
                header.sim_nanos,
                &name.frame_id,
                &name.optical_frame_id(),
                &optical,
            ));
            entries.extend(super::frames::calibration(name, header));
        }
        entries.push(transforms_entry(transforms));
        entries
    }

    /// `map` → rig → sensor where the parent's pose at that tick is known, else `map` → sensor.
    fn sensor_transforms(
        &mut self,
        name: &TopicName,
        header: &FrameHeader,
    ) -> Vec<fox::FrameTransform> {
        let sensor = header.world_from_sensor;
        let Some(parent) = self
            .pose_at(header.tick, header.parent_id)
            .filter(|_| header.parent_id != 0)
        else {
            return vec![transform(
                header.sim_nanos,
                WORLD_FRAME,
                &name.frame_id,
                &sensor,
            )];
        };
        self.rigs
            .entry(header.parent_id)
            .or_insert_with(|| name.rig.clone());
        let mount = Pose::from(parent.isometry().inverse() * sensor.isometry());
        vec![
            transform(header.sim_nanos, WORLD_FRAME, &name.rig, &parent),
            transform(header.sim_nanos, &name.rig, &name.frame_id, &mount),
        ]
    }

    fn pose_at(&self, tick: u64, actor: u32) -> Option<Pose> {
        let (_, poses) = self.poses.iter().rev().find(|(at, _)| *at == tick)?;
        poses
            .binary_search_by_key(&actor, |(id, _)| *id)
            .ok()
            .map(|idx| poses[idx].1)
    }

    fn boxes_entry(&mut self, header: &SnapshotHeader, records: &[ActorRecord]) -> Entry {
        let bodies: Vec<&ActorRecord> = records.iter().filter(|record| has_body(record)).collect();
        let now: BTreeSet<u32> = bodies.iter().map(|record| record.id).collect();
        let gone = self
            .shown
            .difference(&now)
            .map(|id| fox::SceneEntityDeletion {
                timestamp: Some(timestamp(header.sim_nanos)),
                r#type: fox::scene_entity_deletion::Type::MatchingId as i32,
                id: format!("actor_{id}"),
            });
        let update = fox::SceneUpdate {
            deletions: gone.collect(),
            entities: bodies
                .iter()
                .map(|record| self.box_entity(header.sim_nanos, record))
                .collect(),
        };
        self.shown = now;
        Entry::foxglove(BOXES_TOPIC.to_string(), Content::SceneUpdate, &update)
    }

    fn box_entity(&self, sim_nanos: u64, record: &ActorRecord) -> fox::SceneEntity {
        let half = record.half_box_m.map(f64::from);
        let centre = self
            .boxes
            .get(&record.id)
            .map_or([0.0, 0.0, half[2]], |body| body.centre_m.map(f64::from));
        let middle = record.world_from_actor.isometry() * nalgebra::Point3::from(centre);
        let rgb = Class(record.class)
            .info()
            .map_or([255; 3], |info| info.rgb)
            .map(|channel| channel as f64 / 255.0);
        let cube = fox::CubePrimitive {
            pose: Some(fox::Pose {
                position: Some(vector(middle.coords.into())),
                orientation: Some(quaternion(record.world_from_actor.rotation_xyzw)),
            }),
            size: Some(vector(half.map(|metres| 2.0 * metres))),
            color: Some(fox::Color {
                r: rgb[0],
                g: rgb[1],
                b: rgb[2],
                a: 0.7,
            }),
        };
        let name = self.names.get(&record.id).cloned().unwrap_or_default();
        fox::SceneEntity {
            timestamp: Some(timestamp(sim_nanos)),
            frame_id: WORLD_FRAME.to_string(),
            id: format!("actor_{}", record.id),
            metadata: vec![
                fox::KeyValuePair {
                    key: "name".to_string(),
                    value: name,
                },
                fox::KeyValuePair {
                    key: "speed_mps".to_string(),
                    value: format!("{:.2}", record.speed_mps()),
                },
            ],
            cubes: vec![cube],
            ..Default::default()
        }
    }
}

fn has_body(record: &ActorRecord) -> bool {
    let kind = matches!(
        record.kind(),
        Some(ActorKind::Vehicle | ActorKind::Walker | ActorKind::Prop)
    );
    kind && record.half_box_m.iter().all(|half| *half > 0.0)
}

fn transform(
    sim_nanos: u64,
    parent: &str,
    child: &str,
    parent_from_child: &Pose,
) -> fox::FrameTransform {
    fox::FrameTransform {
        timestamp: Some(timestamp(sim_nanos)),
        parent_frame_id: parent.to_string(),
        child_frame_id: child.to_string(),
        translation: Some(vector(parent_from_child.translation_m)),
        rotation: Some(quaternion(parent_from_child.rotation_xyzw)),
    }
}

fn transforms_entry(transforms: Vec<fox::FrameTransform>) -> Entry {
    Entry::foxglove(
        TRANSFORMS_TOPIC.to_string(),
        Content::FrameTransforms,
        &fox::FrameTransforms { transforms },
    )
}

/// Odometry of a rig; its velocities are in the body's axes.
fn odometry(sim_nanos: u64, rig: &str, record: &ActorRecord) -> Entry {
    let to_body = record.world_from_actor.isometry().rotation.inverse();
    let in_body = |v: [f64; 3]| vector((to_body * nalgebra::Vector3::from(v)).into());
    let message = fox::Odometry {
        timestamp: Some(timestamp(sim_nanos)),
        frame_id: WORLD_FRAME.to_string(),
        body_frame_id: rig.to_string(),
        pose: Some(fox::Pose {
            position: Some(vector(record.world_from_actor.translation_m)),
            orientation: Some(quaternion(record.world_from_actor.rotation_xyzw)),
        }),
        linear_velocity: Some(in_body(record.velocity_in_world_mps)),
        angular_velocity: Some(in_body(record.angular_velocity_in_world_radps)),
        ..Default::default()
    };
    Entry::foxglove(format!("/{rig}/odometry"), Content::Odometry, &message)
}

fn snapshot(header: &SnapshotHeader, records: &[ActorRecord]) -> Entry {
    let mut bytes = Vec::with_capacity(std::mem::size_of_val(records) + 256);
    put_fixed64(&mut bytes, 1, header.tick);
    put_fixed64(&mut bytes, 2, header.sim_nanos);
    put_bytes(&mut bytes, 3, bytemuck::bytes_of(header));
    put_bytes(&mut bytes, 4, bytemuck::cast_slice(records));
    Entry {
        topic: "/world/snapshot".to_string(),
        content: Content::Snapshot,
        bytes,
    }
}

/// The message of a document.
pub fn document(topic: &str, header: &DocumentHeader, text: &str) -> Entry {
    let mut bytes = Vec::with_capacity(text.len() + 128);
    put_fixed64(&mut bytes, 1, header.revision);
    put_fixed64(&mut bytes, 2, header.tick);
    put_bytes(&mut bytes, 3, bytemuck::bytes_of(header));
    put_bytes(&mut bytes, 4, text.as_bytes());
    Entry {
        topic: format!("/{topic}"),
        content: Content::Document,
        bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use foxglove::Decode;
    use schema_frames::Modality;

    fn record(id: u32, pose: Pose) -> ActorRecord {
        ActorRecord {
            id,
            kind: ActorKind::Vehicle as u16,
            class: Class::CAR.0,
            world_from_actor: pose,
            half_box_m: [2.0, 1.0, 0.75],
            ..Zeroable::zeroed()
        }
    }

    #[test]
    fn transforms_chain_from_map_to_the_optical_frame() {
        let mut state = SnapshotConverter::default();
        let vehicle = Pose::from_xyz_yaw(100.0, -20.0, 0.5, 1.0);
        let header = SnapshotHeader {
            tick: 3,
            ..Zeroable::zeroed()
        };
        state.snapshot_entries(&header, &[record(7, vehicle)]);
        let mut frame = FrameHeader::new(Modality::Depth);
        frame.set_image(4, 2);
        frame.tick = 3;
        frame.parent_id = 7;
        let mount = Pose::from_xyz_yaw(1.5, 0.25, 1.6, -0.3);
        frame.world_from_sensor = (vehicle.isometry() * mount.isometry()).into();
        let entries = state.frame_extras(&TopicName::new("ego/front/depth").unwrap(), &frame);
        let message =
            fox::FrameTransforms::decode(entries.last().unwrap().bytes.as_slice()).unwrap();
        let names: Vec<_> = message
            .transforms
            .iter()
            .map(|t| (t.parent_frame_id.as_str(), t.child_frame_id.as_str()))
            .collect();
        assert_eq!(
            names,
            [
                ("map", "ego"),
                ("ego", "ego/front"),
                ("ego/front", "ego/front/optical")
            ]
        );
        let found = message.transforms[1].translation.unwrap();
        assert!(
            (found.x - 1.5).abs() < 1e-9
                && (found.y - 0.25).abs() < 1e-9
                && (found.z - 1.6).abs() < 1e-9,
            "{found:?}"
        );
        assert!(
            state
                .frame_extras(&TopicName::new("ego/front/rgb").unwrap(), &frame)
                .is_empty(),
            "once per sensor and tick"
        );
    }

    #[test]
    fn an_actor_that_left_is_deleted_from_the_scene() {
        let mut state = SnapshotConverter::default();
        let header: SnapshotHeader = Zeroable::zeroed();
        state.snapshot_entries(
            &header,
            &[record(7, Pose::IDENTITY), record(8, Pose::IDENTITY)],
        );
        let entries = state.snapshot_entries(&header, &[record(8, Pose::IDENTITY)]);
        let update = fox::SceneUpdate::decode(entries[1].bytes.as_slice()).unwrap();
        assert_eq!(
            update
                .deletions
                .iter()
                .map(|d| d.id.as_str())
                .collect::<Vec<_>>(),
            ["actor_7"]
        );
        assert_eq!(update.entities.len(), 1);
        assert_eq!(update.entities[0].cubes[0].size.unwrap().x, 4.0);
    }
}
