//! The part of a report that lists all packets of a frame, in the form of CARLA's texts.

use std::fmt::Write as _;

use schema_frames::VehiclePhysics;

use crate::recorder::changes::Changes;
use crate::recorder::extra::Extra;
use crate::recorder::file::{Frame, Light, Pedals};
use crate::recorder::text::{ROOM, centimetres, round, turn};
use crate::wire::axes;
use crate::wire::weather::weather_values;

/// Appends everything that a frame holds besides actors that appear, disappear or touch.
pub fn details(out: &mut String, frame: &Frame) {
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
            "  Id: {id} state: {state} frozen: {} elapsedTime: {elapsed_secs}",
            u8::from(*frozen)
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
        let hand_brake = u8::from(*hand_brake);
        writeln!(out, "  Id: {id} Steering: {steer} Throttle: {throttle} Brake: {brake} Handbrake: {hand_brake} Gear: {gear}").expect(ROOM);
    }
    writeln!(out, " Walker animations: {}", frame.gaits.len()).expect(ROOM);
    frame
        .gaits
        .iter()
        .for_each(|(id, mps)| writeln!(out, "  Id: {id} speed: {}", mps * 100.0).expect(ROOM));
    writeln!(out, " Vehicle light animations: {}", frame.lamps.len()).expect(ROOM);
    for (id, bits) in &frame.lamps {
        let on: Vec<&str> = LAMPS
            .iter()
            .enumerate()
            .filter(|(bit, _)| bits >> bit & 1 != 0)
            .map(|(_, name)| *name)
            .collect();
        writeln!(
            out,
            "  Id: {id} {}",
            if on.is_empty() {
                "None".to_owned()
            } else {
                on.join(" ")
            }
        )
        .expect(ROOM);
    }
    if !frame.motions.is_empty() {
        writeln!(out, " Dynamic actors: {}", frame.motions.len()).expect(ROOM);
    }
    for (id, [velocity_mps, turning_deg]) in &frame.motions {
        let [x, y, z] = turning_deg;
        let velocity = centimetres(*velocity_mps);
        writeln!(
            out,
            "  Id: {id} linear_velocity: {velocity} angular_velocity: ({x:.4}, {y:.4}, {z:.4})"
        )
        .expect(ROOM);
    }
    tell_extra(out, &frame.extra);
    tell_changes(out, &frame.changes);
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

/// Appends CARLA's lines about this part of a frame.
fn tell_changes(out: &mut String, changes: &Changes) {
    if let Some(weather) = &changes.weather {
        let named = WEATHER
            .iter()
            .zip(weather_values(weather))
            .map(|(name, value)| format!("{name}: {value}"));
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
    if !changes.street_lights.is_empty() {
        writeln!(out, " Scene light changes: {}", changes.street_lights.len()).expect(ROOM);
    }
    for (id, light) in &changes.street_lights {
        let (on, [r, g, b]) = (if light.on { "True" } else { "False" }, light.rgb);
        writeln!(
            out,
            "  Id: {id} enabled: {on} intensity: {} RGB_color: ({r}, {g}, {b})",
            light.intensity_lm
        )
        .expect(ROOM);
    }
    if !changes.physics.is_empty() {
        writeln!(out, " Physics Control events: {}", changes.physics.len()).expect(ROOM);
    }
    changes
        .physics
        .iter()
        .for_each(|(id, physics)| tell_physics(out, *id, physics));
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

/// Appends a vehicle's physics control in CARLA's units: centimetres for wheels, degrees for
/// steering, km/h in the steering curve.
fn tell_physics(out: &mut String, id: u32, physics: &VehiclePhysics) {
    let [x, y, z] = axes::mirror(physics.center_of_mass_m).map(|metres| metres + 0.0);
    let curve = |points: &[[f32; 2]], unit: f32| {
        points
            .iter()
            .map(|[x, y]| format!(" ({}, {y})", x * unit))
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
        writeln!(out, "   {name} = {value}").expect(ROOM);
    }
    writeln!(out, "   use_gear_auto_box = {}", physics.automatic_gearbox).expect(ROOM);
    for (name, value) in [
        ("gear_switch_time", physics.gear_switch_secs),
        ("clutch_strength", physics.clutch_strength_nms),
        ("final_ratio", physics.final_ratio),
        ("mass", physics.mass_kg),
        ("drag_coefficient", physics.drag_coefficient),
    ] {
        writeln!(out, "   {name} = {value}").expect(ROOM);
    }
    writeln!(out, "   center_of_mass = ({x}, {y}, {z})").expect(ROOM);
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
        let (ratio, down, up) = (gear.ratio, gear.down_ratio, gear.up_ratio);
        writeln!(
            out,
            "    gear {number}: ratio {ratio} down_ratio {down} up_ratio {up}"
        )
        .expect(ROOM);
    }
    writeln!(out, "   wheels:").expect(ROOM);
    for (number, wheel) in physics.wheels.iter().enumerate() {
        writeln!(
            out,
            "    wheel {number}: tire_friction {} damping_rate {} max_steer_angle {} radius {} max_brake_torque {} max_handbrake_torque {} position {}",
            wheel.friction,
            wheel.damping_nms,
            wheel.max_steer_rad.to_degrees(),
            wheel.radius_m * 100.0,
            wheel.max_brake_nm,
            wheel.max_hand_brake_nm,
            centimetres(axes::mirror(wheel.position_m).map(f64::from))
        )
        .expect(ROOM);
    }
}

/// Appends CARLA's lines about this part of a frame.
fn tell_extra(out: &mut String, extra: &Extra) {
    let Some(platform_secs) = extra.platform_secs else {
        return;
    };
    for (title, boxes) in [
        ("bounding boxes", &extra.boxes),
        ("trigger volumes", &extra.triggers),
    ] {
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
    writeln!(out, " Current platform time: {}", round(platform_secs)).expect(ROOM);
    writeln!(
        out,
        " Traffic Light time events: {}",
        extra.light_times.len()
    )
    .expect(ROOM);
    for (id, [green, yellow, red]) in &extra.light_times {
        writeln!(
            out,
            "  Id: {id} green_time: {green} yellow_time: {yellow} red_time: {red}"
        )
        .expect(ROOM);
    }
}
