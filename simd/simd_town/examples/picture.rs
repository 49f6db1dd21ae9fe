//! Draws a town, or every vehicle body, on the CPU: for looking at what the generator makes.
//!
//! `cargo run --release -p simd_town --example picture -- OUT_FOLDER [TOWN] [SEED] [X Y Z YAW_DEG]`

use std::path::Path;
use std::time::Instant;

use nalgebra::{Isometry3, Point3, Vector3};
use schema_types::Pose;
use sensor_core::{Material, Mesh, Vertex};
use simd_town::{BodyStyle, Town, VehicleShape, vehicle_meshes};

/// A corner of a clipped triangle: position in the camera, position in the world, normal.
type Corner = (Vector3<f64>, Vector3<f64>, Vector3<f64>);

const WIDTH: usize = 960;
const HEIGHT: usize = 600;

struct Canvas {
    rgb: Vec<[u8; 3]>,
    depth: Vec<f64>,
    eye: Vector3<f64>,
    /// Rows: right, down, forward.
    axes: [Vector3<f64>; 3],
    focal: f64,
    n_triangles: usize,
    n_meshes: usize,
    by_name: std::collections::BTreeMap<String, usize>,
}

impl Canvas {
    fn new(eye: Vector3<f64>, yaw: f64, pitch: f64, fov_deg: f64) -> Canvas {
        let forward = Vector3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
        let right = Vector3::new(yaw.sin(), -yaw.cos(), 0.0);
        let down = forward.cross(&right);
        let focal = 0.5 * WIDTH as f64 / (0.5 * fov_deg.to_radians()).tan();
        let rgb = (0..WIDTH * HEIGHT).map(|i| sky((i / WIDTH) as f64 / HEIGHT as f64)).collect();
        Canvas {
            rgb,
            depth: vec![f64::INFINITY; WIDTH * HEIGHT],
            eye,
            axes: [right, down, forward],
            focal,
            n_triangles: 0,
            n_meshes: 0,
            by_name: Default::default(),
        }
    }

    fn mesh(&mut self, mesh: &Mesh, pose: &Isometry3<f64>, tint: [u8; 3]) {
        let centre = (pose * Point3::from(Vector3::from(mesh.centre_m).cast::<f64>())).coords - self.eye;
        let (radius, forward) = (f64::from(mesh.radius_m), centre.dot(&self.axes[2]));
        let margin = |a: usize, half: f64| {
            let slope = half / self.focal;
            centre.dot(&self.axes[a]).abs() - forward * slope > radius * (1.0 + slope * slope).sqrt()
        };
        if forward < -radius || margin(0, 0.5 * WIDTH as f64) || margin(1, 0.5 * HEIGHT as f64) {
            return;
        }
        let away = (centre.norm() - radius) as f32;
        let Some(lod) = mesh.lods.iter().find(|lod| away < lod.until_m) else { return };
        self.n_meshes += 1;
        for t in mesh.indices[lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize].chunks_exact(3) {
            let vertices = [0, 1, 2].map(|i| &mesh.vertices[t[i] as usize]);
            self.triangle(vertices, pose, tint);
        }
        let name = mesh.name.split(' ').next().unwrap_or_default().to_owned();
        *self.by_name.entry(name).or_default() += lod.n_indices as usize / 3;
        self.n_triangles += lod.n_indices as usize / 3;
    }

    fn triangle(&mut self, vertices: [&Vertex; 3], pose: &Isometry3<f64>, tint: [u8; 3]) {
        let corner = |v: &Vertex| {
            let world = (pose * Point3::from(Vector3::from(v.position_m).cast::<f64>())).coords - self.eye;
            let normal = pose.rotation * Vector3::new(v.normal[0] as f64, v.normal[1] as f64, v.normal[2] as f64) / 127.0;
            let camera = Vector3::new(world.dot(&self.axes[0]), world.dot(&self.axes[1]), world.dot(&self.axes[2]));
            (camera, normal, Vector3::new(v.uv_m[0] as f64, v.uv_m[1] as f64, 0.0))
        };
        let corners = vertices.map(corner);
        let mut polygon: Vec<_> = Vec::new();
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            if a.0.z > 0.1 {
                polygon.push(a);
            }
            if (a.0.z > 0.1) != (b.0.z > 0.1) {
                let k = (0.1 - a.0.z) / (b.0.z - a.0.z);
                polygon.push((a.0 + (b.0 - a.0) * k, a.1 + (b.1 - a.1) * k, a.2 + (b.2 - a.2) * k));
            }
        }
        for i in 1..polygon.len().saturating_sub(1) {
            self.fill([polygon[0], polygon[i], polygon[i + 1]], vertices[0], tint);
        }
    }

    fn fill(&mut self, c: [Corner; 3], vertex: &Vertex, tint: [u8; 3]) {
        let p = c.map(|v| [0.5 * WIDTH as f64 + self.focal * v.0.x / v.0.z, 0.5 * HEIGHT as f64 + self.focal * v.0.y / v.0.z]);
        let area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
        if area >= -1e-9 {
            return;
        }
        let span = |axis: usize, limit: usize| {
            let (low, high) = p.iter().fold((f64::MAX, f64::MIN), |(l, h), q| (l.min(q[axis]), h.max(q[axis])));
            (low.floor().clamp(0.0, limit as f64) as usize, high.ceil().clamp(0.0, limit as f64) as usize)
        };
        let ((x0, x1), (y0, y1)) = (span(0, WIDTH), span(1, HEIGHT));
        for y in y0..y1 {
            for x in x0..x1 {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let edge = |a: usize, b: usize| ((p[b][0] - p[a][0]) * (py - p[a][1]) - (px - p[a][0]) * (p[b][1] - p[a][1])) / area;
                let w = [edge(1, 2), edge(2, 0), edge(0, 1)];
                if w.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let inverse: f64 = (0..3).map(|i| w[i] / c[i].0.z).sum();
                let z = 1.0 / inverse;
                let idx = y * WIDTH + x;
                if z < self.depth[idx] {
                    self.depth[idx] = z;
                    let weight = [0, 1, 2].map(|i| w[i] / c[i].0.z * z);
                    let mix = |f: fn(&Corner) -> Vector3<f64>| f(&c[0]) * weight[0] + f(&c[1]) * weight[1] + f(&c[2]) * weight[2];
                    self.rgb[idx] = shade(vertex, mix(|v| v.1), mix(|v| v.2), z, tint);
                }
            }
        }
    }

    fn save(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(std::fs::File::create(path)?), WIDTH as u32, HEIGHT as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(bytemuck::cast_slice(&self.rgb))?;
        println!("{}: {} triangles in {} meshes {:?}", path.display(), self.n_triangles, self.n_meshes, self.by_name);
        Ok(())
    }
}

fn sky(down: f64) -> [u8; 3] {
    let k = down.min(0.6) / 0.6;
    [(110.0 + 90.0 * k) as u8, (160.0 + 55.0 * k) as u8, (215.0 + 15.0 * k) as u8]
}

fn shade(vertex: &Vertex, normal: Vector3<f64>, uv: Vector3<f64>, z: f64, tint: [u8; 3]) -> [u8; 3] {
    let sun = Vector3::new(0.45, 0.35, 0.82).normalize();
    let normal = normal.normalize();
    let light = 0.42 + 0.14 * normal.z + 0.62 * normal.dot(&sun).max(0.0);
    let is = |material: Material| vertex.material == material as u8;
    let mut rgb = [0, 1, 2].map(|i| f64::from(vertex.color[i]));
    if is(Material::CarPaint) {
        rgb = [0, 1, 2].map(|i| rgb[i] * f64::from(tint[i]) / 255.0);
    }
    if is(Material::Facade) || is(Material::ShopFront) {
        let (w, h) = if is(Material::Facade) { (2.4, 3.2) } else { (4.0, 4.2) };
        let (u, v) = (uv.x.rem_euclid(w) / w, uv.y.rem_euclid(h) / h);
        let pane = if is(Material::Facade) {
            (0.28..0.72).contains(&u) && (0.3..0.8).contains(&v)
        } else {
            (0.06..0.94).contains(&u) && (0.12..0.8).contains(&v)
        };
        if pane {
            rgb = [58.0, 70.0, 82.0];
        }
    }
    if is(Material::Lamp) {
        rgb = rgb.map(|x| 0.55 * x);
    }
    let fog = (z / 900.0).min(0.5);
    let lit = rgb.map(|x| x * light);
    [0, 1, 2].map(|i| (lit[i].min(255.0) * (1.0 - fog) + [200.0, 215.0, 230.0][i] * fog) as u8)
}

const SHAPES: [(VehicleShape, [u8; 3]); 8] = [
    (VehicleShape { style: BodyStyle::Saloon, half_m: [2.396, 1.082, 0.744], wheel_radius_m: 0.34, wheelbase_m: 2.88 }, [176, 20, 30]),
    (VehicleShape { style: BodyStyle::Hatch, half_m: [1.994, 0.925, 0.809], wheel_radius_m: 0.31, wheelbase_m: 2.54 }, [40, 90, 170]),
    (VehicleShape { style: BodyStyle::Suv, half_m: [2.302, 0.966, 0.927], wheel_radius_m: 0.37, wheelbase_m: 2.75 }, [70, 84, 66]),
    (VehicleShape { style: BodyStyle::Van, half_m: [2.958, 0.994, 1.280], wheel_radius_m: 0.35, wheelbase_m: 3.66 }, [235, 235, 235]),
    (VehicleShape { style: BodyStyle::Bus, half_m: [5.1, 1.97, 1.55], wheel_radius_m: 0.48, wheelbase_m: 5.6 }, [220, 170, 30]),
    (VehicleShape { style: BodyStyle::Lorry, half_m: [3.962, 1.432, 1.892], wheel_radius_m: 0.48, wheelbase_m: 4.6 }, [30, 80, 150]),
    (VehicleShape { style: BodyStyle::Motorcycle, half_m: [1.105, 0.434, 0.75], wheel_radius_m: 0.3, wheelbase_m: 1.4 }, [200, 60, 20]),
    (VehicleShape { style: BodyStyle::Bicycle, half_m: [0.918, 0.3, 0.85], wheel_radius_m: 0.34, wheelbase_m: 1.06 }, [30, 110, 70]),
];

fn vehicle(canvas: &mut Canvas, shape: &VehicleShape, tint: [u8; 3], pose: &Isometry3<f64>) {
    let meshes = vehicle_meshes(shape);
    canvas.mesh(&meshes.body, pose, tint);
    for site in &meshes.wheels {
        let turn = Vector3::z() * if site.left { std::f64::consts::PI } else { 0.0 };
        canvas.mesh(&meshes.wheel, &(pose * Isometry3::new(Vector3::from(site.centre_m), turn)), tint);
    }
}

fn fleet(folder: &Path) -> Result<(), Box<dyn std::error::Error>> {
    for (name, yaw, eye) in [("fleet_front", 3.6, [9.0, 3.2, 2.0]), ("fleet_rear", -0.45, [-9.5, 4.2, 2.4])] {
        for (half, shapes) in [SHAPES[..4].iter().collect::<Vec<_>>(), SHAPES[4..].iter().collect()].iter().enumerate() {
            let mut canvas = Canvas::new(Vector3::from(eye), yaw, -0.14, 62.0);
            let mut y = if half == 0 { 4.0 } else { 2.6 };
            for (shape, tint) in shapes {
                vehicle(&mut canvas, shape, *tint, &Isometry3::translation(0.0, y - shape.half_m[1], 0.0));
                y -= 2.0 * shape.half_m[1] + 0.7;
            }
            canvas.save(&folder.join(format!("{name}{half}.png")))?;
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let folder = std::path::PathBuf::from(args.next().ok_or("usage: picture OUT_FOLDER [TOWN] [SEED] [X Y Z YAW_DEG]")?);
    let name = args.next().unwrap_or_else(|| "Town10HD".to_owned());
    let seed = args.next().map_or(Ok(1), |text| text.parse())?;
    std::fs::create_dir_all(&folder)?;
    let start = Instant::now();
    let town = Town::generate(&name, seed)?;
    let sum = |level: usize| -> usize {
        town.assets.statics.iter().map(|s| town.assets.mesh(s.mesh).lods.get(level).map_or(0, |lod| lod.n_indices as usize / 3)).sum()
    };
    println!(
        "generated in {:?}: {} meshes, {} instances, {} objects, {} spawn points, {} lights, triangles {} near, {} far, collision {}",
        start.elapsed(),
        town.assets.meshes.len(),
        town.assets.statics.len(),
        town.objects.len(),
        town.spawn_points.len(),
        town.lights.len(),
        sum(0),
        sum(2),
        town.collision.iter().map(|c| c.triangles.len()).sum::<usize>(),
    );
    let view = |name: &str, eye: Vector3<f64>, yaw: f64, pitch: f64, fov: f64| {
        let mut canvas = Canvas::new(eye, yaw, pitch, fov);
        for each in &town.assets.statics {
            canvas.mesh(town.assets.mesh(each.mesh), &each.world_from_mesh, [255; 3]);
        }
        for head in town.lights.iter().flat_map(|light| &light.heads) {
            canvas.mesh(&town.light_head, head, [255; 3]);
        }
        for (i, point) in town.spawn_points.iter().enumerate().step_by(7) {
            let (shape, tint) = SHAPES[[0, 1, 2, 3, 0, 1, 2, 4, 5, 6, 7][i % 11]];
            let pose = point.isometry() * Isometry3::translation(0.0, 0.0, -0.3);
            vehicle(&mut canvas, &shape, tint, &pose);
        }
        canvas.save(&folder.join(name))
    };
    let place: Vec<f64> = args.map(|text| text.parse()).collect::<Result<_, _>>()?;
    if let [x, y, z, yaw_deg] = place[..] {
        return view("here.png", Vector3::new(x, y, z), yaw_deg.to_radians(), -0.03, 90.0);
    }
    let at = |i: usize| -> &Pose { &town.spawn_points[i % town.spawn_points.len()] };
    for i in [3, 57, 101, 150, 190, 240, 300, 340] {
        let p = at(i);
        view(&format!("street_{i}.png"), Vector3::from(p.translation_m) + Vector3::new(0.0, 0.0, 1.3), p.yaw_rad(), -0.03, 90.0)?;
    }
    view("above.png", Vector3::new(-240.0, -250.0, 150.0), 0.8, -0.48, 70.0)?;
    view("plan.png", Vector3::new(0.0, 0.0, 420.0), std::f64::consts::FRAC_PI_2, -1.57, 80.0)?;
    view("centre.png", Vector3::new(-48.0, -25.0, 22.0), 1.45, -0.3, 80.0)?;
    fleet(&folder)
}
