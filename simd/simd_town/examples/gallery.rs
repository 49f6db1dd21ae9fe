//! Pictures of the towns as the daemon's cameras draw them.
//!
//! ```text
//! cargo run --release -p simd_town --example gallery                       the pictures of docs/gallery
//! cargo run --release -p simd_town --example gallery -- FOLDER TOWN        streets of a town, from every twentieth spawn point or so
//! cargo run --release -p simd_town --example gallery -- FOLDER TOWN X Y Z YAW_DEG PITCH_DEG [LIGHT]
//! ```
//!
//! LIGHT is `noon` (default), `evening`, `night`, `overcast`, `fog` or `rain`. Every picture's
//! visible triangles are printed, as counted by the renderer that drew them.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::Modality;
use schema_frames::document::Weather;
use schema_types::{ActorId, SimTime, Tick};
use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob, ViewSpec};
use sensor_core::{DynamicInstance, MeshId, Scene};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::{DvsSpec, Intrinsics};
use simd_body::{BodyStyle, VehicleShape, vehicle_meshes};
use simd_town::Town;

const SIZE_PX: [u32; 2] = [960, 600];

/// A picture: file, town, position of the eye, yaw and pitch in degrees, light.
type Shot = (&'static str, &'static str, [f64; 3], f64, f64, &'static str);

/// What `docs/gallery` shows.
const SHOTS: [Shot; 15] = [
    (
        "town01_small_town",
        "Town01",
        [-96.0, -20.0, 26.0],
        24.0,
        -18.0,
        "noon",
    ),
    (
        "town02_terraces",
        "Town02",
        [5.5, -50.0, 1.9],
        90.0,
        0.0,
        "evening",
    ),
    (
        "town03_roundabout",
        "Town03",
        [0.0, -62.0, 48.0],
        90.0,
        -42.0,
        "overcast",
    ),
    (
        "town03_tunnel",
        "Town03",
        [16.0, 223.2, 9.0],
        0.0,
        0.0,
        "overcast",
    ),
    (
        "town04_interchange",
        "Town04",
        [470.0, -100.0, 34.0],
        62.0,
        -18.0,
        "noon",
    ),
    (
        "town04_motorway",
        "Town04",
        [-82.0, 10.0, 15.0],
        -5.0,
        -9.0,
        "evening",
    ),
    (
        "town05_viaduct",
        "Town05",
        [-97.0, -38.0, 2.0],
        84.0,
        4.0,
        "noon",
    ),
    (
        "town06_highway",
        "Town06",
        [-250.0, -13.0, 3.2],
        0.0,
        1.0,
        "noon",
    ),
    (
        "town07_country",
        "Town07",
        [-96.0, -88.0, 15.0],
        44.0,
        -8.0,
        "noon",
    ),
    (
        "town08_rings",
        "Town08",
        [-60.0, -210.0, 60.0],
        78.0,
        -22.0,
        "noon",
    ),
    (
        "town09_slope",
        "Town09",
        [-330.0, -190.0, 34.0],
        40.0,
        -16.0,
        "noon",
    ),
    (
        "town10_street",
        "Town10HD",
        [-45.5, -26.0, 2.0],
        90.0,
        1.0,
        "noon",
    ),
    (
        "town10_night",
        "Town10HD",
        [-45.5, -26.0, 2.0],
        90.0,
        1.0,
        "night",
    ),
    (
        "town10_rain",
        "Town10HD",
        [20.0, 41.0, 2.0],
        176.0,
        0.0,
        "rain",
    ),
    (
        "town15_campus",
        "Town15",
        [-330.0, -60.0, 46.0],
        14.0,
        -20.0,
        "noon",
    ),
];

/// Draws one town.
struct Studio {
    gpu: Gpu,
    renderer: CameraRenderer,
    view: View,
    town: Town,
    scene: Scene,
}

const SHAPES: [(VehicleShape, [u8; 3]); 6] = [
    (
        VehicleShape {
            style: BodyStyle::Saloon,
            half_m: [2.396, 1.082, 0.744],
            wheel_radius_m: 0.34,
            wheelbase_m: 2.88,
        },
        [176, 20, 30],
    ),
    (
        VehicleShape {
            style: BodyStyle::Hatch,
            half_m: [1.994, 0.925, 0.809],
            wheel_radius_m: 0.31,
            wheelbase_m: 2.54,
        },
        [40, 90, 170],
    ),
    (
        VehicleShape {
            style: BodyStyle::Suv,
            half_m: [2.302, 0.966, 0.927],
            wheel_radius_m: 0.37,
            wheelbase_m: 2.75,
        },
        [70, 84, 66],
    ),
    (
        VehicleShape {
            style: BodyStyle::Van,
            half_m: [2.958, 0.994, 1.280],
            wheel_radius_m: 0.35,
            wheelbase_m: 3.66,
        },
        [235, 235, 235],
    ),
    (
        VehicleShape {
            style: BodyStyle::Saloon,
            half_m: [2.396, 1.082, 0.744],
            wheel_radius_m: 0.34,
            wheelbase_m: 2.88,
        },
        [188, 192, 196],
    ),
    (
        VehicleShape {
            style: BodyStyle::Lorry,
            half_m: [3.962, 1.432, 1.892],
            wheel_radius_m: 0.48,
            wheelbase_m: 4.6,
        },
        [30, 80, 150],
    ),
];

impl Studio {
    fn new(name: &str, night: bool) -> Result<Studio, Box<dyn std::error::Error>> {
        let gpu = Gpu::open(&GpuOptions::default())?;
        let renderer = CameraRenderer::new(&gpu, Quality::High);
        let intrinsics = Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], 80f64.to_radians());
        let view = View::new(
            &gpu,
            ViewSpec {
                intrinsics,
                lens: None,
                optics: Default::default(),
                dvs: DvsSpec::default(),
                seed: 1,
                sensor_id: 1,
                shows_overlay: false,
            },
        );
        let mut town = Town::generate(name, 1)?;
        let fleet: Vec<_> = SHAPES
            .iter()
            .map(|(shape, tint)| {
                let meshes = vehicle_meshes(shape);
                (
                    town.assets.add_mesh(meshes.body),
                    town.assets.add_mesh(meshes.wheel),
                    meshes.wheels,
                    *tint,
                )
            })
            .collect();
        let head = town.assets.add_mesh(town.light_head.clone());
        let mut dynamics = Vec::new();
        let mut add = |mesh: MeshId,
                       part: u16,
                       actor: u32,
                       pose: Isometry3<f64>,
                       tint_rgb: [u8; 3],
                       lamps: u32| {
            let velocity_in_world_mps = Vector3::zeros();
            dynamics.push(DynamicInstance {
                actor: ActorId(actor),
                part,
                mesh,
                world_from_mesh: pose,
                tint_rgb,
                lamps,
                velocity_in_world_mps,
            });
        };
        for (i, light) in town.lights.iter().enumerate() {
            for (part, pose) in light.heads.iter().enumerate() {
                add(
                    head,
                    part as u16,
                    1 + i as u32,
                    *pose,
                    [255; 3],
                    if i % 2 == 0 { 1 } else { 4 },
                );
            }
        }
        let first = 1 + town.lights.len() as u32;
        // As much traffic as a scenario has, well spread.
        let spread = (town.spawn_points.len() / 70).max(3);
        for (i, point) in town
            .spawn_points
            .iter()
            .enumerate()
            .filter(|(i, _)| i % spread == 1)
        {
            let (body, wheel, wheels, tint) = &fleet[(i / spread) % fleet.len()];
            let pose = point.isometry() * Isometry3::translation(0.0, 0.0, -0.3);
            add(
                *body,
                0,
                first + i as u32,
                pose,
                *tint,
                if night { 0b11 } else { 0 },
            );
            for (k, site) in wheels.iter().enumerate() {
                let turn = Vector3::z() * if site.left { std::f64::consts::PI } else { 0.0 };
                add(
                    *wheel,
                    1 + k as u16,
                    first + i as u32,
                    pose * Isometry3::new(Vector3::from(site.centre_m), turn),
                    *tint,
                    0,
                );
            }
        }
        let assets = Arc::new(town.assets.clone());
        let (tick, sim_time) = (Tick(1), SimTime(50_000_000));
        let scene = Scene {
            tick,
            sim_time,
            period_nanos: 50_000_000,
            assets,
            dynamics,
            past: Default::default(),
            weather: Weather::default(),
            lidar_extinction_per_m: 0.0,
            debug: Vec::new(),
            overlay: Default::default(),
        };
        Ok(Studio {
            gpu,
            renderer,
            view,
            town,
            scene,
        })
    }

    fn shoot(
        &mut self,
        eye: [f64; 3],
        yaw_deg: f64,
        pitch_deg: f64,
        light: &str,
        file: &Path,
    ) -> Result<(), Box<dyn std::error::Error>> {
        self.scene.weather = weather(light);
        let rotation =
            UnitQuaternion::from_euler_angles(0.0, -pitch_deg.to_radians(), yaw_deg.to_radians());
        let world_from_sensor =
            Isometry3::from_parts(Translation3::from(Vector3::from(eye)), rotation);
        let mut bytes = vec![0; self.view.payload_bytes(Modality::Rgb)];
        let before = self.gpu.counters().counts().triangles;
        let mut draw = |bytes: &mut Vec<u8>| -> Result<(), Box<dyn std::error::Error>> {
            let outputs = vec![Output {
                modality: Modality::Rgb,
                place: Place::Memory(bytes),
            }];
            self.renderer
                .render(
                    &self.scene,
                    vec![ViewJob {
                        view: &mut self.view,
                        world_from_sensor,
                        outputs,
                    }],
                )?
                .wait()?;
            Ok(())
        };
        // The second frame reuses the first one's shadow map of static scenery.
        draw(&mut bytes)?;
        let first = self.gpu.counters().counts().triangles;
        draw(&mut bytes)?;
        let second = self.gpu.counters().counts().triangles;
        println!(
            "{}: {} triangles ({} with still shadows)",
            file.display(),
            second - first,
            first - before
        );
        save(file, &bytes)
    }
}

fn weather(light: &str) -> Weather {
    let clear = Weather::default();
    match light {
        "evening" => Weather {
            sun_altitude_deg: 9.0,
            sun_azimuth_deg: 200.0,
            cloudiness: 30.0,
            ..clear
        },
        "night" => Weather {
            sun_altitude_deg: -25.0,
            cloudiness: 20.0,
            ..clear
        },
        "overcast" => Weather {
            cloudiness: 90.0,
            ..clear
        },
        "fog" => Weather {
            fog_density: 55.0,
            cloudiness: 60.0,
            ..clear
        },
        "rain" => Weather {
            cloudiness: 90.0,
            precipitation: 70.0,
            precipitation_deposits: 70.0,
            wetness: 80.0,
            ..clear
        },
        _ => clear,
    }
}

/// Writes B G R A bytes as a JPEG.
fn save(file: &Path, bgra: &[u8]) -> Result<(), Box<dyn std::error::Error>> {
    let rgb: Vec<u8> = bgra
        .chunks_exact(4)
        .flat_map(|p| [p[2], p[1], p[0]])
        .collect();
    let out = std::io::BufWriter::new(std::fs::File::create(file)?);
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(out, 88);
    Ok(encoder.encode(&rgb, SIZE_PX[0], SIZE_PX[1], image::ExtendedColorType::Rgb8)?)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(args.first().map_or("docs/gallery", |text| text.as_str()));
    std::fs::create_dir_all(folder)?;
    let Some(name) = args.get(1) else {
        for (file, town, eye, yaw, pitch, light) in SHOTS {
            Studio::new(town, light == "night")?.shoot(
                eye,
                yaw,
                pitch,
                light,
                &folder.join(format!("{file}.jpg")),
            )?;
        }
        return Ok(());
    };
    let light = args.get(7).map_or("noon", |text| text.as_str());
    let mut studio = Studio::new(name, light == "night")?;
    let place: Vec<f64> = args[2..]
        .iter()
        .map_while(|text| text.parse().ok())
        .collect();
    if let [x, y, z, yaw, pitch] = place[..] {
        let file = args.get(8).map_or("here", |text| text.as_str());
        return studio.shoot(
            [x, y, z],
            yaw,
            pitch,
            light,
            &folder.join(format!("{file}.jpg")),
        );
    }
    let light = args.get(2).map_or("noon", |text| text.as_str());
    let n = studio.town.spawn_points.len();
    for k in 0..12 {
        // Spawn points that hold a vehicle are skipped.
        let spread = (n / 70).max(3);
        let i = (k * n + n / 2) / 12 / spread * spread + 2;
        let point = studio.town.spawn_points[i];
        let [x, y, z] = point.translation_m;
        studio.shoot(
            [x, y, z + 1.3],
            point.yaw_rad().to_degrees(),
            -1.0,
            light,
            &folder.join(format!("{name}_{i}.jpg")),
        )?;
    }
    Ok(())
}
