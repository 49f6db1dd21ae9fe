//! Colour through calibrated lenses: edges lie where the lens's equation says, over the whole field
//! and across the faces that the picture is made of; beyond the field it is black.
//!
//! The oracle has the equations in its own words, finds rays by bisection, and paints what a floor and
//! a ceiling of stripes look like, with 64 rays for each pixel that holds an edge. The distance between
//! that and the rendered picture is measured as Lucas and Kanade do (1981), in rings of the field.

use crate::common;

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use schema_frames::Modality;
use schema_types::Class;
use schema_types::lens::{Lens, LensModel, Plane};
use sensor_camera::{CameraRenderer, Quality, RenderError, View, ViewJob, ViewSpec};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, Scene, SceneAssets};
use sensor_spec::{ExposureMode, ExposureSpec, Intrinsics, OpticsSpec};

const WIDTH: usize = 400;
const HEIGHT: usize = 300;
const CENTRE_PX: [f64; 2] = [203.25, 147.5];
const STRIPE_M: f64 = 2.0;
const HEIGHT_M: f64 = 3.0;
/// Farther stripes are finer than pixels.
const FAR_M: f64 = 14.0;

/// A floor and a ceiling of red and blue stripes along x, and the camera's pose between them.
fn scene() -> (Scene, Isometry3<f64>) {
    let mut builder = MeshBuilder::new("stripes");
    for i in -40..40 {
        let rgb = if i % 2 == 0 {
            [230, 30, 30]
        } else {
            [30, 30, 230]
        };
        let surface = Surface::new(Class::ROADS, Material::CarPaint, rgb);
        let [y0, y1] = [i, i + 1].map(|i| (f64::from(i) * STRIPE_M) as f32);
        let top = (2.0 * HEIGHT_M) as f32;
        let floor = [
            [-80.0, y0, 0.0],
            [80.0, y0, 0.0],
            [80.0, y1, 0.0],
            [-80.0, y1, 0.0],
        ];
        let ceiling = [
            [-80.0, y1, top],
            [80.0, y1, top],
            [80.0, y0, top],
            [-80.0, y0, top],
        ];
        for corners in [floor, ceiling] {
            builder.quad(surface, corners, [[0.0; 2]; 4]);
        }
    }
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mesh = assets.add_mesh(builder.finish());
    assets
        .statics
        .push(common::fixed(mesh, Isometry3::identity()));
    let scene = common::scene(&Arc::new(assets), vec![], 50_000_000);
    (scene, common::pose(0.3, 0.4, HEIGHT_M, [3.0, 11.0, 24.0]))
}

/// Whether a direction of the camera (right, down, ahead) meets a red stripe; `None` far away.
fn is_red(pose: &Isometry3<f64>, [x, y, z]: [f64; 3]) -> Option<bool> {
    let ray = pose.rotation * Vector3::new(z, -x, -y);
    let away_m = HEIGHT_M / ray.z.abs();
    let at = pose.translation.vector + ray * away_m;
    let near = away_m < FAR_M;
    near.then(|| ((at.y / STRIPE_M).floor() as i64).rem_euclid(2) == 0)
}

/// The direction of a place in the picture by a radius that rises with the angle off the axis.
fn ray_by(
    radius: impl Fn(f64) -> f64,
    focal_px: f64,
    max_rad: f64,
    at: [f64; 2],
) -> Option<[f64; 3]> {
    let [u, v] = [0, 1].map(|axis| (at[axis] - CENTRE_PX[axis]) / focal_px);
    let r = u.hypot(v);
    let (mut low, mut high) = (0.0, max_rad);
    if r > radius(high) {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match radius(middle) < r {
            true => low = middle,
            false => high = middle,
        }
    }
    let (sin, cos) = low.sin_cos();
    Some([sin * u / r, sin * v / r, cos])
}

/// Share of red in each pixel; `None` beyond the field and far away.
fn painted(ray: impl Fn([f64; 2]) -> Option<[f64; 3]>, pose: &Isometry3<f64>) -> Vec<Option<f64>> {
    let red = |x: f64, y: f64| ray([x, y]).and_then(|it| is_red(pose, it));
    let corners: Vec<Option<bool>> = (0..(WIDTH + 1) * (HEIGHT + 1))
        .map(|i| red((i % (WIDTH + 1)) as f64, (i / (WIDTH + 1)) as f64))
        .collect();
    let pixel = |i: usize| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let first = y * (WIDTH + 1) + x;
        let own = [0, 1, WIDTH + 1, WIDTH + 2].map(|off| corners[first + off]);
        let first = own[0]?;
        if own.iter().all(|it| *it == own[0]) {
            return Some(f64::from(u8::from(first)));
        }
        let mut n = 0.0;
        for sub in 0..64 {
            let [dx, dy] = [sub % 8, sub / 8].map(|it| (f64::from(it) + 0.5) / 8.0);
            n += f64::from(u8::from(red(x as f64 + dx, y as f64 + dy)?));
        }
        Some(n / 64.0)
    };
    (0..WIDTH * HEIGHT).map(pixel).collect()
}

fn view(lens: &Lens, optics: OpticsSpec) -> View {
    View::of(ViewSpec {
        lens: Some(lens.clone()),
        optics,
        ..ViewSpec::pinhole(Intrinsics::from_fov(WIDTH as u32, HEIGHT as u32, 1.0))
    })
}

fn shoot(scene: &Scene, pose: &Isometry3<f64>, view: &mut View, quality: Quality) -> Vec<[u8; 4]> {
    let mut renderer = CameraRenderer::new(&common::gpu(), quality);
    let mut made = common::render(&mut renderer, scene, view, *pose, &[Modality::Rgb]);
    let (bytes, _) = made.remove(&Modality::Rgb).unwrap();
    bytes
        .chunks_exact(4)
        .map(|it| it.try_into().unwrap())
        .collect()
}

fn lens_of(model: LensModel, focal_px: f64, max_deg: f64) -> Lens {
    let plane = Plane {
        focal_px: [focal_px; 2],
        shear_px: [0.0; 2],
        centre_px: CENTRE_PX,
    };
    Lens::new(model, plane, Some(max_deg.to_radians())).unwrap()
}

/// Mean offset of the picture from what was painted, outwards and about, in those of five rings up to
/// `most_px` that have edges enough for it.
fn offsets(picture: &[[u8; 4]], painted: &[Option<f64>], most_px: f64) -> Vec<[f64; 2]> {
    let share = |i: usize| {
        let [b, _, r, _] = picture[i].map(f64::from);
        r / (r + b).max(1.0)
    };
    // What pure stripes have; shading changes it little.
    let mean = |wanted: f64| {
        let own = (0..painted.len()).filter(|i| painted[*i] == Some(wanted));
        let (n, sum) = own.fold((0.0, 0.0), |(n, sum), i| (n + 1.0, sum + share(i)));
        sum / n
    };
    let [blue, red] = [mean(0.0), mean(1.0)];
    let found = |i: usize| (share(i) - blue) / (red - blue);
    let mut sums = vec![[[0.0f64; 2]; 2]; 5];
    for y in 2..HEIGHT - 2 {
        for x in 2..WIDTH - 2 {
            let near = |dx: i64, dy: i64| {
                let [x, y] = [x as i64 + dx, y as i64 + dy];
                (y * WIDTH as i64 + x) as usize
            };
            // Both are smoothed alike, so that the gradient holds over the distance.
            let smooth = |image: &dyn Fn(usize) -> Option<f64>, dx: i64, dy: i64| {
                let around = (0..9).map(|k| image(near(dx + k % 3 - 1, dy + k / 3 - 1)));
                around.sum::<Option<f64>>().map(|sum| sum / 9.0)
            };
            let of_painted = |i: usize| painted[i];
            let ring = [(1, 0), (-1, 0), (0, 1), (0, -1), (0, 0)];
            let Some(own) = ring
                .map(|(dx, dy)| smooth(&of_painted, dx, dy))
                .into_iter()
                .collect::<Option<Vec<f64>>>()
            else {
                continue;
            };
            let gradient = [0.5 * (own[0] - own[1]), 0.5 * (own[2] - own[3])];
            let of_picture = |i: usize| Some(found(i));
            let off = smooth(&of_picture, 0, 0).unwrap() - own[4];
            let from = [x as f64 + 0.5 - CENTRE_PX[0], y as f64 + 0.5 - CENTRE_PX[1]];
            let r = from[0].hypot(from[1]).max(1.0);
            let out = [from[0] / r, from[1] / r];
            let along = gradient[0] * out[0] + gradient[1] * out[1];
            let about = gradient[1] * out[0] - gradient[0] * out[1];
            let ring = &mut sums[((5.0 * r / most_px) as usize).min(4)];
            // Least squares of off = -offset · gradient.
            for (sum, slope) in ring.iter_mut().zip([along, about]) {
                sum[0] -= off * slope;
                sum[1] += slope * slope;
            }
        }
    }
    let rings = sums
        .into_iter()
        .map(|ring| ring.map(|[sum, weight]| (sum / weight, weight)));
    let rings = rings.filter(|ring| ring.iter().all(|(_, weight)| *weight > 20.0));
    let found: Vec<[f64; 2]> = rings.map(|ring| ring.map(|(offset, _)| offset)).collect();
    assert!(found.len() >= 3, "too few edges");
    found
}

fn worst(offsets: &[[f64; 2]]) -> f64 {
    offsets
        .iter()
        .flatten()
        .fold(0.0, |most, it| most.max(it.abs()))
}

/// What is seen of a lens with the oracle's equation of radius over angle.
fn check(model: LensModel, focal_px: f64, max_deg: f64, radius: impl Fn(f64) -> f64 + Copy) {
    let (scene, pose) = scene();
    let max_rad = max_deg.to_radians();
    let most_px = (focal_px * radius(max_rad)).min(CENTRE_PX[0].hypot(CENTRE_PX[1]));
    let painted_by = |focal_px| painted(|at| ray_by(radius, focal_px, max_rad, at), &pose);
    let (right, wrong) = (painted_by(focal_px), painted_by(1.01 * focal_px));
    let lens = lens_of(model.clone(), focal_px, max_deg);
    let mut view = view(&lens, OpticsSpec::default());
    let picture = shoot(&scene, &pose, &mut view, Quality::Low);
    let found = offsets(&picture, &right, most_px);
    // A GPU weighs the texels of the faces with eight bits.
    let most = if common::gpu().is_software() {
        0.05
    } else {
        0.06
    };
    assert!(worst(&found) < most, "{model:?}: {found:?}");
    // A focal length that is 1 % longer shows.
    let planted = offsets(&picture, &wrong, most_px);
    assert!(worst(&planted) > 0.5, "{model:?}: {planted:?}");
    for (i, pixel) in picture.iter().enumerate() {
        let at = [(i % WIDTH) as f64 + 0.5, (i / WIDTH) as f64 + 0.5];
        if ray_by(radius, focal_px, max_rad + 0.01, at).is_none() {
            assert_eq!(*pixel, [0, 0, 0, 255], "{at:?}");
        }
    }
}

#[test]
fn a_fisheye_of_190_degrees_shows_edges_where_its_equation_does() {
    let k = [0.083092, -0.011121, 0.008587, -0.000854];
    let radius = move |t: f64| {
        t * (1.0 + k[0] * t.powi(2) + k[1] * t.powi(4) + k[2] * t.powi(6) + k[3] * t.powi(8))
    };
    check(
        LensModel::KannalaBrandt { coefficients: k },
        105.0,
        95.0,
        radius,
    );
}

/// Radius over angle of a double sphere (Usenko and others, 2018), for directions in its plane.
#[test]
fn a_double_sphere_and_a_distorted_pinhole_do() {
    let (xi, alpha) = (-0.2, 0.6);
    let double_sphere = move |t: f64| {
        let (s, c) = t.sin_cos();
        let second = s.hypot(xi + c);
        s / (alpha * second + (1.0 - alpha) * (xi + c))
    };
    check(
        LensModel::DoubleSphere { xi, alpha },
        85.0,
        90.0,
        double_sphere,
    );
    let (k1, k2) = (-0.12, 0.02);
    let brown = move |t: f64| {
        let r = t.tan();
        r * (1.0 + k1 * r.powi(2) + k2 * r.powi(4))
    };
    let coefficients = vec![k1, k2, 0.0, 0.0, 0.0];
    check(LensModel::OpenCv { coefficients }, 190.0, 55.0, brown);
}

/// Goal: a pinhole as a lens gives the picture that a pinhole view of the same size gives. High
/// quality filters shadows by the pixel's place, and its light moves edges between bright and dark in
/// both alike: there, edges have to lie at the same places.
#[test]
fn a_pinhole_as_a_lens_gives_the_picture_of_a_pinhole() {
    let (scene, pose) = scene();
    let focal_px = 260.0;
    let [cx, cy] = [200.0, 150.0];
    let plane = Plane {
        focal_px: [focal_px; 2],
        shear_px: [0.0; 2],
        centre_px: [cx, cy],
    };
    let lens = Lens::new(LensModel::Pinhole {}, plane, None).unwrap();
    let intrinsics = Intrinsics {
        width_px: WIDTH as u32,
        height_px: HEIGHT as u32,
        focal_px,
    };
    let ray = |[x, y]: [f64; 2]| Some([(x - cx) / focal_px, (y - cy) / focal_px, 1.0]);
    let painted = painted(ray, &pose);
    for quality in [Quality::Low, Quality::High] {
        let mut lensed = view(&lens, OpticsSpec::default());
        let through = shoot(&scene, &pose, &mut lensed, quality);
        let mut plain = View::of(ViewSpec::pinhole(intrinsics));
        let plain = shoot(&scene, &pose, &mut plain, quality);
        let of_pixel = |(a, b): (&[u8; 4], &[u8; 4])| (0..4).any(|i| a[i].abs_diff(b[i]) > 3);
        let n = through
            .iter()
            .zip(&plain)
            .filter(|it| of_pixel(*it))
            .count();
        let most = if quality == Quality::Low { 100 } else { 12_000 };
        assert!(n < most, "{quality:?}: {n} pixels differ");
        let [through, plain] = [&through, &plain].map(|it| offsets(it, &painted, 250.0));
        for (a, b) in through.iter().flatten().zip(plain.iter().flatten()) {
            assert!((a - b).abs() < 0.05, "{quality:?}: {through:?} {plain:?}");
        }
    }
}

/// Goal: what is done to a picture as one, is done across faces, and the dark beyond the field counts
/// for nothing: a metered fisheye is as bright as a metered pinhole of the same floor.
#[test]
fn glow_and_metering_treat_the_faces_as_one_picture() {
    let (scene, pose) = scene();
    let metered = |bloom_intensity| OpticsSpec {
        exposure: ExposureSpec {
            mode: ExposureMode::Histogram,
            ..Default::default()
        },
        bloom_intensity,
        ..Default::default()
    };
    let fisheye = lens_of(LensModel::Equidistant {}, 60.0, 95.0);
    let pinhole = lens_of(LensModel::Pinhole {}, 260.0, 80.0);
    let mean = |lens: &Lens, bloom: f32| {
        let picture = shoot(&scene, &pose, &mut view(lens, metered(bloom)), Quality::Low);
        let seen = picture.iter().enumerate().filter(|(i, _)| {
            let at = [(i % WIDTH) as f64 + 0.5, (i / WIDTH) as f64 + 0.5];
            lens.unproject(at).is_some()
        });
        let (n, sum) = seen.fold((0.0, 0.0), |(n, sum), (_, [b, g, r, _])| {
            (n + 1.0, sum + f64::from(*b) + f64::from(*g) + f64::from(*r))
        });
        let beyond = picture.iter().enumerate().filter(|(i, _)| {
            let at = [(i % WIDTH) as f64 + 0.5, (i / WIDTH) as f64 + 0.5];
            lens.unproject(at).is_none()
        });
        beyond.for_each(|(i, it)| assert_eq!(*it, [0, 0, 0, 255], "{i}"));
        sum / n / 3.0
    };
    let [wide, narrow, glowing] = [
        mean(&fisheye, 0.0),
        mean(&pinhole, 0.0),
        mean(&fisheye, 2.0),
    ];
    assert!((wide / narrow - 1.0).abs() < 0.25, "{wide} {narrow}");
    assert!((glowing / wide - 1.0).abs() < 0.1, "{glowing} {wide}");
}

#[test]
fn renderers_refuse_labels_through_a_lens() {
    let (scene, pose) = scene();
    let lens = lens_of(LensModel::Equidistant {}, 60.0, 95.0);
    let mut view = view(&lens, OpticsSpec::default());
    let mut bytes = vec![0; view.payload_bytes(Modality::Depth)];
    let job = ViewJob {
        view: &mut view,
        world_from_sensor: pose,
        outputs: vec![sensor_camera::Output {
            modality: Modality::Depth,
            place: sensor_camera::Place::Memory(&mut bytes),
        }],
    };
    let mut renderer = CameraRenderer::new(&common::gpu(), Quality::Low);
    let error = renderer.render(&scene, vec![job]).unwrap_err();
    let modality = Modality::Depth;
    assert_eq!(error, RenderError::NotThroughLens { modality });
    assert_eq!(
        error.to_string(),
        "a camera with a calibrated lens was asked for \"depth\"; only \"rgb\" is rendered through one"
    );
}
