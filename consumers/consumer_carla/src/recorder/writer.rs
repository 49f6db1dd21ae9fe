//! Writes a recording, one frame per snapshot.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use consumer_kit::WorldAt;
use crossbeam_channel::Receiver;
use schema_frames::scenery::LampChange;
use schema_frames::{ActorKind, ActorRecord};

use crate::recorder::changes::StreetLight;
use crate::recorder::disk::{Disk, MAX_WAITING_BYTES, Refused, Unfinished};
use crate::recorder::frame::{Born, Collision, Frame, Head, Light, Origin, Pedals, family};
use crate::recorder::own_file::VERSION;
use crate::recorder::text;
use crate::recorder::watch::{Asked, Wanted};
use crate::state::blueprints;
use crate::state::known_world::Known;
use crate::wire::axes;
use crate::wire::description::{Attribute, Description};

/// Bodies nearer than this count as touching when both report a contact, metres.
const TOUCH_M: f64 = 0.3;

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file cannot be created.
    #[error("cannot write {}: {cause}", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// Why.
        cause: std::io::Error,
    },
    /// The file cannot be written, for example because the disk is full.
    #[error("cannot write the recording: {0}")]
    Write(std::io::Error),
    /// The file could not be written; [`Writer::finish`] says why.
    #[error("the file of the recording can no longer be written")]
    Ended,
    /// The disk takes less than is recorded.
    #[error(
        "the disk is too slow for the recording: more than {} MiB wait to be written; record fewer actors or onto a faster disk",
        MAX_WAITING_BYTES >> 20
    )]
    Behind,
    /// Another episode has begun, and a recording holds only one.
    #[error("another map was loaded")]
    OtherMap,
}

/// A recording that is being written.
#[derive(Debug)]
pub struct Writer {
    disk: Disk,
    with_motion: bool,
    episode: Option<u64>,
    alive: BTreeSet<u32>,
    touching: BTreeSet<(u32, u32)>,
    last_tick: u64,
    elapsed_nanos: u64,
    began: Instant,
    light_times: BTreeMap<u32, [f32; 3]>,
    street_lights: BTreeMap<u32, StreetLight>,
    /// Vehicles whose physics control was set since the last tick.
    physics_set: BTreeSet<u32>,
}

/// Whether an actor's pose is recorded. Attached sensors move with their carriers and are left out.
fn can_move(record: &ActorRecord) -> bool {
    match record.kind() {
        Some(ActorKind::Vehicle | ActorKind::Walker | ActorKind::Prop | ActorKind::Spectator) => {
            true
        }
        Some(ActorKind::Sensor) => record.parent_id == 0,
        _ => false,
    }
}

impl Writer {
    /// Creates the file of a recording on this map; `with_motion` adds CARLA's additional data.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path, map: String, with_motion: bool) -> Result<Writer, WriteError> {
        let cannot = |cause: std::io::Error| WriteError::Create {
            path: path.to_owned(),
            cause,
        };
        std::fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).map_err(cannot)?;
        let mut file = BufWriter::new(File::create(path).map_err(cannot)?);
        let mut head = Vec::new();
        Head {
            origin: Origin::Gantry,
            version: VERSION,
            map,
            date: date(SystemTime::now()),
        }
        .write(&mut head);
        file.write_all(&head).map_err(cannot)?;
        Ok(Writer {
            disk: Disk::new(file).map_err(cannot)?,
            with_motion,
            episode: None,
            alive: BTreeSet::new(),
            touching: BTreeSet::new(),
            last_tick: 0,
            elapsed_nanos: 0,
            began: Instant::now(),
            light_times: BTreeMap::new(),
            street_lights: BTreeMap::new(),
            physics_set: BTreeSet::new(),
        })
    }

    /// Notes that a vehicle's physics control was set.
    pub fn note_physics(&mut self, actor_id: u32) {
        if self.with_motion {
            self.physics_set.insert(actor_id);
        }
    }

    /// Notes that street lights were set. Clients always send all values of a light.
    pub fn note_street_lights(&mut self, changes: &[LampChange]) {
        for change in changes {
            if let (Some(on), Some(intensity_lm), Some(rgb)) =
                (change.on, change.intensity_lm, change.rgb)
            {
                self.street_lights.insert(
                    change.lamp,
                    StreetLight {
                        on,
                        intensity_lm,
                        rgb,
                    },
                );
            }
        }
    }

    /// What the simulator has to be asked for before this snapshot is written.
    pub fn wanted(&mut self, snapshot: &WorldAt) -> Wanted {
        let mut wanted = Wanted::default();
        if self.with_motion && snapshot.header.tick > self.last_tick {
            let set = std::mem::take(&mut self.physics_set);
            for record in &snapshot.records {
                if record.vehicle().is_some()
                    && (!self.alive.contains(&record.id) || set.contains(&record.id))
                {
                    wanted.vehicles.push(record.id);
                } else if record.walker().is_some() {
                    wanted.walkers.push(record.id);
                }
            }
        }
        wanted
    }

    /// Hands a frame to the thread that writes it; `asked` is what was [`wanted`](Writer::wanted).
    ///
    /// # Errors
    /// If the file could not be written, its disk is too slow, or another episode has begun.
    pub fn write(
        &mut self,
        snapshot: &Arc<WorldAt>,
        known: &Known,
        asked: Asked,
    ) -> Result<(), WriteError> {
        let header = &snapshot.header;
        let episode = crate::wire::world_message::episode_id(header);
        if *self.episode.get_or_insert(episode) != episode {
            return Err(WriteError::OtherMap);
        }
        if header.tick <= self.last_tick {
            return Ok(());
        }
        // The first frame has time 0.
        if self.last_tick != 0 {
            self.elapsed_nanos += header.period_nanos;
        }
        self.last_tick = header.tick;
        let unfinished = Unfinished {
            frame: self.frame(snapshot, known),
            snapshot: snapshot.clone(),
            weather: known.info.as_ref().map(|info| info.weather),
            street_lights: std::mem::take(&mut self.street_lights),
            asked,
        };
        self.disk.put(unfinished).map_err(|refused| match refused {
            Refused::Behind => WriteError::Behind,
            Refused::Ended => WriteError::Ended,
        })
    }

    /// Ends when all frames that were handed over so far are written.
    pub fn written(&self) -> Receiver<()> {
        self.disk.mark()
    }

    /// Waits until all is written, and closes the file.
    ///
    /// # Errors
    /// If the file could not be written.
    pub fn finish(self) -> Result<(), WriteError> {
        self.disk.finish().map_err(WriteError::Write)
    }

    fn frame(&mut self, snapshot: &WorldAt, known: &Known) -> Frame {
        let header = &snapshot.header;
        let mut frame = Frame {
            tick: header.tick,
            elapsed_secs: self.elapsed_nanos as f64 * 1e-9,
            delta_secs: header.period_nanos as f64 * 1e-9,
            ..Frame::default()
        };
        let records = || {
            snapshot
                .records
                .iter()
                .filter(|record| record.kind().is_some())
        };
        let now: BTreeSet<u32> = records().map(|record| record.id).collect();
        frame.gone = self.alive.difference(&now).copied().collect();
        for record in records() {
            let at = axes::transform(&record.world_from_actor);
            if !self.alive.contains(&record.id) {
                let description = described(known, record);
                frame.born.push(Born {
                    id: record.id,
                    parent: record.parent_id,
                    family: family(&description.type_id),
                    description,
                    at,
                    on_parent: false,
                });
            }
            if can_move(record) {
                frame.poses.insert(record.id, at);
            }
            if let Some(part) = record.vehicle() {
                let steer = axes::steer(part.steer_ratio) + 0.0;
                let hand_brake = part.control_flags & 1 != 0;
                let pedals = Pedals {
                    steer,
                    throttle: part.throttle_ratio,
                    brake: part.brake_ratio,
                    hand_brake,
                    gear: part.gear,
                };
                frame.pedals.insert(record.id, pedals);
                frame.lamps.insert(record.id, part.lamps);
            }
            if let Some(part) = record.walker() {
                frame.gaits.insert(record.id, part.gait_mps);
            }
            if let Some(part) = record.traffic_light() {
                let light = Light {
                    state: part.state.min(4) as u8,
                    frozen: part.flags & 1 != 0,
                    elapsed_secs: part.elapsed_secs,
                };
                frame.lights.insert(record.id, light);
            }
            if self.with_motion {
                self.add_extra(&mut frame, record, known);
            }
            if self.with_motion && can_move(record) {
                let turning_deg =
                    axes::angular_velocity_deg(record.angular_velocity_in_world_radps);
                frame.motions.insert(
                    record.id,
                    [axes::mirror(record.velocity_in_world_mps), turning_deg],
                );
            }
        }
        let touching = touching(snapshot);
        let began = touching.difference(&self.touching);
        frame.collisions = began
            .map(|actors| Collision {
                // Readers number them.
                number: 0,
                actors: *actors,
            })
            .collect();
        frame.extra.platform_secs = self.with_motion.then(|| self.began.elapsed().as_secs_f64());
        (self.alive, self.touching) = (now, touching);
        frame
    }

    fn add_extra(&mut self, frame: &mut Frame, record: &ActorRecord, known: &Known) {
        if !self.alive.contains(&record.id) {
            frame.extra.note(known, record);
        }
        if let Some(part) = record.traffic_light() {
            let times = [part.green_secs, part.yellow_secs, part.red_secs];
            if self.light_times.insert(record.id, times) != Some(times) {
                frame.extra.light_times.insert(record.id, times);
            }
        }
    }
}

/// An actor's description. Traffic lights also get the id of their OpenDRIVE signal, by which a
/// replay finds them in other runs.
fn described(known: &Known, record: &ActorRecord) -> Description {
    let mut description = description(known, record.id);
    if let Some(part) = record.traffic_light() {
        let value = part.opendrive_id().to_owned();
        description.attributes.push(Attribute {
            name: "opendrive_id".into(),
            kind: 4,
            value,
        });
    }
    description
}

fn description(known: &Known, id: u32) -> Description {
    let listed = || {
        let info = known.actors.get(&id)?;
        Some(blueprints::describe(
            info,
            known.entry(&info.type_id).map(|(_, entry)| entry),
        ))
    };
    let nobody = || Description {
        type_id: "unknown".into(),
        attributes: Vec::new(),
    };
    known
        .own
        .get(&id)
        .map(|own| own.description.clone())
        .or_else(listed)
        .unwrap_or_else(nobody)
}

/// Pairs in contact, smaller id first. A snapshot states of each actor only that it touches
/// something: two such actors side by side are taken to touch each other, one alone to touch
/// scenery (0).
fn touching(snapshot: &WorldAt) -> BTreeSet<(u32, u32)> {
    let touched: Vec<&ActorRecord> = snapshot
        .records
        .iter()
        .filter(|record| record.flags & ActorRecord::TOUCHED != 0)
        .collect();
    let mut pairs = BTreeSet::new();
    for (idx, record) in touched.iter().enumerate() {
        let mut alone = true;
        for (other_idx, other) in touched.iter().enumerate() {
            if other_idx != idx && are_close(record, other) {
                alone = false;
                pairs.insert((record.id.min(other.id), record.id.max(other.id)));
            }
        }
        if alone {
            pairs.insert((record.id, 0));
        }
    }
    pairs
}

/// Whether two upright boxes come within [`TOUCH_M`] of each other, by separating axes in the
/// plane.
fn are_close(a: &ActorRecord, b: &ActorRecord) -> bool {
    let poses = [a, b].map(|record| record.world_from_actor.isometry());
    let apart = poses[1].translation.vector - poses[0].translation.vector;
    let halves = [a, b].map(|record| record.half_box_m.map(f64::from));
    let directions = [0, 1].map(|i| {
        [
            poses[i] * nalgebra::Vector3::x(),
            poses[i] * nalgebra::Vector3::y(),
        ]
    });
    let reach = |i: usize, axis: &nalgebra::Vector3<f64>| {
        halves[i][0] * directions[i][0].dot(axis).abs()
            + halves[i][1] * directions[i][1].dot(axis).abs()
    };
    let in_plane = directions
        .iter()
        .flatten()
        .all(|axis| apart.dot(axis).abs() <= reach(0, axis) + reach(1, axis) + TOUCH_M);
    in_plane && apart.z.abs() <= 2.0 * halves[0][2].max(halves[1][2])
}

/// `2026-01-31 23:59:59`, UTC.
fn date(time: SystemTime) -> String {
    let secs = time
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_secs() as i64);
    let ([year, month, day], time) = text::date(secs);
    format!("{year:04}-{month:02}-{day:02} {time}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use schema_frames::SnapshotHeader;
    use schema_types::Pose;
    use std::time::Duration;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (secs, expected) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_400, "2000-02-29 00:00:00"),
            (1_798_761_599, "2026-12-31 23:59:59"),
        ] {
            assert_eq!(date(UNIX_EPOCH + Duration::from_secs(secs)), expected);
        }
    }

    #[test]
    fn two_that_touch_side_by_side_are_a_pair_and_one_alone_hit_scenery() {
        let car = |id: u32, x_m: f64, y_m: f64, flags: u32| ActorRecord {
            id,
            kind: ActorKind::Vehicle as u16,
            world_from_actor: Pose::from_xyz_yaw(x_m, y_m, 0.0, 0.3),
            half_box_m: [2.4, 1.0, 0.7],
            flags,
            ..ActorRecord::zeroed()
        };
        let touched = ActorRecord::TOUCHED;
        let records = vec![
            car(3, 0.0, 0.0, touched),
            car(5, 4.6, 1.4, touched),
            car(6, 0.0, 3.0, 0),
            car(9, 100.0, 0.0, touched),
        ];
        let snapshot = WorldAt {
            header: SnapshotHeader::zeroed(),
            records,
        };
        assert_eq!(touching(&snapshot), [(3, 5), (9, 0)].into());
    }
}
