//! Traffic light poles with heads, and signs, at the map's signals.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use schema_roads::{SectionSurface, Signal, SignalKind};
use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder, MeshId};
use simd_body::solid::tube;

use super::builder::ImportBuilder;
use super::paint::{PAINT_M, patch};
use crate::geometry::{P2, flat, left, unit};
use crate::meshes::signals as signal_meshes;
use crate::network;
use crate::scenery::LightSite;

/// Least height of a head over a lane.
const CLEAR_M: f64 = 5.2;
/// How far from a signal over a lane a place for its pole is looked for.
const REACH_M: f64 = 18.0;
/// Room between a pole and any lane for vehicles, metres; less where there is no such place.
const ROOM_M: [f64; 2] = [0.6, 0.25];

/// Adds every signal of the map, and a stop line before every light.
pub(super) fn build(builder: &mut ImportBuilder, sections: &[SectionSurface]) {
    let mut signs: BTreeMap<String, MeshId> = BTreeMap::new();
    let mut poles: BTreeMap<u32, MeshId> = BTreeMap::new();
    let signals: Vec<Signal> = builder.roads.signals().to_vec();
    for signal in &signals {
        let pose = builder.local_pose(&signal.pose);
        if !pose.translation.vector.iter().all(|x| x.is_finite()) {
            continue;
        }
        if signal.kind == SignalKind::TrafficLight {
            light(builder, signal, &pose, &mut poles);
        } else {
            sign(builder, signal, &pose, &mut signs);
        }
    }
    // A stop line is added for every light, because most files have no road mark for it.
    if !sections.is_empty() {
        stop_lines(builder, &signals);
    }
}

fn yaw(pose: &Isometry3<f64>) -> f64 {
    let x = pose.rotation * Vector3::x();
    x.y.atan2(x.x)
}

fn light(
    builder: &mut ImportBuilder,
    signal: &Signal,
    pose: &Isometry3<f64>,
    poles: &mut BTreeMap<u32, MeshId>,
) {
    let mut at = flat(pose.translation.vector.into());
    let facing = yaw(pose);
    // The right side of the traffic that must obey is the left side of the signal's face.
    let aside = left(unit(facing));
    let foot = pole_place(builder, at, aside).unwrap_or(at);
    // A pole at the rim of a lane moves as a whole.
    if builder.cover.vehicles_at(at).is_none() {
        at = foot;
    }
    let arm_m = (at - foot).norm();
    let z = builder.floor(foot);
    let overhead = arm_m > 0.3;
    let arm_dm = if overhead {
        (arm_m * 10.0).round() as u32
    } else {
        0
    };
    let turned = if (at - foot).dot(&aside) > 0.0 {
        std::f64::consts::PI
    } else {
        0.0
    };
    // The pole's arm reaches towards −y of the mesh, which is turned towards the signal.
    let mesh = *poles.entry(arm_dm).or_insert_with(|| {
        builder
            .assets
            .add_mesh(signal_meshes::light_pole(arm_dm as f32 * 0.1))
    });
    let post = builder.stand(
        mesh,
        Class::POLES,
        "traffic light pole",
        [foot.x, foot.y, z],
        facing + turned,
    );
    builder.post(post, [foot.x, foot.y, z], 0.09, 2.6);
    let pole = Isometry3::new(Vector3::new(foot.x, foot.y, z), Vector3::z() * facing);
    let mut heads = vec![pole * Isometry3::translation(0.2, 0.0, signal_meshes::HEADS_M.0)];
    if overhead {
        let high = (signal_meshes::HEADS_M.1 - 0.45).max(CLEAR_M - 0.6);
        let head = Isometry3::new(Vector3::new(at.x, at.y, z + high), Vector3::z() * facing);
        heads.push(head * Isometry3::translation(0.2, 0.0, 0.0));
    }
    builder.lights.push(LightSite {
        signal_id: signal.id.clone(),
        pole: pole.into(),
        heads,
    });
}

/// The nearest place beside `at` with room to every lane for vehicles, first on the traffic's right.
/// `None` if there is room at `at` itself.
fn pole_place(builder: &ImportBuilder, at: P2, right: P2) -> Option<P2> {
    let has_room = |p: P2, room_m: f64| !builder.cover.vehicles_near(p, room_m);
    if has_room(at, ROOM_M[0]) {
        return None;
    }
    ROOM_M.into_iter().find_map(|room_m| {
        (1..=(REACH_M * 4.0) as usize).find_map(|k| {
            let away = right * (0.25 * k as f64);
            [at + away, at - away]
                .into_iter()
                .find(|p| has_room(*p, room_m))
        })
    })
}

fn sign(
    builder: &mut ImportBuilder,
    signal: &Signal,
    pose: &Isometry3<f64>,
    signs: &mut BTreeMap<String, MeshId>,
) {
    let at = flat(pose.translation.vector.into());
    let z = builder.floor(at);
    // Signals that lie on the road are paint or sensors, which have no post.
    let on_road = builder.cover.vehicles_at(at).is_some();
    if on_road && pose.translation.z - z < 2.0 {
        return;
    }
    let kind = match signal.kind {
        SignalKind::Stop => Some(network::SignalKind::Stop),
        SignalKind::Yield => Some(network::SignalKind::Yield),
        SignalKind::SpeedLimit => {
            let value = signal
                .value
                .filter(|v| *v > 0.0)
                .or_else(|| signal.subtype.parse().ok().filter(|v| *v > 0.0));
            value.map(|v| network::SignalKind::Limit(v.round().clamp(1.0, 199.0) as u32))
        }
        _ => None,
    };
    let mesh = *signs.entry(format!("{kind:?}")).or_insert_with(|| {
        builder
            .assets
            .add_mesh(kind.map_or_else(plate, signal_meshes::sign))
    });
    let foot = pole_place(builder, at, left(unit(yaw(pose)))).unwrap_or(at);
    let z = builder.floor(foot);
    let name = if signal.name.is_empty() {
        "sign"
    } else {
        signal.name.as_str()
    };
    let post = builder.stand(
        mesh,
        Class::TRAFFIC_SIGNS,
        name,
        [foot.x, foot.y, z],
        yaw(pose),
    );
    builder.post(post, [foot.x, foot.y, z], 0.05, 2.6);
}

/// A sign whose picture is not known: a blank plate on a pole, facing +x.
fn plate() -> Mesh {
    let mut builder = MeshBuilder::new("sign plate");
    let steel = Surface::new(Class::POLES, Material::Metal, [74, 78, 82]);
    let [face, back] = [[60, 92, 150], [130, 132, 134]]
        .map(|rgb| Surface::new(Class::TRAFFIC_SIGNS, Material::Matte, rgb));
    for (n, until_m) in [(6, 30.0), (3, 180.0)] {
        tube(
            &mut builder,
            steel,
            ([0.0, 0.0, -0.05], 0.035),
            ([0.0, 0.0, 2.75], 0.035),
            n,
        );
        builder.cuboid(back, [0.045, 0.0, 2.4], [0.006, 0.32, 0.32]);
        builder.cuboid(face, [0.054, 0.0, 2.4], [0.004, 0.29, 0.29]);
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A line across each lane where it stops for a light.
fn stop_lines(builder: &mut ImportBuilder, signals: &[Signal]) {
    let object = builder.object(Class::ROAD_LINES, "stop lines");
    let white = Surface::new(Class::ROAD_LINES, Material::Paint, [226, 226, 220]).of(object);
    let mut drawn = std::collections::BTreeSet::new();
    let stops = signals
        .iter()
        .filter(|s| s.kind == SignalKind::TrafficLight)
        .flat_map(|s| &s.stops)
        .map(|stop| stop.stop);
    for stop in stops {
        if !drawn.insert((stop.lane, (stop.s_m * 10.0) as i64)) {
            continue;
        }
        let half = 0.5 * builder.roads.width_m(stop) - 0.1;
        let Some(pose) = builder.roads.pose(stop).filter(|_| half > 0.5) else {
            continue;
        };
        let pose = builder.local_pose(&pose);
        let at = |x: f64, y: f64| -> [f64; 3] {
            (pose * nalgebra::Point3::new(x, y, PAINT_M + 0.003))
                .coords
                .into()
        };
        patch(
            builder,
            white,
            &[
                at(-0.6, -half),
                at(-0.2, -half),
                at(-0.2, half),
                at(-0.6, half),
            ],
            0..=1,
        );
    }
}
