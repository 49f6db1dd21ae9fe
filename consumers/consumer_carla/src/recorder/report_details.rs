//! The part of a report that lists all packets of a frame, in the form of CARLA's texts.

use std::fmt::Write as _;

use nalgebra::Point3;
use schema_frames::VehiclePhysics;
use schema_types::Pose;

use crate::recorder::changes::Changes;
use crate::recorder::frame::{Frame, Light, Origin, Pedals};
use crate::recorder::text::{ROOM, centimetres, seconds, single, turn, vector};
use crate::wire::axes;
use crate::wire::weather::weather_values;

/// Appends everything that a frame holds besides actors that appear, disappear or touch, in CARLA's
/// order; what scenario_runner's reader of these texts does not know comes last.
pub fn details(out: &mut String, frame: &Frame, origin: Origin) {
    tell_state(out, frame);
    tell_street_lights(out, &frame.changes);
    // A recording with additional data has it in every frame.
    let has_more = frame.extra.platform_secs.is_some();
    if has_more || !frame.motions.is_empty() {
        writeln!(out, " Dynamic actors: {}", frame.motions.len()).expect(ROOM);
    }
    for (id, [velocity_mps, turning_deg]) in &frame.motions {
        let (velocity, turning) = (vector(*velocity_mps), vector(*turning_deg));
        writeln!(
            out,
            "  Id: {id} linear_velocity: {velocity} angular_velocity: {turning}"
        )
        .expect(ROOM);
    }
    let extra = &frame.extra;
    for (title, boxes, is_always) in [
        ("bounding boxes", &extra.boxes, has_more),
        ("trigger volumes", &extra.triggers, false),
    ] {
        if boxes.is_empty() && !is_always {
            continue;
        }
        writeln!(out, " Actor {title}: {}", boxes.len()).expect(ROOM);
        for (id, [origin_m, half_m]) in boxes {
            writeln!(
                out,
                "  Id: {id} origin: {} extension: {}",
                centimetres(*origin_m),
                centimetres(*half_m)
            )
            .expect(ROOM);
        }
    }
    if let Some(secs) = extra.platform_secs {
        writeln!(out, " Current platform time: {}", seconds(origin, secs)).expect(ROOM);
    }
    tell_physics(out, frame);
    if !extra.light_times.is_empty() {
        writeln!(
            out,
            " Traffic Light time events: {}",
            extra.light_times.len()
        )
        .expect(ROOM);
    }
    for (id, times) in &extra.light_times {
        let [green, yellow, red] = times.map(single);
        writeln!(
            out,
            "  Id: {id} green_time: {green} yellow_time: {yellow} red_time: {red}"
        )
        .expect(ROOM);
    }
    tell_rest(out, &frame.changes);
}

/// Appends poses, traffic lights, controls, gaits and lamps.
fn tell_state(out: &mut String, frame: &Frame) {
    writeln!(out, " Positions: {}", frame.poses.len()).expect(ROOM);
    for (id, at) in &frame.poses {
        writeln!(
            out,
            "  Id: {id} Location: {} Rotation: {}",
            centimetres(at.location_m),
            turn(at.rotation_deg)
        )
        .expect(ROOM);
    }
    writeln!(out, " State traffic lights: {}", frame.lights.len()).expect(ROOM);
    for (id, light) in &frame.lights {
        let Light {
            state,
            frozen,
            elapsed_secs,
        } = light;
        writeln!(
            out,
            "  Id: {id} state: {state} frozen: {} elapsedTime: {}",
            u8::from(*frozen),
            single(*elapsed_secs)
        )
        .expect(ROOM);
    }
    writeln!(out, " Vehicle animations: {}", frame.pedals.len()).expect(ROOM);
    for (id, p) in &frame.pedals {
        let Pedals {
            steer,
            throttle,
            brake,
            hand_brake,
            gear,
        } = p;
        let [steer, throttle, brake] = [steer, throttle, brake].map(|ratio| single(*ratio));
        let hand_brake = u8::from(*hand_brake);
        writeln!(out, "  Id: {id} Steering: {steer} Throttle: {throttle} Brake: {brake} Handbrake: {hand_brake} Gear: {gear}").expect(ROOM);
    }
    writeln!(out, " Walker animations: {}", frame.gaits.len()).expect(ROOM);
    for (id, mps) in &frame.gaits {
        writeln!(out, "  Id: {id} speed: {}", single(mps * 100.0)).expect(ROOM);
    }
    writeln!(out, " Vehicle light animations: {}", frame.lamps.len()).expect(ROOM);
    for (id, bits) in &frame.lamps {
        let on: Vec<&str> = LAMPS
            .iter()
            .enumerate()
            .filter(|(bit, _)| bits >> bit & 1 != 0)
            .map(|(_, name)| *name)
            .collect();
        let on = if on.is_empty() {
            "None".to_owned()
        } else {
            on.join(" ")
        };
        writeln!(out, "  Id: {id} {on}").expect(ROOM);
    }
}

/// Names of vehicles' lamps by their bits.
const LAMPS: [&str; 11] = [
    "Position",
    "LowBeam",
    "HighBeam",
    "Brake",
    "RightBlinker",
    "LeftBlinker",
    "Reverse",
    "Fog",
    "Interior",
    "Special1",
    "Special2",
];

/// Appends the street lights that were set.
fn tell_street_lights(out: &mut String, changes: &Changes) {
    if !changes.street_lights.is_empty() {
        writeln!(out, " Scene light changes: {}", changes.street_lights.len()).expect(ROOM);
    }
    for (id, light) in &changes.street_lights {
        let on = if light.on { "True" } else { "False" };
        let colour = vector(light.rgb.map(|level| f64::from(level) / 255.0));
        let intensity = single(light.intensity_lm);
        writeln!(
            out,
            "  Id: {id} enabled: {on} intensity: {intensity} RGB_color: {colour}"
        )
        .expect(ROOM);
    }
}

/// Appends weather, doors and bones.
fn tell_rest(out: &mut String, changes: &Changes) {
    if let Some(weather) = &changes.weather {
        let named = WEATHER
            .iter()
            .zip(weather_values(weather))
            .map(|(name, value)| format!("{name}: {}", single(value)));
        writeln!(
            out,
            " Weathers: 1\n  {}",
            named.collect::<Vec<_>>().join(" ")
        )
        .expect(ROOM);
    }
    if !changes.doors.is_empty() {
        writeln!(out, " Vehicle door animations: {}", changes.doors.len()).expect(ROOM);
    }
    for (id, doors) in &changes.doors {
        let open = DOORS
            .iter()
            .enumerate()
            .filter(|(bit, _)| doors >> bit & 1 != 0)
            .map(|(_, name)| format!(" {name} "));
        writeln!(
            out,
            "  Id: {id}\n  Doors opened: {}",
            open.collect::<String>()
        )
        .expect(ROOM);
    }
    if !changes.bones.is_empty() {
        writeln!(out, " Walkers Bones: {}", changes.bones.len()).expect(ROOM);
    }
    for (id, bones) in &changes.bones {
        writeln!(out, "  Id: {id}").expect(ROOM);
        for (name, at) in bones {
            writeln!(
                out,
                "     Bone: \"{name}\" relative: Loc{} Rot{}",
                centimetres(at.location_m),
                turn(at.rotation_deg)
            )
            .expect(ROOM);
        }
    }
    if !changes.bones.is_empty() {
        out.push('\n');
    }
}

const WEATHER: [&str; 14] = [
    "Cloudiness",
    "Precipitation",
    "PrecipitationDeposits",
    "WindIntensity",
    "SunAzimuthAngle",
    "SunAltitudeAngle",
    "FogDensity",
    "FogDistance",
    "FogFalloff",
    "Wetness",
    "ScatteringIntensity",
    "MieScatteringScale",
    "RayleighScatteringScale",
    "DustStorm",
];

const DOORS: [&str; 4] = ["Front Left", "Front Right", "Rear Left", "Rear Right"];

/// Appends vehicles' physics control.
fn tell_physics(out: &mut String, frame: &Frame) {
    let all = &frame.changes.physics;
    if !all.is_empty() {
        writeln!(out, " Physics Control events: {}", all.len()).expect(ROOM);
    }
    for (id, physics) in all {
        let world_from_vehicle = frame.place(*id).map_or(Pose::IDENTITY, axes::pose);
        tell_control(out, *id, physics, &world_from_vehicle);
    }
}

/// Appends a vehicle's physics control in CARLA's units: centimetres for wheels, degrees for
/// steering, km/h in the steering curve. Wheels' positions are in the world.
fn tell_control(out: &mut String, id: u32, physics: &VehiclePhysics, world_from_vehicle: &Pose) {
    let middle = vector(axes::mirror(physics.center_of_mass_m).map(f64::from));
    let curve = |points: &[[f32; 2]], unit: f32| {
        points
            .iter()
            .map(|[x, y]| format!(" ({}, {})", single(x * unit), single(*y)))
            .collect::<String>()
    };
    writeln!(out, "  Id: {id}").expect(ROOM);
    for (name, value) in [
        ("max_rpm", physics.max_rpm),
        ("MOI", physics.engine_inertia_kgm2),
        (
            "damping_rate_full_throttle",
            physics.damping_full_throttle_nms,
        ),
        (
            "damping_rate_zero_throttle_clutch_engaged",
            physics.damping_closed_engaged_nms,
        ),
        (
            "damping_rate_zero_throttle_clutch_disengaged",
            physics.damping_closed_open_nms,
        ),
    ] {
        writeln!(out, "   {name} = {}", single(value)).expect(ROOM);
    }
    writeln!(out, "   use_gear_auto_box = {}", physics.automatic_gearbox).expect(ROOM);
    for (name, value) in [
        ("gear_switch_time", physics.gear_switch_secs),
        ("clutch_strength", physics.clutch_strength_nms),
        ("final_ratio", physics.final_ratio),
        ("mass", physics.mass_kg),
        ("drag_coefficient", physics.drag_coefficient),
    ] {
        writeln!(out, "   {name} = {}", single(value)).expect(ROOM);
    }
    writeln!(out, "   center_of_mass = {middle}").expect(ROOM);
    writeln!(
        out,
        "   torque_curve ={}",
        curve(&physics.torque_curve, 1.0)
    )
    .expect(ROOM);
    writeln!(
        out,
        "   steering_curve ={}",
        curve(&physics.steering_curve, 3.6)
    )
    .expect(ROOM);
    writeln!(out, "   forward_gears:").expect(ROOM);
    for (number, gear) in physics.forward_gears.iter().enumerate() {
        let [ratio, down, up] = [gear.ratio, gear.down_ratio, gear.up_ratio].map(single);
        writeln!(
            out,
            "    gear {number}: ratio {ratio} down_ratio {down} up_ratio {up}"
        )
        .expect(ROOM);
    }
    writeln!(out, "   wheels:").expect(ROOM);
    for (number, wheel) in physics.wheels.iter().enumerate() {
        let place = world_from_vehicle.isometry() * Point3::from(wheel.position_m.map(f64::from));
        writeln!(
            out,
            "    wheel {number}: tire_friction {} damping_rate {} max_steer_angle {} radius {} max_brake_torque {} max_handbrake_torque {} position {}",
            single(wheel.friction),
            single(wheel.damping_nms),
            single(wheel.max_steer_rad.to_degrees()),
            single(wheel.radius_m * 100.0),
            single(wheel.max_brake_nm),
            single(wheel.max_hand_brake_nm),
            centimetres(axes::mirror(place.coords.into()))
        )
        .expect(ROOM);
    }
}
