//! Frames that the CPU makes: rays, motion, events of actors. Written into their loans and sent
//! before the views of their tick.

use std::rc::Rc;

use nalgebra::{Isometry3, Vector3};
use schema_bus::{FrameLoan, mono_now};
use schema_frames::{CollisionEvent, FrameHeader, LaneCrossing, ObstacleEvent};
use schema_roads::RoadMap;
use schema_types::noise::Noise;
use sensor_core::imu::STANDARD_GRAVITY_MPS2;
use sensor_core::lane_marks::PaintedLines;
use sensor_core::scene::Scene;
use sensor_core::schedule::Firing;
use sensor_core::{gnss, imu};
use sensor_ray::{BallFilter, RadarPose, RayScene, radar};
use sensor_spec::{MAX_EVENTS_PER_TICK, ObstacleSpec, SensorSpec};
use simd_world::Collision;

use super::{Carrier, Sensors, Stamp, base_header, remember};
use crate::rig::{Model, Rig, Sensor};

/// What the world has to say of one tick besides poses.
pub struct TickEvents<'a> {
    /// By (actor, other).
    pub collisions: &'a [Collision],
    /// Roads of the map.
    pub roads: Option<&'a RoadMap>,
}

/// One sensor in one tick.
pub(super) struct Shot<'a> {
    pub scene: &'a Scene,
    stamp: &'a Stamp,
    firing: &'a Firing,
    carrier: &'a Carrier,
    pub world_from_sensor: Isometry3<f64>,
    pub noise: Noise,
}

impl Sensors {
    /// Fires what is due and not the GPU's (`lidars_are_cast`: nor are lidars); returns the rigs
    /// whose readers are to be woken.
    pub(super) fn fire_on_cpu(
        &mut self,
        scene: &Scene,
        stamp: &Stamp,
        events: &TickEvents<'_>,
        due: &[(usize, Firing, Carrier)],
        lidars_are_cast: bool,
    ) -> anyhow::Result<Vec<Rc<Rig>>> {
        let mut waking = Vec::new();
        let read_everything = self.read_everything;
        let mut rays = TickRays {
            scene: self.rays.as_mut(),
            tick: scene,
            is_current: false,
        };
        for (sensor_idx, firing, carrier) in due {
            let sensor = &mut self.sensors[*sensor_idx];
            let shot = Shot::new(scene, stamp, firing, carrier, sensor);
            let sent = match (&sensor.model, &sensor.spec) {
                (Model::View(_), _) => continue,
                (Model::Lidar { .. }, _) if lidars_are_cast => continue,
                (Model::Lidar { .. }, _) => {
                    let cast = shot.lidar(sensor, &mut rays, read_everything);
                    self.n_lidar_turns += cast as u64;
                    cast
                }
                (Model::Radar(_), SensorSpec::Radar(_)) => {
                    shot.radar(sensor, &mut rays, read_everything)
                }
                (Model::Imu(_) | Model::Gnss, _) => shot.motion(sensor, read_everything),
                (Model::Obstacle, SensorSpec::Obstacle(spec)) => {
                    let found = shot.obstacle(spec, rays.current());
                    shot.send_events(sensor, &Vec::from_iter(found), read_everything)
                }
                (Model::Collision, _) => {
                    shot.send_events(sensor, &shot.collisions(events.collisions), read_everything)
                }
                (Model::LaneInvasion { corners }, _) => {
                    let lines = self
                        .painted
                        .get_or_insert_with(|| events.roads.map(painted_lines).unwrap_or_default());
                    let crossings = corners.map(|before| {
                        lines.crossings(&before, &carrier.lower_corners, firing.window_nanos)
                    });
                    sensor.model = Model::LaneInvasion {
                        corners: Some(carrier.lower_corners),
                    };
                    shot.send_events(sensor, &crossings.unwrap_or_default(), read_everything)
                }
                _ => unreachable!("a sensor's model is made from its spec"),
            };
            if sent {
                remember(&mut waking, &sensor.rig);
            }
        }
        Ok(waking)
    }
}

/// The ray scene, brought up to the tick when first asked for.
pub(super) struct TickRays<'a> {
    scene: Option<&'a mut RayScene>,
    tick: &'a Scene,
    is_current: bool,
}

impl TickRays<'_> {
    pub fn current(&mut self) -> &RayScene {
        let scene = self
            .scene
            .as_mut()
            .expect("loaded with the map because there is a sensor that casts rays");
        if !std::mem::replace(&mut self.is_current, true) {
            scene.update(&self.tick.dynamics);
        }
        scene
    }
}

impl<'a> Shot<'a> {
    pub fn new(
        scene: &'a Scene,
        stamp: &'a Stamp,
        firing: &'a Firing,
        carrier: &'a Carrier,
        sensor: &Sensor,
    ) -> Self {
        let world_from_sensor = carrier.world_from_sensor.isometry();
        let noise = Noise::new(stamp.seed, sensor.stream, scene.tick.0);
        Shot {
            scene,
            stamp,
            firing,
            carrier,
            world_from_sensor,
            noise,
        }
    }

    pub fn header(&self, sensor: &Sensor, topic_idx: usize) -> FrameHeader {
        base_header(
            sensor.topics[topic_idx].modality,
            self.scene,
            self.stamp,
            sensor.actor,
            self.firing,
            self.carrier,
        )
    }

    /// Sends a filled loan of the sensor's only topic.
    pub fn send(
        &self,
        sensor: &mut Sensor,
        loan: FrameLoan,
        mut header: FrameHeader,
        print_hash: bool,
    ) {
        header.rendered_mono_nanos = mono_now().0;
        sensor.topics[0].send(loan, header, print_hash);
    }

    fn radar(&self, sensor: &mut Sensor, rays: &mut TickRays<'_>, read_everything: bool) -> bool {
        let mut header = self.header(sensor, 0);
        let topic = &mut sensor.topics[0];
        let Some(mut loan) = topic.loan_if_read(read_everything) else {
            return false;
        };
        let (Model::Radar(found), SensorSpec::Radar(spec)) = (&mut sensor.model, &sensor.spec)
        else {
            return false;
        };
        let room = topic.max_payload_bytes / topic.modality.element_bytes();
        let n_rays = spec
            .rays_per_frame(self.scene.period_nanos as f64 * 1e-9)
            .min(room as u32);
        let velocity_in_world_mps = self.carrier.velocity_in_world_mps;
        let pose = RadarPose {
            world_from_sensor: self.world_from_sensor,
            velocity_in_world_mps,
        };
        let carrier = Some(self.carrier.parent).filter(|parent| parent.0 != 0);
        found.clear();
        radar::scan(
            spec,
            rays.current(),
            &pose,
            n_rays,
            self.noise,
            carrier,
            found,
        );
        let bytes: &[u8] = bytemuck::cast_slice(found);
        loan.payload_mut()[..bytes.len()].copy_from_slice(bytes);
        header.set_list(found.len() as u32);
        header.range_limit_m = spec.range_m as f32;
        self.send(sensor, loan, header, read_everything);
        true
    }

    fn motion(&self, sensor: &mut Sensor, read_everything: bool) -> bool {
        let mut header = self.header(sensor, 0);
        let Some(mut loan) = sensor.topics[0].loan_if_read(read_everything) else {
            return false;
        };
        match (&mut sensor.model, &sensor.spec) {
            (Model::Imu(motion), SensorSpec::Imu(spec)) => {
                let mount = self
                    .carrier
                    .body
                    .world_from_vehicle
                    .inv_mul(&self.world_from_sensor);
                let input = motion
                    .at(&mount, STANDARD_GRAVITY_MPS2)
                    .expect("a state was pushed in this tick");
                put(&mut loan, &[imu::sample(spec, &input, self.noise)]);
            }
            (Model::Gnss, SensorSpec::Gnss(spec)) => {
                let place = self.world_from_sensor.translation.vector.into();
                put(
                    &mut loan,
                    &[gnss::sample(
                        spec,
                        &self.stamp.geo_reference,
                        &place,
                        self.noise,
                    )],
                );
            }
            _ => return false,
        }
        header.set_list(1);
        self.send(sensor, loan, header, read_everything);
        true
    }

    fn obstacle(&self, spec: &ObstacleSpec, rays: &RayScene) -> Option<ObstacleEvent> {
        let forward = self.world_from_sensor.rotation * Vector3::x();
        let from = self.world_from_sensor.translation.vector.into();
        let ignored = Some(self.carrier.parent).filter(|parent| parent.0 != 0);
        let filter = BallFilter {
            ignored,
            only_traffic: spec.only_dynamics,
        };
        let hit = rays.move_ball(&from, &forward, spec.hit_radius_m, spec.distance_m, filter)?;
        let contact = self
            .world_from_sensor
            .inverse_transform_point(&hit.contact_in_world_m);
        Some(ObstacleEvent {
            distance_m: hit.distance_m as f32,
            object_id: hit.object.0,
            class: hit.class.0,
            reserved: [0; 3],
            contact_in_sensor_m: contact.coords.cast::<f32>().into(),
            reserved1: [0; 2],
        })
    }

    fn collisions(&self, all: &[Collision]) -> Vec<CollisionEvent> {
        let first = all.partition_point(|collision| collision.actor < self.carrier.parent);
        let mine = all[first..]
            .iter()
            .take_while(|collision| collision.actor == self.carrier.parent);
        let event = |collision: &Collision| CollisionEvent {
            other_id: collision.other.map_or(0, |other| other.0),
            class: collision.other_class.0,
            reserved: [0; 3],
            impulse_in_world_ns: collision.impulse_in_world_ns,
            point_in_world_m: collision.point_in_world_m,
            reserved1: 0,
        };
        mine.map(event).collect()
    }

    /// Sends a frame if something happened. Its `seq` counts such frames, read or not.
    fn send_events<T: bytemuck::Pod>(
        &self,
        sensor: &mut Sensor,
        events: &[T],
        read_everything: bool,
    ) -> bool {
        if events.is_empty() {
            return false;
        }
        sensor.n_event_frames += 1;
        let Some(mut loan) = sensor.topics[0].loan_if_read(read_everything) else {
            return false;
        };
        let events = &events[..events.len().min(MAX_EVENTS_PER_TICK)];
        put(&mut loan, events);
        let mut header = self.header(sensor, 0);
        header.seq = sensor.n_event_frames;
        header.set_list(events.len() as u32);
        self.send(sensor, loan, header, read_everything);
        true
    }
}

/// Longest stretch of a painted line that is taken as straight, metres: 6 mm off on a bend of 20 m.
const STRAIGHT_M: f64 = 1.0;

/// A map's painted lines as lane invasion detectors take them.
fn painted_lines(roads: &RoadMap) -> PaintedLines {
    let line = |line: schema_roads::MarkLine| sensor_core::PaintedLine {
        what: LaneCrossing {
            mark: line.kind as u8,
            colour: line.colour as u8,
            lane_change: line.to_smaller as u8 | (line.to_greater as u8) << 1,
            lane: line.lane,
            width_m: line.width_m as f32,
            road: line.road,
            ..bytemuck::Zeroable::zeroed()
        },
        points: line.points,
    };
    PaintedLines::new(roads.mark_lines(STRAIGHT_M).into_iter().map(line).collect())
}

/// Writes records to the front of a loan.
fn put<T: bytemuck::Pod>(loan: &mut FrameLoan, records: &[T]) {
    let bytes: &[u8] = bytemuck::cast_slice(records);
    loan.payload_mut()[..bytes.len()].copy_from_slice(bytes);
}

#[cfg(test)]
mod tests {
    use schema_roads::{MarkColour, MarkKind};

    /// The numbers of SPEC.md are those of the roads' own lists.
    #[test]
    fn marks_have_the_numbers_of_the_specification() {
        let kinds = [
            MarkKind::Solid,
            MarkKind::Broken,
            MarkKind::SolidSolid,
            MarkKind::SolidBroken,
            MarkKind::BrokenSolid,
        ];
        assert_eq!(kinds.map(|kind| kind as u8), [1, 2, 3, 4, 5]);
        let kinds = [
            MarkKind::BrokenBroken,
            MarkKind::BottsDots,
            MarkKind::Grass,
            MarkKind::Kerb,
            MarkKind::Other,
        ];
        assert_eq!(kinds.map(|kind| kind as u8), [6, 7, 8, 9, 10]);
        let colours = [
            MarkColour::White,
            MarkColour::Yellow,
            MarkColour::Blue,
            MarkColour::Green,
            MarkColour::Red,
        ];
        assert_eq!(colours.map(|colour| colour as u8), [0, 1, 2, 3, 4]);
        assert_eq!([MarkColour::Orange as u8, MarkColour::Violet as u8], [5, 6]);
    }
}
