//! Lamps in rendered images: traffic lights show their state, vehicles their lamps, and lamps that
//! a client switches shine as set.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::document::Weather;
use schema_frames::scenery::LampChange;
use schema_frames::{ActorKind, Command, CommandReply, Modality};
use schema_types::ActorId;
use sensor_camera::{CameraRenderer, Quality, View, ViewSpec};
use sensor_core::{Material, Mesh};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::{ExposureMode, Intrinsics, OpticsSpec};
use test_render::{Stage, shot, weathers};

struct Eye {
    gpu: Gpu,
    renderer: CameraRenderer,
    lens: Intrinsics,
}

/// Colours R G B, and the bytes of the modalities that no lamp may change.
struct Seen {
    lens: Intrinsics,
    rgb: Vec<[u8; 3]>,
    labels: Vec<Vec<u8>>,
}

const EXACT: [Modality; 4] = [
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Normals,
];

impl Eye {
    fn new(quality: Quality, fov_deg: f64) -> Eye {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap();
        let renderer = CameraRenderer::new(&gpu, quality);
        Eye {
            gpu,
            renderer,
            lens: Intrinsics::from_fov(320, 200, fov_deg.to_radians()),
        }
    }

    fn look(
        &mut self,
        stage: &Stage,
        weather: &str,
        world_from_sensor: Isometry3<f64>,
        optics: OpticsSpec,
    ) -> Seen {
        let mut view = View::new(
            &self.gpu,
            ViewSpec {
                optics,
                ..ViewSpec::pinhole(self.lens)
            },
        );
        let modalities = [&[Modality::Rgb][..], &EXACT].concat();
        let scene = stage.scene(weathers::named(weather).unwrap());
        let mut bytes = shot(
            &mut self.renderer,
            &scene,
            &mut view,
            world_from_sensor,
            &modalities,
        );
        let rgb = bytes
            .remove(0)
            .chunks_exact(4)
            .map(|p| [p[2], p[1], p[0]])
            .collect();
        Seen {
            lens: self.lens,
            rgb,
            labels: bytes,
        }
    }
}

impl Seen {
    /// Pixel at which a camera at `world_from_sensor` sees a point; `None` outside the picture.
    fn pixel(&self, world_from_sensor: &Isometry3<f64>, point: Point3<f64>) -> Option<usize> {
        let p = world_from_sensor.inverse_transform_point(&point);
        let [fx, fy, cx, cy] = self.lens.as_array();
        let [x, y] = [cx - fx * p.y / p.x, cy - fy * p.z / p.x];
        let inside = p.x > 0.1
            && x >= 0.0
            && y >= 0.0
            && x < f64::from(self.lens.width_px)
            && y < f64::from(self.lens.height_px);
        inside.then(|| y as usize * self.lens.width_px as usize + x as usize)
    }

    fn ids(&self) -> Vec<u32> {
        bytemuck::pod_collect_to_vec(&self.labels[2])
    }
}

/// Middles of the lamps of a mesh by bit, from the triangles of its finest level.
fn lenses(mesh: &Mesh) -> Vec<(u8, Point3<f64>)> {
    let mut found: Vec<(u8, Vec<Point3<f64>>)> = Vec::new();
    for (corners, vertex) in mesh
        .triangles()
        .filter(|(_, vertex)| vertex.material == Material::Lamp as u8)
    {
        let middle = corners
            .iter()
            .map(|c| Vector3::from(*c).cast::<f64>())
            .sum::<Vector3<f64>>()
            / 3.0;
        let same = |(bit, points): &&mut (u8, Vec<Point3<f64>>)| {
            *bit == vertex.lamp && (points[0].coords - middle).norm() < 0.5
        };
        match found.iter_mut().find(same) {
            Some((_, points)) => points.push(middle.into()),
            None => found.push((vertex.lamp, vec![middle.into()])),
        }
    }
    let mean = |points: Vec<Point3<f64>>| {
        Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64)
    };
    found
        .into_iter()
        .map(|(bit, points)| (bit, mean(points)))
        .collect()
}

/// In front of a mesh's +x side, looking at it.
fn before(world_from_mesh: &Isometry3<f64>, distance_m: f64) -> Isometry3<f64> {
    world_from_mesh
        * Isometry3::new(
            Vector3::new(distance_m, 0.0, 0.0),
            Vector3::z() * std::f64::consts::PI,
        )
}

fn luma([r, g, b]: [u8; 3]) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}

/// A traffic light before whose first head nothing stands.
fn in_sight(stage: &Stage) -> ActorId {
    let mut eye = Eye::new(Quality::Low, 32.0);
    let scene = stage.scene(Weather::default());
    let is_in_sight = |actor: &ActorId| {
        let head = scene
            .dynamics
            .iter()
            .find(|instance| instance.actor == *actor)
            .expect("it has a head");
        let pose = before(&head.world_from_mesh, 3.5);
        let seen = eye.look(stage, "day", pose, OpticsSpec::default());
        let at = seen
            .pixel(&pose, head.world_from_mesh * Point3::new(0.1, 0.0, 0.15))
            .expect("in the picture");
        seen.ids()[at] == actor.0
    };
    stage
        .actors(ActorKind::TrafficLight)
        .into_iter()
        .find(is_in_sight)
        .expect("one can be seen")
}

#[test]
fn a_traffic_light_shows_its_state_and_nothing_else() {
    let mut stage = Stage::new("Town10HD", 3, 0).unwrap();
    let actor = in_sight(&stage);
    for quality in [Quality::Low, Quality::High] {
        let mut eye = Eye::new(quality, 32.0);
        for (weather, (lit, state)) in [
            ("day", (0, "red")),
            ("day", (1, "yellow")),
            ("day", (2, "green")),
            ("night", (0, "red")),
            ("night", (2, "green")),
            ("fog", (1, "yellow")),
        ] {
            stage
                .apply(&Command::SetTrafficLight {
                    actor_id: actor.0,
                    state: state.into(),
                })
                .unwrap();
            stage.step();
            let scene = stage.scene(Weather::default());
            let head = scene
                .dynamics
                .iter()
                .find(|instance| instance.actor == actor)
                .expect("it has a head");
            let lamps = lenses(scene.assets.mesh(head.mesh));
            assert_eq!(
                lamps.iter().map(|(bit, _)| *bit).collect::<Vec<_>>(),
                [0, 1, 2]
            );
            let pose = before(&head.world_from_mesh, 3.5);
            let seen = eye.look(&stage, weather, pose, OpticsSpec::default());
            let ids = seen.ids();
            let colors = lamps.iter().map(|(bit, middle)| {
                // Below the middle: the visor hides the upper part.
                let at = seen
                    .pixel(&pose, head.world_from_mesh * (middle - Vector3::z() * 0.03))
                    .expect("in the picture");
                assert_eq!(ids[at], actor.0, "the head is in sight");
                (*bit, seen.rgb[at])
            });
            for (bit, [r, g, b]) in colors {
                let place = format!(
                    "{quality:?}, {weather}, {state}: lamp {bit} is {:?}",
                    [r, g, b]
                );
                if bit != lit {
                    assert!(
                        luma([r, g, b]) < 110.0 && r.max(g).max(b) < 170,
                        "dark lamps stay dark; {place}"
                    );
                    continue;
                }
                match bit {
                    0 => assert!(r > 170 && r > g + 50 && r > b + 50, "red; {place}"),
                    1 => assert!(r > 170 && g > 90 && g > b + 40 && r >= g, "yellow; {place}"),
                    _ => assert!(g > 170 && g > r + 40 && g >= b, "green; {place}"),
                }
            }
        }
    }
}

/// Bits as CARLA has them: position, low beam, high beam, brake, right and left blinker.
#[test]
fn a_vehicles_lamps_are_seen_at_night_and_light_the_road() {
    let mut stage = Stage::new("Town01", 3, 12).unwrap();
    let mut eye = Eye::new(Quality::Low, 60.0);
    let car: ActorId = stage.actors(ActorKind::Vehicle)[0];
    let scene = stage.scene(Weather::default());
    let body = scene
        .dynamics
        .iter()
        .find(|instance| instance.actor == car && instance.part == 0)
        .expect("it has a body")
        .clone();
    let lamps = lenses(scene.assets.mesh(body.mesh));
    let in_front = before(&body.world_from_mesh, 6.0) * Isometry3::translation(0.0, 0.0, 1.2);
    let behind = body.world_from_mesh * Isometry3::translation(-7.0, 0.0, 1.2);
    for (bit, pose, ahead) in [
        (1u8, &in_front, true),
        (4, &in_front, true),
        (5, &in_front, true),
        (3, &behind, false),
        (4, &behind, false),
    ] {
        let places: Vec<Point3<f64>> = lamps
            .iter()
            .filter(|(of, middle)| *of == bit && (middle.x > 0.0) == ahead)
            .map(|(_, middle)| body.world_from_mesh * middle)
            .collect();
        assert!(!places.is_empty(), "the mesh has lamp {bit}");
        let mut shown = Vec::new();
        for lamps in [0, 1 << bit] {
            stage.set_lamps(lamps);
            let seen = eye.look(&stage, "night", *pose, OpticsSpec::default());
            let around = |place: &Point3<f64>| {
                let at = seen.pixel(pose, *place).expect("in the picture");
                let width = seen.lens.width_px as usize;
                (0..25)
                    .map(|k| {
                        seen.rgb[at + k % 5 - 2 + (k / 5) * width - 2 * width]
                            .into_iter()
                            .max()
                    })
                    .max()
                    .flatten()
                    .unwrap_or(0)
            };
            shown.push((places.iter().map(around).collect::<Vec<_>>(), seen.labels));
        }
        for (dark, lit) in shown[0].0.iter().zip(&shown[1].0) {
            assert!(
                i32::from(*lit) > i32::from(*dark) + 60 && *lit > 150,
                "lamp {bit}: {dark} off, {lit} on"
            );
        }
        assert!(
            shown[0].1 == shown[1].1,
            "lamps change colours and nothing else"
        );
    }
    // Low beam: the road ten metres ahead, seen from the bonnet.
    let road = |stage: &mut Stage, eye: &mut Eye, lamps: u32| {
        stage.set_lamps(lamps);
        let ahead =
            body.world_from_mesh * Isometry3::new(Vector3::new(3.2, 0.0, 0.9), Vector3::y() * 0.15);
        let seen = eye.look(stage, "night", ahead, OpticsSpec::default());
        luma(
            seen.rgb[seen
                .pixel(&ahead, body.world_from_mesh * Point3::new(12.0, 0.0, 0.0))
                .expect("in the picture")],
        )
    };
    let (dark, lit) = (road(&mut stage, &mut eye, 0), road(&mut stage, &mut eye, 2));
    assert!(
        lit > dark + 15.0,
        "the road ahead: {dark} without, {lit} with low beam"
    );
}

/// Optics without film curve: pixel values are proportional to light up to white.
fn linear() -> OpticsSpec {
    let mut optics = OpticsSpec {
        postprocess: false,
        gamma: 2.2,
        ..OpticsSpec::default()
    };
    optics.exposure.mode = ExposureMode::Weather;
    optics
}

fn radiance([r, g, b]: [u8; 3]) -> Vector3<f64> {
    Vector3::new(r, g, b).map(|c| (f64::from(c) / 255.0).powf(2.2))
}

fn switch(stage: &mut Stage, lamp: u32, change: LampChange) {
    stage
        .apply(&Command::SetSceneryLamps {
            changes: vec![LampChange { lamp, ..change }],
        })
        .unwrap();
}

const NO_CHANGE: LampChange = LampChange {
    lamp: 0,
    on: None,
    rgb: None,
    intensity_lm: None,
    group: None,
};

fn lamps_of(stage: &mut Stage, group: u8) -> Vec<schema_frames::scenery::SceneryLampInfo> {
    let Ok(CommandReply::Scenery { lamps, .. }) = stage.apply(&Command::Scenery) else {
        panic!("the world knows its scenery")
    };
    lamps
        .into_iter()
        .filter(|lamp| lamp.group == group)
        .collect()
}

/// The light of a lamp on the ground is proportional to its lumen and has its colour; the sum of
/// lights is the sum of what they light.
#[test]
fn a_street_lamps_light_follows_its_switch_strength_and_colour() {
    for quality in [Quality::Low, Quality::High] {
        let mut stage = Stage::new("Town01", 3, 0).unwrap();
        let mut eye = Eye::new(quality, 70.0);
        let all = lamps_of(&mut stage, 2);
        let lamp = all[20].clone();
        let off: Vec<LampChange> = all
            .iter()
            .map(|lamp| LampChange {
                lamp: lamp.lamp,
                on: Some(false),
                ..NO_CHANGE
            })
            .collect();
        stage
            .apply(&Command::SetSceneryLamps { changes: off })
            .unwrap();
        let [x, y, z] = lamp.position_m;
        // From above, beside the pole, looking down.
        let pose = Isometry3::new(Vector3::new(x, y, z + 5.0), Vector3::y() * 1.4);
        let below = Point3::new(x + 2.0, y + 1.0, z - 4.2);
        let mut shots = Vec::new();
        for change in [
            NO_CHANGE,
            LampChange {
                on: Some(true),
                ..NO_CHANGE
            },
            LampChange {
                intensity_lm: Some(0.5 * lamp.intensity_lm),
                ..NO_CHANGE
            },
            LampChange {
                intensity_lm: Some(lamp.intensity_lm),
                rgb: Some([255, 30, 20]),
                ..NO_CHANGE
            },
            LampChange {
                on: Some(false),
                ..NO_CHANGE
            },
        ] {
            switch(&mut stage, lamp.lamp, change);
            let seen = eye.look(&stage, "night", pose, linear());
            let at = seen.pixel(&pose, below).expect("in the picture");
            shots.push((radiance(seen.rgb[at]), seen.labels));
        }
        let of = |i: usize| shots[i].0 - shots[0].0;
        println!(
            "{quality:?}: {:?}",
            shots.iter().map(|shot| shot.0).collect::<Vec<_>>()
        );
        assert!(
            of(1).sum() > 0.02,
            "the lamp lights the ground: {:?}",
            of(1)
        );
        let ratio = of(2).sum() / of(1).sum();
        assert!(
            (ratio - 0.5).abs() < 0.06,
            "half the lumen, {ratio} of the light"
        );
        assert!(
            of(3).x > 4.0 * of(3).y && of(3).x > 4.0 * of(3).z,
            "red light: {:?}",
            of(3)
        );
        assert!(of(4).norm() < 1e-9, "off again as before");
        assert!(
            shots.iter().all(|shot| shot.1 == shots[0].1),
            "nothing but colours changes"
        );
    }
}

#[test]
fn a_buildings_windows_go_dark_light_up_and_take_a_colour() {
    for quality in [Quality::Low, Quality::High] {
        let mut stage = Stage::new("Town10HD", 3, 0).unwrap();
        let mut eye = Eye::new(quality, 80.0);
        let pose = stage.camera(57, 0.0, 25.0, -12.0);
        let windows = lamps_of(&mut stage, 3);
        assert!(
            windows.len() > 100 && windows.iter().all(|lamp| !lamp.on),
            "it is day: {}",
            windows.len()
        );
        let seen = eye.look(&stage, "night", pose, linear());
        // The building that fills most of the picture.
        let ids = seen.ids();
        let count = |id: u32| ids.iter().filter(|of| **of == id).count();
        let lamp = windows
            .iter()
            .max_by_key(|lamp| count(lamp.object_id))
            .expect("there are buildings")
            .clone();
        assert!(
            count(lamp.object_id) > 4000,
            "{} pixels",
            count(lamp.object_id)
        );
        // Pixels of it in which a channel differs by more than this much.
        let brighter = |a: &Seen, b: &Seen, c: usize| {
            (0..ids.len())
                .filter(|i| {
                    ids[*i] == lamp.object_id
                        && i32::from(a.rgb[*i][c]) > i32::from(b.rgb[*i][c]) + 60
                })
                .count()
        };
        switch(
            &mut stage,
            lamp.lamp,
            LampChange {
                on: Some(false),
                ..NO_CHANGE
            },
        );
        let off = eye.look(&stage, "night", pose, linear());
        let n_lit = brighter(&seen, &off, 0);
        assert!(
            n_lit > 60 && brighter(&off, &seen, 0) == 0,
            "windows shone before and do not now: {n_lit}"
        );
        switch(
            &mut stage,
            lamp.lamp,
            LampChange {
                on: Some(true),
                rgb: Some([20, 60, 255]),
                ..NO_CHANGE
            },
        );
        let blue = eye.look(&stage, "night", pose, linear());
        assert!(
            brighter(&blue, &off, 2) > 60 && brighter(&blue, &off, 0) == 0,
            "they shine blue: {}",
            brighter(&blue, &off, 2)
        );
        let by_day = [eye.look(&stage, "overcast", pose, linear()), {
            switch(
                &mut stage,
                lamp.lamp,
                LampChange {
                    on: Some(false),
                    ..NO_CHANGE
                },
            );
            eye.look(&stage, "overcast", pose, linear())
        }];
        let changed = (0..ids.len()).filter(|i| by_day[0].rgb[*i] != by_day[1].rgb[*i]);
        let (on_it, elsewhere): (Vec<usize>, Vec<usize>) =
            changed.partition(|i| ids[*i] == lamp.object_id);
        assert!(
            on_it.len() > 20,
            "windows that are switched on shine by day: {}",
            on_it.len()
        );
        assert!(
            elsewhere.len() < on_it.len() / 4,
            "mirrors aside, nothing else changes: {} of {}",
            elsewhere.len(),
            on_it.len()
        );
        assert!(
            [&off, &blue, &by_day[0]]
                .iter()
                .all(|other| other.labels == seen.labels),
            "nothing but colours changes"
        );
    }
}

#[test]
fn a_tunnels_lamps_can_be_switched() {
    let mut stage = Stage::new("Town03", 3, 0).unwrap();
    let mut eye = Eye::new(Quality::Low, 80.0);
    let lamps = lamps_of(&mut stage, 4);
    assert!(lamps.len() > 5);
    let [a, b] = [0, 1].map(|k| Vector3::from(lamps[lamps.len() / 2 + k].position_m));
    let along = b - a;
    let from = a - along.normalize() * 12.0 - Vector3::z() * 3.5;
    let pose = Isometry3::new(from, Vector3::z() * along.y.atan2(along.x));
    let with = eye.look(&stage, "night", pose, OpticsSpec::default());
    let changes = lamps
        .iter()
        .map(|lamp| LampChange {
            lamp: lamp.lamp,
            on: Some(false),
            ..NO_CHANGE
        })
        .collect();
    stage.apply(&Command::SetSceneryLamps { changes }).unwrap();
    let without = eye.look(&stage, "night", pose, OpticsSpec::default());
    let at = with.pixel(&pose, Point3::from(a)).expect("in the picture");
    assert!(
        luma(with.rgb[at]) > 200.0 && luma(without.rgb[at]) < 90.0,
        "{:?} and {:?}",
        with.rgb[at],
        without.rgb[at]
    );
    let mean =
        |seen: &Seen| seen.rgb.iter().map(|rgb| luma(*rgb)).sum::<f64>() / seen.rgb.len() as f64;
    assert!(
        mean(&without) < 0.7 * mean(&with),
        "the tunnel is dark: {} and {}",
        mean(&without),
        mean(&with)
    );
    assert!(with.labels == without.labels);
}
