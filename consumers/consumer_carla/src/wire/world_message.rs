//! The message of the world stream: one per tick, with every actor.

use schema_frames::{ActorKind, ActorRecord, SnapshotHeader};

use crate::wire::axes;

/// Sensor type of the world stream in 0.9.16; any other number ends the client's process.
const WORLD_SNAPSHOT: u64 = 17;
/// Simulation state bit: the client drops its cached map.
pub const MAP_CHANGED: u32 = 1;
/// Simulation state bit: the client asks for the lights again.
pub const LIGHTS_CHANGED: u32 = 2;
const ACTIVE: u8 = 1;
/// CARLA's speed limit before a vehicle has passed any sign; used where the map states none.
const LIMIT_BEFORE_SIGNS_KMH: f32 = 30.0;
const PART_BYTES: usize = 54;
/// Bytes before the actors: the header of every sensor message, and the episode's header.
pub const HEADER_BYTES: usize = 48 + 36;
/// Bytes per actor.
pub const ACTOR_BYTES: usize = 65 + PART_BYTES;

/// CARLA's id of an episode; it changes with every map load and every restart of the simulator.
pub fn episode_id(header: &SnapshotHeader) -> u64 {
    header.epoch.wrapping_add(u64::from(header.episode))
}

/// Seconds since the episode began, computed from integers.
fn elapsed_secs(header: &SnapshotHeader) -> f64 {
    header.sim_nanos.saturating_sub(header.episode_start_nanos) as f64 * 1e-9
}

/// The message of one snapshot. `state_bits` as [`MAP_CHANGED`]; `wall_secs` is the machine's
/// clock.
pub fn encode(
    header: &SnapshotHeader,
    records: &[ActorRecord],
    state_bits: u32,
    wall_secs: f64,
) -> Vec<u8> {
    let mut out = Vec::with_capacity(HEADER_BYTES + records.len() * ACTOR_BYTES);
    out.extend(WORLD_SNAPSHOT.to_le_bytes());
    out.extend(header.tick.to_le_bytes());
    out.extend(elapsed_secs(header).to_le_bytes());
    out.extend([0; 24]);
    out.extend(episode_id(header).to_le_bytes());
    out.extend(wall_secs.to_le_bytes());
    out.extend((header.period_nanos as f32 * 1e-9).to_le_bytes());
    out.extend([0; 12]);
    out.extend(state_bits.to_le_bytes());
    records
        .iter()
        .for_each(|record| push_actor(&mut out, record));
    out
}

fn push_actor(out: &mut Vec<u8>, record: &ActorRecord) {
    let is_sign = matches!(
        record.kind(),
        Some(ActorKind::TrafficLight | ActorKind::TrafficSign)
    );
    let pose = if is_sign {
        axes::sign_pose(&record.world_from_actor)
    } else {
        record.world_from_actor
    };
    let transform = axes::transform(&pose);
    let start = out.len();
    out.extend(record.id.to_le_bytes());
    out.push(ACTIVE);
    let vectors = [
        transform.location_m,
        transform.rotation_deg,
        axes::mirror(record.velocity_in_world_mps),
        axes::angular_velocity_deg(record.angular_velocity_in_world_radps),
        axes::mirror(record.acceleration_in_world_mps2),
    ];
    push_floats(out, vectors.into_iter().flatten().map(|x| x as f32));
    match record.kind() {
        Some(ActorKind::Vehicle) => push_vehicle(out, record),
        Some(ActorKind::TrafficLight) => push_light(out, record),
        Some(ActorKind::TrafficSign) => out.extend(
            record
                .traffic_sign()
                .map_or([0; 32], |part| part.opendrive_id),
        ),
        Some(ActorKind::Walker) => push_walker(out, record),
        _ => {}
    }
    out.resize(start + ACTOR_BYTES, 0);
}

fn push_floats(out: &mut Vec<u8>, values: impl IntoIterator<Item = f32>) {
    // Numbers that are not finite would spread through scripts.
    values
        .into_iter()
        .for_each(|x| out.extend(if x.is_finite() { x } else { 0.0 }.to_le_bytes()));
}

fn push_vehicle(out: &mut Vec<u8>, record: &ActorRecord) {
    let Some(part) = record.vehicle() else { return };
    push_floats(
        out,
        [
            part.throttle_ratio,
            axes::steer(part.steer_ratio) + 0.0,
            part.brake_ratio,
        ],
    );
    let flag = |bit: u32| u8::from(part.control_flags & bit != 0);
    out.extend([flag(1), flag(2), flag(4)]);
    out.extend(part.gear.to_le_bytes());
    push_floats(
        out,
        [if part.speed_limit_mps > 0.0 {
            axes::kmh(part.speed_limit_mps)
        } else {
            LIMIT_BEFORE_SIGNS_KMH
        }],
    );
    out.push(part.light_state.min(4) as u8);
    out.push(u8::from(part.light_actor_id != 0));
    out.extend(part.light_actor_id.to_le_bytes());
    out.push(0);
}

fn push_light(out: &mut Vec<u8>, record: &ActorRecord) {
    let Some(part) = record.traffic_light() else {
        return;
    };
    out.extend(part.opendrive_id);
    push_floats(
        out,
        [
            part.green_secs,
            part.yellow_secs,
            part.red_secs,
            part.elapsed_secs,
        ],
    );
    out.extend(part.pole_idx.to_le_bytes());
    out.push(u8::from(part.flags & 1 != 0));
    out.push(part.state.min(4) as u8);
}

fn push_walker(out: &mut Vec<u8>, record: &ActorRecord) {
    let Some(part) = record.walker() else { return };
    push_floats(out, axes::mirror(part.direction));
    push_floats(out, [part.speed_mps]);
    out.push((part.flags & 1) as u8);
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use schema_frames::VehiclePart;
    use schema_types::Pose;

    #[test]
    fn a_vehicle_lies_at_the_documented_offsets() {
        let mut record = ActorRecord {
            id: 7,
            kind: ActorKind::Vehicle as u16,
            ..ActorRecord::zeroed()
        };
        record.world_from_actor = Pose::from_xyz_yaw(1.0, 2.0, 3.0, std::f64::consts::FRAC_PI_2);
        record.velocity_in_world_mps = [4.0, 5.0, 6.0];
        let part = VehiclePart {
            steer_ratio: 0.5,
            control_flags: 2,
            gear: -1,
            speed_limit_mps: 10.0,
            light_actor_id: 9,
            ..VehiclePart::zeroed()
        };
        record.set_part(&part);
        let header = SnapshotHeader {
            tick: 11,
            sim_nanos: 550_000_000,
            epoch: 5,
            episode: 2,
            ..SnapshotHeader::zeroed()
        };
        let bytes = encode(&header, &[record], MAP_CHANGED, 1.0);
        assert_eq!(bytes.len(), 48 + 36 + 119);
        let f32_at = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!((bytes[0], bytes[8]), (17, 11));
        assert_eq!(f64::from_le_bytes(bytes[16..24].try_into().unwrap()), 0.55);
        assert_eq!((bytes[48], bytes[48 + 32]), (7, 1));
        let actor = 84;
        assert_eq!((bytes[actor], bytes[actor + 4]), (7, 1));
        assert_eq!(
            (f32_at(actor + 5), f32_at(actor + 9), f32_at(actor + 13)),
            (1.0, -2.0, 3.0)
        );
        assert!(
            (f32_at(actor + 21) + 90.0).abs() < 1e-5,
            "a left turn is a negative yaw"
        );
        assert_eq!(f32_at(actor + 33), -5.0);
        let union = actor + 65;
        assert_eq!(f32_at(union + 4), -0.5);
        assert_eq!((bytes[union + 12], bytes[union + 13]), (0, 1));
        assert_eq!(
            i32::from_le_bytes(bytes[union + 15..union + 19].try_into().unwrap()),
            -1
        );
        assert_eq!(
            (f32_at(union + 19), bytes[union + 24], bytes[union + 25]),
            (36.0, 1, 9)
        );
    }
}
