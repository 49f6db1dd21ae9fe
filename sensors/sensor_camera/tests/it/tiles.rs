//! The rasteriser in tiles: what it shows is what geometry says and what the adapter's rasteriser
//! shows, without gaps, whatever the geometry is, and with the same bits in vectors and arrays.

use nalgebra::{Isometry3, Matrix3, Matrix4, Vector3};
use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{
    CameraRenderer, InstanceData, Quality, RasterDraw, RasterView, Rasteriser, TILE_PX, Tile,
    TileInput, TileLists,
};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets, Vertex};

use crate::common;

/// Not a multiple of the tile's side or of eight, so that the last tiles stick out.
const SIZE_PX: [u32; 2] = [205, 147];
const FOCAL_PX: f32 = 102.5;

fn view() -> RasterView {
    RasterView {
        lens_px: [
            FOCAL_PX,
            FOCAL_PX,
            0.5 * SIZE_PX[0] as f32,
            0.5 * SIZE_PX[1] as f32,
        ],
        size_px: SIZE_PX,
        first_pixel: 0,
        near_m: 0.1,
    }
}

/// What a view's pixels show: bits of 1 / depth, and the triangle.
fn image(vertices: &[Vertex], instances: &[InstanceData], draws: &[RasterDraw]) -> Vec<[u32; 2]> {
    let n_corners = draws.iter().map(|d| d.first_idx + 3 * d.n_triangles).max();
    let indices: Vec<u32> = (0..n_corners.unwrap_or(0)).collect();
    let mut lists = TileLists::default();
    lists.sort(
        &view(),
        &TileInput {
            vertices,
            indices: &indices,
            instances,
            draws,
        },
    );
    let [across, down] = lists.n_tiles();
    let [width, height] = SIZE_PX.map(|size| size as usize);
    let mut out = vec![[0; 2]; width * height];
    let (mut tile, mut in_arrays) = (Tile::default(), Tile::default());
    for number in 0..across * down {
        lists.fill(number, &mut tile);
        lists.fill_in_arrays(number, &mut in_arrays);
        let [left, top] = [number % across * TILE_PX, number / across * TILE_PX];
        for y in top..height.min(top + TILE_PX) {
            for x in left..width.min(left + TILE_PX) {
                let shown = |tile: &Tile| {
                    let inverse = tile.inverse_depth[y - top][x - left];
                    [inverse.to_bits(), tile.number[y - top][x - left]]
                };
                assert_eq!(
                    shown(&tile),
                    shown(&in_arrays),
                    "vectors and arrays at {x}, {y}"
                );
                out[y * width + x] = shown(&tile);
            }
        }
    }
    out
}

fn corner(position_m: [f32; 3]) -> Vertex {
    Vertex {
        position_m,
        ..bytemuck::Zeroable::zeroed()
    }
}

fn unmoved() -> InstanceData {
    InstanceData {
        camera_from_mesh: [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ],
        ..bytemuck::Zeroable::zeroed()
    }
}

/// One draw call of triangles that are given in the camera's space.
fn seen(triangles: &[[[f32; 3]; 3]]) -> Vec<[u32; 2]> {
    let vertices: Vec<Vertex> = triangles.iter().flatten().map(|p| corner(*p)).collect();
    let draw = RasterDraw {
        first_triangle: 0,
        n_triangles: triangles.len() as u32,
        first_idx: 0,
        base_vertex: 0,
        instance: 0,
        view: 0,
        first_chunk: 0,
        rest: 0,
    };
    image(&vertices, &[unmoved()], &[draw])
}

/// The depth at which a ray through a pixel's centre, moved by so many pixels, meets a triangle that
/// faces the eye.
fn met(triangle: &[[f32; 3]; 3], x: usize, y: usize, by: [f64; 2]) -> Option<f64> {
    let view = view();
    let [a, b, c] = triangle.map(|p| Vector3::from(p.map(f64::from)));
    let ray = Vector3::new(
        (x as f64 + 0.5 + by[0] - view.lens_px[2] as f64) / view.lens_px[0] as f64,
        (y as f64 + 0.5 + by[1] - view.lens_px[3] as f64) / view.lens_px[1] as f64,
        1.0,
    );
    let inverse = Matrix3::from_columns(&[a, b, c]).try_inverse()?;
    let faces_the_eye = (b - a).cross(&(c - a)).dot(&a) < 0.0;
    let shares = inverse * ray;
    let depth = 1.0 / shares.sum();
    (faces_the_eye && shares.min() >= 0.0 && depth >= view.near_m as f64).then_some(depth)
}

/// Depths at a pixel for its centre and for places around it, beyond what rounding of corners moves.
fn depths(triangles: &[[[f32; 3]; 3]], x: usize, y: usize) -> Vec<Option<(usize, f64)>> {
    let reach = 1.0 / 128.0;
    let places = [
        [0.0; 2],
        [reach, reach],
        [-reach, reach],
        [reach, -reach],
        [-reach, -reach],
    ];
    let nearest = |by| {
        let all = triangles.iter().enumerate();
        let met = all.filter_map(|(i, triangle)| Some((i, met(triangle, x, y, by)?)));
        met.min_by(|a, b| a.1.total_cmp(&b.1))
    };
    places.map(nearest).to_vec()
}

fn random_triangle(rng: &mut fastrand::Rng, reach_m: f32) -> [[f32; 3]; 3] {
    std::array::from_fn(|_| {
        let z = rng.f32() * 12.0 - 1.0;
        [(rng.f32() - 0.5) * reach_m, (rng.f32() - 0.5) * reach_m, z]
    })
}

/// Oracle: rays in f64.
#[test]
fn tiles_show_what_rays_meet() {
    let mut rng = fastrand::Rng::with_seed(1);
    let (mut n_compared, mut n_sky) = (0, 0);
    for reach_m in [2.0, 8.0, 40.0, 5000.0] {
        let triangles: Vec<_> = (0..60)
            .map(|_| random_triangle(&mut rng, reach_m))
            .collect();
        let found = seen(&triangles);
        for (i, [inverse, number]) in found.iter().enumerate() {
            let [x, y] = [i % SIZE_PX[0] as usize, i / SIZE_PX[0] as usize];
            let around = depths(&triangles, x, y);
            let which = around[0].map(|(number, _)| number);
            // At edges rounding may decide; near each other, depth.
            if around
                .iter()
                .any(|other| other.map(|(number, _)| number) != which)
            {
                continue;
            }
            n_compared += 1;
            let Some((expected, depth)) = around[0] else {
                assert_eq!(*inverse, 0, "{x}, {y}: sky");
                n_sky += 1;
                continue;
            };
            let shown = 1.0 / f32::from_bits(*inverse) as f64;
            let steepest = around.iter().flatten().map(|(_, at)| (at - depth).abs());
            let slack = 1e-4 * depth + steepest.fold(0.0, f64::max);
            assert!(
                (shown - depth).abs() <= slack,
                "{x}, {y}: {shown} m for {depth} m"
            );
            if *number as usize != expected {
                let other = met(&triangles[*number as usize], x, y, [0.0; 2]);
                let other = other.expect("the ray meets the triangle that is shown");
                assert!(
                    (other - depth).abs() <= slack,
                    "{x}, {y}: {number} for {expected}"
                );
            }
        }
    }
    assert!(
        n_compared > 60_000 && n_sky > 1000,
        "{n_compared} pixels, {n_sky} of sky"
    );
}

/// Oracle: a mesh of triangles with common edges covers each pixel once, whichever way the corners
/// lie; drawn twice with other numbers, the greater ones are seen.
#[test]
fn common_edges_leave_no_gap_and_greater_numbers_win() {
    let mut rng = fastrand::Rng::with_seed(2);
    for depth_m in [1.0, 3.0] {
        const N: usize = 14;
        let corners: Vec<[f32; 3]> = (0..(N + 1) * (N + 1))
            .map(|i| {
                let at = [i % (N + 1), i / (N + 1)];
                let is_rim = at.iter().any(|k| *k == 0 || *k == N);
                let mut place = |k: usize| {
                    let by = if is_rim { 0.0 } else { rng.f32() * 0.6 - 0.3 };
                    ((k as f32 + by) / N as f32 - 0.5) * 2.6 * depth_m
                };
                [place(at[0]), place(at[1]), depth_m]
            })
            .collect();
        let mut triangles = Vec::new();
        for y in 0..N {
            for x in 0..N {
                let at = |dx: usize, dy: usize| corners[(y + dy) * (N + 1) + x + dx];
                triangles.push([at(0, 0), at(0, 1), at(1, 0)]);
                triangles.push([at(1, 0), at(0, 1), at(1, 1)]);
            }
        }
        let once = seen(&triangles);
        assert!(
            once.iter().all(|[inverse, _]| *inverse != 0),
            "there is a gap"
        );
        let twice = seen(&[triangles.clone(), triangles.clone()].concat());
        let n = triangles.len() as u32;
        for ([_, first], [_, second]) in once.iter().zip(&twice) {
            assert_eq!(first + n, *second);
        }
        // The backs are not seen.
        let backs: Vec<_> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        assert!(seen(&backs).iter().all(|[inverse, _]| *inverse == 0));
    }
}

/// Oracle: counting. Corners and edges lie on centres of pixels, where only the rule for edges decides.
#[test]
fn pixels_on_common_edges_belong_to_one_triangle() {
    let view = view();
    let at = |x_px: f32, y_px: f32| -> [f32; 3] {
        let place = |px: f32, axis: usize| (px - view.lens_px[axis + 2]) / view.lens_px[axis] * 2.0;
        [place(x_px, 0), place(y_px, 1), 2.0]
    };
    let mut triangles = Vec::new();
    for row in 0..4 {
        for column in 0..6 {
            let (x, y) = (10.5 + 30.0 * column as f32, 12.5 + 30.0 * row as f32);
            let [a, b, c, d] = [
                at(x, y),
                at(x, y + 30.0),
                at(x + 30.0, y + 30.0),
                at(x + 30.0, y),
            ];
            let halves = if (row + column) % 2 == 0 {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            };
            triangles.extend(halves);
        }
    }
    let mut n_covers = vec![0; (SIZE_PX[0] * SIZE_PX[1]) as usize];
    for triangle in &triangles {
        let shown = seen(std::slice::from_ref(triangle));
        for (n, [inverse, _]) in n_covers.iter_mut().zip(shown) {
            *n += usize::from(inverse != 0);
        }
    }
    for (i, n) in n_covers.iter().enumerate() {
        let (x, y) = (i as u32 % SIZE_PX[0], i as u32 / SIZE_PX[0]);
        let is_inside = (11..190).contains(&x) && (13..132).contains(&y);
        let is_rim = [10, 190].contains(&x) || [12, 132].contains(&y);
        assert!(*n <= 1, "{n} triangles cover {x}, {y}");
        assert!(*n == 1 || !is_inside, "nothing covers {x}, {y}");
        assert!(*n == 0 || is_inside || is_rim, "{x}, {y} is covered");
    }
}

#[test]
fn any_numbers_are_survived() {
    let mut rng = fastrand::Rng::with_seed(3);
    let special = [
        0.0,
        -0.0,
        0.1,
        1e-40,
        1e-20,
        1e20,
        3e38,
        f32::MAX,
        f32::INFINITY,
        f32::NAN,
        524_288.0,
        -1e9,
    ];
    for _ in 0..300 {
        let triangles: Vec<[[f32; 3]; 3]> = (0..20)
            .map(|_| {
                std::array::from_fn(|_| {
                    std::array::from_fn(|_| match rng.u8(0..3) {
                        0 => special[rng.usize(0..special.len())],
                        1 => f32::from_bits(rng.u32(..)),
                        _ => rng.f32() * 10.0,
                    })
                })
            })
            .collect();
        for [inverse, number] in seen(&triangles) {
            let inverse = f32::from_bits(inverse);
            assert!((0.0..=10.0).contains(&inverse), "1 / depth is {inverse}");
            assert!((number as usize) < triangles.len());
        }
    }
}

/// Boxes of random sizes and places, each an object of its own.
fn boxes(rng: &mut fastrand::Rng) -> SceneAssets {
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    for _ in 0..40 {
        let mut builder = MeshBuilder::new("box");
        let surface = Surface::new(Class::BUILDINGS, Material::Matte, [128; 3]);
        let half: [f32; 3] = std::array::from_fn(|_| 0.2 + 2.0 * rng.f32());
        let at = |i: usize| -> [f32; 3] {
            std::array::from_fn(|axis| {
                if i >> axis & 1 == 0 {
                    -half[axis]
                } else {
                    half[axis]
                }
            })
        };
        for side in [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ] {
            builder.polygon_with_normals(
                surface,
                &side.map(at),
                &[[0.0, 0.0, 1.0]; 4],
                &[[0.0; 2]; 4],
            );
        }
        let mesh = assets.add_mesh(builder.finish());
        let place: [f64; 3] = std::array::from_fn(|_| rng.f64() * 24.0 - 12.0);
        let turn = [0; 3].map(|_| rng.f64() * 360.0);
        let pose = common::pose(place[0], place[1], place[2], turn);
        assets.statics.push(common::fixed(mesh, pose));
    }
    assets
}

/// Oracle: the computed rasteriser on the adapter.
#[test]
fn tiles_show_what_the_adapter_shows() {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::with_rasteriser(&gpu, Quality::Low, Rasteriser::Computed);
    let mut rng = fastrand::Rng::with_seed(5);
    for step in 1..5u32 {
        let assets = std::sync::Arc::new(SceneAssets {
            episode: step,
            ..boxes(&mut rng)
        });
        let turn = [0; 3].map(|_| rng.f64() * 360.0);
        let world_from_sensor = common::pose(0.3, -0.2, 0.1, turn);
        let mut view = common::view(&gpu, SIZE_PX[0], SIZE_PX[1]);
        let scene = common::scene(&assets, vec![], step as u64 * 50_000_000);
        let modalities = [Modality::Depth, Modality::Instance];
        let frames = common::render(
            &mut renderer,
            &scene,
            &mut view,
            world_from_sensor,
            &modalities,
        );
        let depths = common::floats(&frames[&Modality::Depth].0);
        let objects: Vec<u32> = bytemuck::pod_collect_to_vec(&frames[&Modality::Instance].0);

        let (mut vertices, mut instances, mut draws) = (Vec::new(), Vec::new(), Vec::new());
        let mut object_of = Vec::new();
        for instance in &assets.statics {
            let first_idx = vertices.len() as u32;
            for (corners, _) in assets.mesh(instance.mesh).triangles() {
                vertices.extend(corners.map(corner));
                object_of.push(instance.object.0);
            }
            draws.push(RasterDraw {
                first_triangle: first_idx / 3,
                n_triangles: (vertices.len() as u32 - first_idx) / 3,
                first_idx,
                base_vertex: 0,
                instance: instances.len() as u32,
                view: 0,
                first_chunk: 0,
                rest: 0,
            });
            let rows = camera_from(&(world_from_sensor.inverse() * instance.world_from_mesh));
            instances.push(InstanceData {
                camera_from_mesh: rows,
                ..unmoved()
            });
        }
        let found = image(&vertices, &instances, &draws);
        let mut n_different = 0;
        for (i, [inverse, number]) in found.iter().enumerate() {
            let inverse = f32::from_bits(*inverse);
            let is_same = if inverse == 0.0 {
                !depths[i].is_finite() && objects[i] == 0
            } else {
                let object = object_of[*number as usize];
                (1.0 / inverse - depths[i]).abs() <= 1e-5 * depths[i] && objects[i] == object
            };
            n_different += usize::from(!is_same);
        }
        // Matrices are rounded in another order, which may move an edge over a pixel's centre.
        assert!(
            n_different <= 3,
            "{n_different} of {} pixels differ",
            found.len()
        );
        let n_seen = found.iter().filter(|[inverse, _]| *inverse != 0).count();
        assert!(n_seen > 3000, "only {n_seen} pixels show anything");
    }
}

/// From the axes of bodies (x ahead, y left, z up) to those of images (z ahead, x right, y down).
fn camera_from(sensor_from_mesh: &Isometry3<f64>) -> [[f32; 4]; 3] {
    let m: Matrix4<f64> = sensor_from_mesh.to_homogeneous();
    let row = |axis: usize, sign: f64| -> [f32; 4] {
        std::array::from_fn(|column| (sign * m[(axis, column)]) as f32)
    };
    [row(1, -1.0), row(2, -1.0), row(0, 1.0)]
}
