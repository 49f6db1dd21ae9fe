//! Frames that the CPU makes: radar, motion, events of actors. They are written into their loans and
//! sent before the views of their tick.

use nalgebra::Vector3;
use schema_bus::FrameLoan;
use schema_frames::{CollisionEvent, LaneCrossing, ObstacleEvent};
use schema_roads::RoadMap;
use sensor_core::imu::{ImuNoise, STANDARD_GRAVITY_MPS2};
use sensor_core::lane_marks::PaintedLines;
use sensor_core::{Drift, gnss, imu};
use sensor_ray::{BallFilter, RadarPose, RayScene, radar};
use sensor_spec::{MAX_EVENTS_PER_TICK, ObstacleSpec, SensorSpec};

use super::rays::TickRays;
use super::shot::Shot;
use crate::sensor::{Model, Sensor};

/// Fires a sensor that is neither a view nor a lidar and measures no motion; returns whether a frame
/// was sent.
pub(super) fn fire(
    shot: &Shot<'_>,
    sensor: &mut Sensor,
    rays: &mut TickRays<'_>,
    painted: &mut Option<PaintedLines>,
) -> bool {
    match (&sensor.model, &sensor.spec) {
        (Model::Radar(_), SensorSpec::Radar(_)) => radar(shot, sensor, rays),
        (Model::Obstacle, SensorSpec::Obstacle(spec)) => {
            let found = obstacle(shot, spec, rays.current());
            send_events(shot, sensor, &Vec::from_iter(found))
        }
        (Model::Collision, _) => send_events(shot, sensor, &collisions(shot)),
        (Model::LaneInvasion { corners }, _) => {
            let lines = painted
                .get_or_insert_with(|| shot.tick.roads.map(painted_lines).unwrap_or_default());
            let now = shot.due.carrier.lower_corners;
            let crossings = corners
                .map(|before| lines.crossings(&before, &now, shot.due.firing.window_nanos))
                .unwrap_or_default();
            sensor.model = Model::LaneInvasion { corners: Some(now) };
            send_events(shot, sensor, &crossings)
        }
        _ => unreachable!("a sensor's model is made from its spec"),
    }
}

fn radar(shot: &Shot<'_>, sensor: &mut Sensor, rays: &mut TickRays<'_>) -> bool {
    let mut header = shot.only_header(sensor);
    let topic = &mut sensor.topics[0];
    let Some(mut loan) = topic.loan_if_read(shot.audience) else {
        return false;
    };
    let (Model::Radar(found), SensorSpec::Radar(spec)) = (&mut sensor.model, &sensor.spec) else {
        return false;
    };
    let n_rays = spec
        .rays_per_frame(shot.tick.scene.period_nanos as f64 * 1e-9)
        .min(topic.max_elements());
    let velocity_in_world_mps = shot.due.carrier.velocity_in_world_mps;
    let pose = RadarPose {
        world_from_sensor: shot.world_from_sensor,
        velocity_in_world_mps,
    };
    let carrier = Some(shot.due.carrier.parent).filter(|parent| parent.0 != 0);
    found.clear();
    radar::scan(
        spec,
        rays.current(),
        &pose,
        n_rays,
        shot.noise,
        carrier,
        found,
    );
    let bytes: &[u8] = bytemuck::cast_slice(found);
    loan.payload_mut()[..bytes.len()].copy_from_slice(bytes);
    header.set_list(found.len() as u32);
    header.range_limit_m = spec.range_m as f32;
    shot.send(sensor, loan, header);
    true
}

/// Fires an IMU or a GNSS receiver; returns whether a frame was sent.
pub(super) fn motion(shot: &Shot<'_>, sensor: &mut Sensor) -> bool {
    let mut header = shot.only_header(sensor);
    let Some(mut loan) = sensor.topics[0].loan_if_read(shot.audience) else {
        return false;
    };
    match (&mut sensor.model, &sensor.spec) {
        (Model::Imu(state), SensorSpec::Imu(spec)) => {
            let felt = state
                .at(&shot.due.carrier.mount(), STANDARD_GRAVITY_MPS2)
                .expect("a state was pushed in this tick");
            let noise = ImuNoise {
                of_tick: shot.noise,
                drift: Drift {
                    seed: shot.tick.stamp.seed,
                    stream: sensor.stream.number(),
                    age_nanos: shot.tick.scene.sim_time.0 - sensor.schedule.made_at().0,
                },
                window_secs: shot.due.firing.window_nanos as f64 * 1e-9,
            };
            put(&mut loan, &[imu::sample(spec, &felt, &noise)]);
        }
        (Model::Gnss, SensorSpec::Gnss(spec)) => {
            let place = shot.world_from_sensor.translation.vector.into();
            put(
                &mut loan,
                &[gnss::sample(
                    spec,
                    &shot.tick.stamp.geo_reference,
                    &place,
                    shot.noise,
                )],
            );
        }
        _ => return false,
    }
    header.set_list(1);
    shot.send(sensor, loan, header);
    true
}

fn obstacle(shot: &Shot<'_>, spec: &ObstacleSpec, rays: &RayScene) -> Option<ObstacleEvent> {
    let forward = shot.world_from_sensor.rotation * Vector3::x();
    let from = shot.world_from_sensor.translation.vector.into();
    let ignored = Some(shot.due.carrier.parent).filter(|parent| parent.0 != 0);
    let filter = BallFilter {
        ignored,
        only_traffic: spec.only_dynamics,
    };
    let hit = rays.move_ball(&from, &forward, spec.hit_radius_m, spec.distance_m, filter)?;
    let contact = shot
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

fn collisions(shot: &Shot<'_>) -> Vec<CollisionEvent> {
    let (all, parent) = (shot.tick.collisions, shot.due.carrier.parent);
    let first = all.partition_point(|(actor, _)| *actor < parent);
    all[first..]
        .iter()
        .take_while(|(actor, _)| *actor == parent)
        .map(|(_, event)| *event)
        .collect()
}

/// Sends a frame if something happened. Its `seq` counts such frames, read or not.
fn send_events<T: bytemuck::Pod>(shot: &Shot<'_>, sensor: &mut Sensor, events: &[T]) -> bool {
    if events.is_empty() {
        return false;
    }
    sensor.n_event_frames += 1;
    let Some(mut loan) = sensor.topics[0].loan_if_read(shot.audience) else {
        return false;
    };
    let events = &events[..events.len().min(MAX_EVENTS_PER_TICK)];
    put(&mut loan, events);
    let mut header = shot.only_header(sensor);
    header.seq = sensor.n_event_frames;
    header.set_list(events.len() as u32);
    shot.send(sensor, loan, header);
    true
}

/// Longest piece of a painted line that is taken as straight, metres. On a bend of 20 m radius this
/// is off by 6 mm.
const STRAIGHT_M: f64 = 1.0;

/// A map's painted lines in the form that lane invasion detectors need.
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

    /// The numbers in SPEC.md are the discriminants of the enums in `schema_roads`.
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
