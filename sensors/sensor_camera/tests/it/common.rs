//! What the camera's tests and examples share: a device, a small street, and rendering to plain
//! memory.
#![allow(dead_code)] // Each test binary uses its own part of it.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::Modality;
use schema_frames::document::Weather;
use schema_types::{ActorId, Class, ObjectId, SimTime, Tick};
use sensor_camera::{
    CameraRenderer, Output, OutputResult, Place, Rasteriser, View, ViewJob, ViewSpec,
};
use sensor_core::mesh::Surface;
use sensor_core::{
    DynamicInstance, Material, Mesh, MeshBuilder, MeshId, Scene, SceneAssets, StaticInstance,
};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::{DvsSpec, Intrinsics};

pub fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Rasterisers that the product uses on this adapter. A GPU's own rasteriser has too coarse a depth
/// (7e-4 relative on an H200), so it is used only if the GPU cannot compute; software adapters do
/// both.
pub fn rasterisers(gpu: &Gpu) -> Vec<Rasteriser> {
    if gpu.is_software() {
        vec![Rasteriser::Drawn, Rasteriser::Computed]
    } else {
        vec![Rasteriser::default_for(gpu)]
    }
}

pub fn view(gpu: &Gpu, width_px: u32, height_px: u32) -> View {
    view_with(gpu, width_px, height_px, DvsSpec::default())
}

pub fn view_with(gpu: &Gpu, width_px: u32, height_px: u32, dvs: DvsSpec) -> View {
    let intrinsics = Intrinsics::from_fov(width_px, height_px, 90f64.to_radians());
    View::new(
        gpu,
        ViewSpec {
            dvs,
            seed: 7,
            sensor_id: 3,
            ..ViewSpec::pinhole(intrinsics)
        },
    )
}

/// Pose from position and roll, pitch, yaw in degrees.
pub fn pose(x_m: f64, y_m: f64, z_m: f64, rpy_deg: [f64; 3]) -> Isometry3<f64> {
    let [r, p, y] = rpy_deg.map(f64::to_radians);
    Isometry3::from_parts(
        Translation3::new(x_m, y_m, z_m),
        UnitQuaternion::from_euler_angles(r, p, y),
    )
}

pub fn scene(assets: &Arc<SceneAssets>, dynamics: Vec<DynamicInstance>, nanos: u64) -> Scene {
    Scene {
        tick: Tick(nanos / 50_000_000),
        sim_time: SimTime(nanos),
        period_nanos: 50_000_000,
        assets: assets.clone(),
        dynamics,
        past: Default::default(),
        weather: Weather::default(),
        lidar_extinction_per_m: 0.0,
        debug: Vec::new(),
        overlay: Default::default(),
    }
}

pub fn moving(actor: u32, mesh: MeshId, world_from_mesh: Isometry3<f64>) -> DynamicInstance {
    DynamicInstance {
        actor: ActorId(actor),
        part: 0,
        mesh,
        world_from_mesh,
        tint_rgb: [170, 20, 24],
        lamps: 0,
        velocity_in_world_mps: Vector3::zeros(),
    }
}

pub fn fixed(mesh: MeshId, world_from_mesh: Isometry3<f64>) -> StaticInstance {
    StaticInstance {
        mesh,
        world_from_mesh,
        object: ObjectId::scenery(mesh.0),
    }
}

/// Renders one view to plain memory.
pub fn render(
    renderer: &mut CameraRenderer,
    scene: &Scene,
    view: &mut View,
    world_from_sensor: Isometry3<f64>,
    modalities: &[Modality],
) -> BTreeMap<Modality, (Vec<u8>, OutputResult)> {
    let mut bytes: Vec<Vec<u8>> = modalities
        .iter()
        .map(|m| vec![0xa5; view.payload_bytes(*m)])
        .collect();
    let outputs = modalities
        .iter()
        .zip(&mut bytes)
        .map(|(m, bytes)| Output {
            modality: *m,
            place: Place::Memory(bytes),
        })
        .collect();
    let results = renderer
        .render(
            scene,
            vec![ViewJob {
                view,
                world_from_sensor,
                outputs,
            }],
        )
        .unwrap()
        .wait()
        .unwrap();
    let cut = |(mut bytes, result): (Vec<u8>, OutputResult)| {
        bytes.truncate(result.n_bytes);
        (result.modality, (bytes, result))
    };
    bytes
        .into_iter()
        .zip(results[0].outputs.iter().copied())
        .map(cut)
        .collect()
}

pub fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

pub fn words(bytes: &[u8]) -> Vec<u32> {
    bytes
        .chunks_exact(4)
        .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

pub fn cuboid(name: &str, surface: Surface, centre_m: [f32; 3], half_m: [f32; 3]) -> Mesh {
    let mut builder = MeshBuilder::new(name);
    builder.cuboid(surface, centre_m, half_m);
    builder.finish()
}

/// A car of boxes, its origin on the ground below its middle.
pub fn car() -> Mesh {
    let mut builder = MeshBuilder::new("car");
    let paint = Surface::new(Class::CAR, Material::CarPaint, [160, 160, 165]);
    let glass = Surface::new(Class::CAR, Material::Glass, [40, 44, 50]);
    let rubber = Surface::new(Class::CAR, Material::Rubber, [25, 25, 25]);
    builder.cuboid(paint, [0.0, 0.0, 0.65], [2.2, 0.9, 0.35]);
    builder.cuboid(glass, [-0.2, 0.0, 1.2], [1.1, 0.78, 0.22]);
    builder.cuboid(paint, [-0.2, 0.0, 1.44], [1.05, 0.76, 0.03]);
    builder.cuboid(
        Surface::lamp(Class::CAR, [255, 240, 220], 0),
        [2.19, 0.6, 0.75],
        [0.03, 0.2, 0.08],
    );
    builder.cuboid(
        Surface::lamp(Class::CAR, [255, 240, 220], 0),
        [2.19, -0.6, 0.75],
        [0.03, 0.2, 0.08],
    );
    builder.cuboid(
        Surface::lamp(Class::CAR, [255, 30, 20], 1),
        [-2.19, 0.6, 0.8],
        [0.03, 0.2, 0.08],
    );
    builder.cuboid(
        Surface::lamp(Class::CAR, [255, 30, 20], 1),
        [-2.19, -0.6, 0.8],
        [0.03, 0.2, 0.08],
    );
    for (x, y) in [(1.35, 0.8), (1.35, -0.8), (-1.35, 0.8), (-1.35, -0.8)] {
        builder.cuboid(rubber, [x, y, 0.33], [0.33, 0.12, 0.33]);
    }
    builder.finish()
}

fn ground(half_m: f32) -> Mesh {
    let mut builder = MeshBuilder::new("ground");
    let quad = |builder: &mut MeshBuilder, surface, y0: f32, y1: f32, z: f32| {
        let corners = [
            [-half_m, y0, z],
            [half_m, y0, z],
            [half_m, y1, z],
            [-half_m, y1, z],
        ];
        builder.quad(
            surface,
            corners,
            [
                [0.0, 0.0],
                [2.0 * half_m, 0.0],
                [2.0 * half_m, y1 - y0],
                [0.0, y1 - y0],
            ],
        );
    };
    quad(
        &mut builder,
        Surface::new(Class::ROADS, Material::Asphalt, [88, 88, 90]),
        -5.0,
        5.0,
        0.0,
    );
    for sign in [-1.0f32, 1.0] {
        let (a, b) = if sign > 0.0 { (5.0, 9.0) } else { (-9.0, -5.0) };
        quad(
            &mut builder,
            Surface::new(Class::SIDEWALKS, Material::Concrete, [160, 156, 150]),
            a,
            b,
            0.12,
        );
        let (a, b) = if sign > 0.0 {
            (9.0, half_m)
        } else {
            (-half_m, -9.0)
        };
        quad(
            &mut builder,
            Surface::new(Class::TERRAIN, Material::Grass, [92, 118, 58]),
            a,
            b,
            0.1,
        );
    }
    for i in -20..20 {
        let x = i as f32 * 6.0;
        let paint = Surface::new(Class::ROAD_LINES, Material::Paint, [225, 225, 220]);
        builder.quad(
            paint,
            [
                [x, -0.07, 0.01],
                [x + 3.0, -0.07, 0.01],
                [x + 3.0, 0.07, 0.01],
                [x, 0.07, 0.01],
            ],
            [[0.0; 2]; 4],
        );
    }
    builder.finish()
}

fn tree() -> Mesh {
    let mut builder = MeshBuilder::new("tree");
    builder.cuboid(
        Surface::new(Class::VEGETATION, Material::Bark, [92, 74, 58]),
        [0.0, 0.0, 1.2],
        [0.14, 0.14, 1.2],
    );
    let leaves = Surface::new(Class::VEGETATION, Material::Foliage, [86, 122, 52]);
    let (rings, sectors) = (8, 12);
    let at = |ring: i32, sector: i32| {
        let (theta, phi) = (
            ring as f32 / rings as f32 * std::f32::consts::PI,
            sector as f32 / sectors as f32 * std::f32::consts::TAU,
        );
        let r = 1.7 + 0.25 * (3.0 * phi).sin() * theta.sin() + 0.2 * (5.0 * theta).cos();
        let n = [
            theta.sin() * phi.cos(),
            theta.sin() * phi.sin(),
            theta.cos(),
        ];
        ([n[0] * r, n[1] * r, 3.8 + 1.2 * n[2] * r], n)
    };
    for ring in 0..rings {
        for sector in 0..sectors {
            let corners = [
                at(ring + 1, sector),
                at(ring + 1, sector + 1),
                at(ring, sector + 1),
                at(ring, sector),
            ];
            builder.polygon_with_normals(
                leaves,
                &corners.map(|c| c.0),
                &corners.map(|c| c.1),
                &[[0.0; 2]; 4],
            );
        }
    }
    builder.finish()
}

/// A street with houses, trees and two cars; returns the assets and the car's mesh.
pub fn street() -> (Arc<SceneAssets>, MeshId) {
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let ground = assets.add_mesh(ground(130.0));
    assets.statics.push(fixed(ground, Isometry3::identity()));
    let colours = [
        [196, 178, 150],
        [168, 92, 74],
        [205, 200, 190],
        [150, 140, 126],
        [182, 150, 110],
    ];
    for i in -6..7i32 {
        for side in [-1.0f32, 1.0] {
            let k = (i + 6 + if side > 0.0 { 3 } else { 0 }) as usize;
            let height = 5.0 + (k * 7 % 5) as f32 * 1.6;
            let mut builder = MeshBuilder::new("house");
            let (x, y) = (0.0, 0.0);
            builder.cuboid(
                Surface::new(Class::BUILDINGS, Material::Facade, colours[k % 5]),
                [x, y, height],
                [8.5, 6.0, height],
            );
            builder.cuboid(
                Surface::new(Class::BUILDINGS, Material::Roof, [90, 70, 62]),
                [x, y, 2.0 * height + 0.2],
                [8.7, 6.2, 0.2],
            );
            let mesh = assets.add_mesh(builder.finish());
            assets.statics.push(fixed(
                mesh,
                pose(i as f64 * 18.0, side as f64 * 17.0, 0.1, [0.0; 3]),
            ));
        }
    }
    let tree = assets.add_mesh(tree());
    for i in -8..9 {
        assets.statics.push(fixed(
            tree,
            pose(i as f64 * 12.0 + 5.0, 7.6, 0.1, [0.0, 0.0, i as f64 * 40.0]),
        ));
        assets.statics.push(fixed(
            tree,
            pose(
                i as f64 * 12.0 - 1.0,
                -7.6,
                0.1,
                [0.0, 0.0, i as f64 * 70.0],
            ),
        ));
    }
    let car = assets.add_mesh(car());
    (Arc::new(assets), car)
}
