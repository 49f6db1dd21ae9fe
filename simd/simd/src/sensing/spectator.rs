//! The spectator's camera: a sensor on the world's own spectator actor, whose topic is
//! `spectator/rgb`, and what only it shows.

use launch_spec::Launch;
use nalgebra::Vector3;
use schema_bus::names;
use schema_frames::{Command, CommandReply, PhysicsAction, PhysicsAnswer, VehicleTelemetry};
use schema_types::{ActorId, Pose, SimTime};
use sensor_core::scene::DebugStroke;
use sensor_spec::SensorSpec;
use simd_world::World;

use super::debug_shapes::DebugShapes;
use crate::world::carrier_of;
use simd_frames::frames::Sensors;
use simd_frames::rig::Rig;
use simd_frames::sensor::{
    Maker, NoiseStream, OpenContext, Role, Sensor, SensorIdentity, schedule_of,
};
use simd_frames::topic::{Audience, MemoryLife};

/// Straight pieces of a circle that shows the end of an obstacle detector's path.
const CIRCLE_PIECES: usize = 16;
/// Thickness of what shows the path, metres.
const TRACE_WIDTH_M: f32 = 0.02;
/// Colour of it.
const TRACE_RGB: [u8; 3] = [255, 0, 0];

/// How long the world must stand still before the spectator's image is made again within a tick.
pub const STILL_NANOS: u64 = 100_000_000;

/// What the spectator's last image shows, as far as commands can change it while the world stands
/// still.
#[derive(Debug, Default)]
pub struct Still {
    shown: Option<(Pose, u64)>,
}

impl Still {
    /// Takes note of what an image shows that is made now; `false` if nobody reads it, or if the
    /// last one shows the same.
    pub fn note(&mut self, sensors: &Sensors, world: &World, debug: &DebugShapes) -> bool {
        let is_read = sensors
            .sensors
            .iter()
            .filter(|sensor| sensor.role == Role::Spectator)
            .filter(|sensor| sensor.maker != Maker::Here || has_target(sensor))
            .flat_map(|sensor| &sensor.topics)
            .any(|topic| topic.is_read(Audience::Readers));
        let pose = world
            .record(world.spectator())
            .map(|record| record.world_from_actor);
        let now = pose
            .filter(|_| is_read)
            .map(|pose| (pose, debug.revision()));
        std::mem::replace(&mut self.shown, now) != now && now.is_some()
    }
}

fn has_target(sensor: &Sensor) -> bool {
    sensor.topics.iter().any(|topic| topic.target().is_some())
}

/// Opens its topic, which has memory only while somebody reads.
pub fn open(
    context: &OpenContext<'_>,
    world: &mut World,
    launch: &Launch,
) -> anyhow::Result<Sensor> {
    let rig = names::rig_of(names::SPECTATOR_RGB);
    let identity = SensorIdentity {
        rig: Rig::open(context.bus, rig)?,
        launch_rig: None,
        name: String::new(),
        actor: world.spectator(),
        stream: NoiseStream::named(rig, ""),
        is_added: false,
        role: Role::Spectator,
    };
    let context = OpenContext {
        memory: MemoryLife::WhileRoom,
        server: None,
        is_told: false,
        cameras_are_away: context.gpu.is_none(),
        ..*context
    };
    let spec = SensorSpec::Camera(launch.spectator.camera());
    let schedule = schedule_of(&spec, SimTime(0), context.period_nanos);
    let sensor = Sensor::open(&context, identity, spec, schedule)?;
    world.set_topics(sensor.actor, sensor.topic_infos())?;
    Ok(sensor)
}

/// A vehicle's telemetry in lines; none if it is gone.
pub fn telemetry_lines(world: &mut World, vehicle: ActorId) -> Vec<String> {
    let ask = Command::Physics {
        actor_id: vehicle.0,
        action: PhysicsAction::GetTelemetry,
    };
    match world.apply(&ask) {
        CommandReply::Physics {
            answer: PhysicsAnswer::Telemetry(telemetry),
        } => lines(vehicle, &telemetry),
        _ => Vec::new(),
    }
}

/// A number with so many decimals, and no sign before zero.
fn text(value: f32, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|byte| b"-0.".contains(&byte));
    match text.strip_prefix('-') {
        Some(zero) if is_zero => zero.to_owned(),
        _ => text,
    }
}

fn lines(vehicle: ActorId, told: &VehicleTelemetry) -> Vec<String> {
    let gear = match told.gear {
        -1 => "R".to_owned(),
        0 => "N".to_owned(),
        gear => gear.to_string(),
    };
    let mut lines = vec![
        format!("vehicle {vehicle}"),
        format!(
            "speed {:>7} km/h   engine {:>6} rpm   gear {gear}",
            text(told.speed_mps * 3.6, 1),
            text(told.engine_rpm, 0)
        ),
        format!(
            "throttle {:>4}   brake {:>4}   steer {:>5}   drag {:>6} N",
            text(told.throttle_ratio, 2),
            text(told.brake_ratio, 2),
            // CARLA's steering is positive to the right.
            text(-told.steer_ratio, 2),
            text(told.drag_n, 0)
        ),
        "wheel  grip   load N  slip lat deg  slip long  rad/s  torque Nm  long N  lat N".to_owned(),
    ];
    lines.extend(told.wheels.iter().enumerate().map(|(idx, wheel)| {
        format!(
            "{idx:5}  {:>4}  {:>7}  {:>12}  {:>9}  {:>5}  {:>9}  {:>6}  {:>5}",
            text(wheel.friction, 2),
            text(wheel.load_n, 0),
            text(-wheel.lat_slip_rad.to_degrees(), 2),
            text(wheel.long_slip_ratio, 3),
            text(wheel.roll_radps, 1),
            text(wheel.torque_nm, 0),
            text(wheel.long_n, 0),
            text(-wheel.lat_n, 0)
        )
    }));
    lines
}

/// The paths of those obstacle detectors that show theirs.
pub fn traces(sensors: &[Sensor], world: &World, now: SimTime) -> Vec<DebugStroke> {
    let mut strokes = Vec::new();
    for sensor in sensors {
        let SensorSpec::Obstacle(spec) = &sensor.spec else {
            continue;
        };
        if !spec.debug_linetrace {
            continue;
        }
        let Some(carrier) = carrier_of(world, sensor.actor, now) else {
            continue;
        };
        let pose = carrier.world_from_sensor.isometry();
        let at = |x: f64, side: Vector3<f64>| {
            let point = pose.translation.vector + pose.rotation * (Vector3::x() * x + side);
            <[f64; 3]>::from(point)
        };
        let mut draw = |from_m, to_m| {
            strokes.push(DebugStroke {
                from_m,
                to_m,
                width_m: TRACE_WIDTH_M,
                color_rgb: TRACE_RGB,
            });
        };
        draw(
            at(0.0, Vector3::zeros()),
            at(spec.distance_m, Vector3::zeros()),
        );
        let rim = |piece: usize| {
            let angle = std::f64::consts::TAU * piece as f64 / CIRCLE_PIECES as f64;
            let (sin, cos) = angle.sin_cos();
            Vector3::new(0.0, cos, sin) * spec.hit_radius_m
        };
        for x in [0.0, spec.distance_m] {
            for piece in 0..CIRCLE_PIECES {
                draw(at(x, rim(piece)), at(x, rim(piece + 1)));
            }
        }
    }
    strokes
}

#[cfg(test)]
mod tests {
    use schema_frames::WheelTelemetry;

    use super::*;

    #[test]
    fn telemetry_stands_in_columns_and_zero_has_no_sign() {
        let wheel: WheelTelemetry = serde_json::from_str(
            r#"{"friction":1,"lat_slip_rad":0.01,"long_slip_ratio":-0.0001,"roll_radps":30,"load_n":4000,"load_ratio":1,
            "torque_nm":-0.2,"long_n":-5,"lat_n":7,"steer_rad":0,"roll_rad":0}"#,
        )
        .unwrap();
        let told = VehicleTelemetry {
            speed_mps: 10.0,
            steer_ratio: 0.25,
            throttle_ratio: 0.5,
            brake_ratio: 0.0,
            engine_rpm: 2400.4,
            gear: -1,
            drag_n: 33.0,
            wheels: vec![wheel],
        };
        let lines = lines(ActorId(12), &told);
        assert_eq!(lines[1], "speed    36.0 km/h   engine   2400 rpm   gear R");
        assert_eq!(
            lines[2],
            "throttle 0.50   brake 0.00   steer -0.25   drag     33 N"
        );
        assert_eq!(
            lines[4],
            "    0  1.00     4000         -0.57      0.000   30.0          0      -5     -7"
        );
        assert_eq!(lines[3].len(), lines[4].len(), "{}", lines[3]);
    }
}
