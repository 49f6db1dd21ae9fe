//! What a view sees: culling, levels of detail, what walls hide, front-to-back order, and the
//! matrices of visible instances.

use nalgebra::Isometry3;
use schema_types::ActorId;
use sensor_core::{MeshId, Scene, stream};
use sensor_spec::Intrinsics;

use crate::assets::{MeshDraw, Meshes, Sphere, matrix_rows};
use crate::camera_motion::{CameraMotion, Firing, NEAR_M, rows};
use crate::contact::Blockers;
use crate::occlusion::Blocks;
use crate::uniform::InstanceData;

/// One draw call: a mesh range, and the index of its instance in the view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrawCall {
    pub mesh: MeshDraw,
    pub instance_idx: u32,
    distance_m: f64,
}

/// A view's lens, its firing before, and the actors that it does not show.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'v> {
    pub lens: Intrinsics,
    pub previous: Option<&'v Firing>,
    pub hidden: &'v [ActorId],
}

/// What a view draws.
#[derive(Clone, Debug, Default)]
pub(crate) struct Drawn {
    /// In runs of up to [`RUN_TRIANGLES`], nearest first. Each run has meshes without walls first,
    /// then those with walls, each kind nearest first.
    pub calls: Vec<DrawCall>,
    /// Where each run begins.
    pub runs: Vec<usize>,
    pub instances: Vec<InstanceData>,
    /// Index of the view's first instance in the list of all views.
    pub first_instance: u32,
    pub n_triangles: u32,
    /// What moves and darkens the ground that it stands on.
    pub blockers: Blockers,
    /// Static instances in view, nearest first: index, mesh, distance.
    candidates: Vec<(u32, MeshDraw, f64)>,
    /// How far one can see between walls.
    blocks: Blocks,
}

impl Drawn {
    fn clear(&mut self) {
        self.calls.clear();
        self.runs.clear();
        self.instances.clear();
        self.candidates.clear();
        (self.first_instance, self.n_triangles) = (0, 0);
    }

    fn add(&mut self, mesh: MeshDraw, distance_m: f64, data: InstanceData) {
        self.calls.push(DrawCall {
            mesh,
            instance_idx: self.instances.len() as u32,
            distance_m,
        });
        self.instances.push(data);
        self.n_triangles += mesh.n_indices / 3;
    }

    /// Sorts the calls. Changing the pipeline costs a software rasteriser as much as a dozen draw
    /// calls, so it is changed twice per run at most.
    fn sort(&mut self) {
        self.calls.sort_unstable_by(|a, b| {
            a.distance_m
                .total_cmp(&b.distance_m)
                .then(a.instance_idx.cmp(&b.instance_idx))
        });
        let mut n_triangles = 0;
        for (i, call) in self.calls.iter().enumerate() {
            n_triangles += call.mesh.n_indices / 3;
            if i == 0 || n_triangles > RUN_TRIANGLES {
                self.runs.push(i);
                n_triangles = call.mesh.n_indices / 3;
            }
        }
        let ends = self.runs.iter().skip(1).copied().chain([self.calls.len()]);
        for (begin, end) in self.runs.iter().copied().zip(ends) {
            self.calls[begin..end].sort_by_key(|call| call.mesh.has_walls);
        }
    }
}

/// Walls of scenery beyond this hide little, metres.
const MAX_OCCLUDER_M: f64 = 150.0;
/// Walls that are drawn as occluders in one view; no more of a scenery's are, once so many were.
const MAX_OCCLUDERS: usize = 400;

/// Triangles of a run.
const RUN_TRIANGLES: u32 = 3000;

/// The four side planes of a pinhole camera. `sideways` is the unit normal (x, z) of the left
/// plane, pointing inwards; the right plane has the opposite x. `upright` is (y, z) of the upper
/// plane in the same way.
struct Frustum {
    sideways: [f64; 2],
    upright: [f64; 2],
}

impl Frustum {
    fn new(lens: &Intrinsics) -> Self {
        let unit = |n_px: u32| {
            let slope = 0.5 * n_px as f64 / lens.focal_px;
            let length = slope.hypot(1.0);
            [1.0 / length, slope / length]
        };
        Frustum {
            sideways: unit(lens.width_px),
            upright: unit(lens.height_px),
        }
    }

    /// Free of branches, so that the compiler tests several spheres at once.
    fn sees(&self, [x, y, z]: [f64; 3], radius_m: f64) -> bool {
        let (aside, above) = (self.sideways[0] * x.abs(), self.upright[0] * y.abs());
        (z > NEAR_M - radius_m)
            & (self.sideways[1] * z - aside > -radius_m)
            & (self.upright[1] * z - above > -radius_m)
    }
}

/// Spheres that are tested at once.
const N_AT_ONCE: usize = 8;

/// Indices of the spheres that the camera sees.
fn seen_spheres(
    spheres_m: &[Vec<f64>; 4],
    frustum: &Frustum,
    camera_from_world: &[[f64; 4]; 3],
) -> Vec<u32> {
    let [x, y, z, radius] = spheres_m.each_ref().map(Vec::as_slice);
    let mut seen = Vec::with_capacity(x.len() / 4);
    let at = |i: usize| frustum.sees(apply(camera_from_world, [x[i], y[i], z[i]]), radius[i]);
    let n_blocks = x.len() / N_AT_ONCE;
    for first in (0..n_blocks).map(|block| block * N_AT_ONCE) {
        let block = first..first + N_AT_ONCE;
        let [x, y, z, radius] = [x, y, z, radius].map(|numbers| &numbers[block.clone()]);
        let found: [bool; N_AT_ONCE] = std::array::from_fn(|i| {
            frustum.sees(apply(camera_from_world, [x[i], y[i], z[i]]), radius[i])
        });
        seen.extend(
            (0..N_AT_ONCE)
                .filter(|i| found[*i])
                .map(|i| (first + i) as u32),
        );
    }
    seen.extend(
        (n_blocks * N_AT_ONCE..x.len())
            .filter(|i| at(*i))
            .map(|i| i as u32),
    );
    seen
}

fn apply(rows: &[[f64; 4]; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3])
}

/// Product of two transforms: first `b`, then `a`.
fn in_sequence(a: &[[f64; 4]; 3], b: &[[f64; 4]; 3]) -> [[f64; 4]; 3] {
    a.map(|row| {
        let mut out = [0.0, 0.0, 0.0, row[3]];
        for (factor, row) in row.iter().zip(b) {
            out.iter_mut()
                .zip(row)
                .for_each(|(sum, x)| *sum += factor * x);
        }
        out
    })
}

/// The same as the GPU gets it.
fn product(a: &[[f64; 4]; 3], b: &[[f64; 4]; 3]) -> [[f32; 4]; 3] {
    in_sequence(a, b).map(|row| row.map(|x| x as f32))
}

/// Corners of a mesh's box in the camera's axes, metres.
fn box_in_camera([low, high]: [[f32; 3]; 2], camera_from_mesh: &[[f32; 4]; 3]) -> [[f64; 3]; 8] {
    let rows = camera_from_mesh.map(|row| row.map(f64::from));
    std::array::from_fn(|i| {
        let corner = |axis: usize| f64::from(if (i >> axis) & 1 == 0 { low } else { high }[axis]);
        apply(&rows, [corner(0), corner(1), corner(2)])
    })
}

/// Finds the visible instances of `scene`; `drawn` is reused to avoid allocations. With `by_walls`,
/// what walls hide is left out, which changes no image.
pub(crate) fn visible(
    scene: &Scene,
    assets: &Meshes,
    seen: Seen<'_>,
    motion: &CameraMotion,
    by_walls: bool,
    drawn: &mut Drawn,
) {
    let Seen {
        ref lens,
        previous,
        hidden,
    } = seen;
    drawn.clear();
    let frustum = Frustum::new(lens);
    let camera_from_world = matrix_rows(&motion.camera_from_world);
    let distance_m = |centre_m: [f64; 3], radius_m: f64| {
        let [x, y, z] = apply(&camera_from_world, centre_m);
        ((x * x + y * y + z * z).sqrt() - radius_m).max(0.0)
    };
    let static_previous = rows(&(motion.previous_camera_from_world * motion.world_from_camera));
    let mut blocks = std::mem::take(&mut drawn.blocks);
    let mut candidates = std::mem::take(&mut drawn.candidates);
    for i in seen_spheres(&assets.still.spheres_m, &frustum, &camera_from_world) {
        let (instance, sphere) = (
            &assets.scene_assets.statics[i as usize],
            &assets.spheres[i as usize],
        );
        let distance_m = distance_m(sphere.centre_m.coords.into(), sphere.radius_m);
        let Some(mesh) = assets.level(instance.mesh, distance_m) else {
            continue;
        };
        if assets.scene_assets.streamed && is_of_far_tile(sphere, &motion.world_from_camera) {
            continue;
        }
        candidates.push((i, mesh, distance_m));
    }
    if by_walls {
        blocks.clear(lens);
        candidates.sort_unstable_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)));
        draw_walls(assets, &camera_from_world, &candidates, &mut blocks);
    }
    let is_hidden = |mesh: MeshId, camera_from_mesh: &[[f32; 4]; 3]| {
        by_walls && blocks.hide(&box_in_camera(assets.box_m(mesh), camera_from_mesh))
    };
    for (i, mesh, distance_m) in &candidates {
        let (i, mesh, distance_m) = (*i, *mesh, *distance_m);
        let instance = &assets.scene_assets.statics[i as usize];
        let camera_from_mesh = product(
            &camera_from_world,
            &assets.still.world_from_mesh[i as usize],
        );
        if is_hidden(instance.mesh, &camera_from_mesh) {
            continue;
        }
        let data = InstanceData {
            camera_from_mesh,
            previous_from_camera: static_previous,
            world_from_mesh_xyzw: quaternion(&instance.world_from_mesh),
            object_id: instance.object.0,
            tint: [0; 4],
            lamps: 0,
            moved: motion.moved() as u32,
        };
        drawn.add(mesh, distance_m, data);
    }
    for instance in &scene.dynamics {
        if hidden.binary_search(&instance.actor).is_ok() {
            continue;
        }
        let sphere = Sphere::of(
            assets.scene_assets.mesh(instance.mesh),
            &instance.world_from_mesh,
        );
        let centre_m = sphere.centre_m.coords.into();
        if !frustum.sees(apply(&camera_from_world, centre_m), sphere.radius_m) {
            continue;
        }
        let distance_m = distance_m(centre_m, sphere.radius_m);
        let Some(mesh) = assets.level(instance.mesh, distance_m) else {
            continue;
        };
        let camera_from_mesh = product(&camera_from_world, &matrix_rows(&instance.world_from_mesh));
        if is_hidden(instance.mesh, &camera_from_mesh) {
            continue;
        }
        let before = previous
            .and_then(|firing| firing.poses.get(instance.key()))
            .copied()
            .unwrap_or(instance.world_from_mesh);
        let moved = motion.moved() || before != instance.world_from_mesh;
        let mesh_from_camera = instance.world_from_mesh.inverse() * motion.world_from_camera;
        let [r, g, b] = instance.tint_rgb;
        let data = InstanceData {
            camera_from_mesh,
            previous_from_camera: rows(
                &(motion.previous_camera_from_world * before * mesh_from_camera),
            ),
            world_from_mesh_xyzw: quaternion(&instance.world_from_mesh),
            object_id: instance.actor.0,
            tint: [r, g, b, 255],
            lamps: instance.lamps,
            moved: moved as u32,
        };
        drawn.add(mesh, distance_m, data);
    }
    (drawn.blocks, drawn.candidates) = (blocks, candidates);
    let still = drawn.candidates.iter().map(|candidate| candidate.0);
    drawn
        .blockers
        .find(scene, assets, hidden, still, motion, |centre, radius_m| {
            let centre = apply(&camera_from_world, centre.coords.into());
            frustum.sees(centre, radius_m)
        });
    drawn.sort();
}

/// Draws the walls of static instances, which come nearest first, into blocks.
fn draw_walls(
    assets: &Meshes,
    camera_from_world: &[[f64; 4]; 3],
    candidates: &[(u32, MeshDraw, f64)],
    blocks: &mut Blocks,
) {
    let mut rest = MAX_OCCLUDERS;
    for (i, _, distance_m) in candidates {
        if rest == 0 || *distance_m > MAX_OCCLUDER_M {
            break;
        }
        let mesh = assets.scene_assets.statics[*i as usize].mesh;
        let occluders = assets.occluders(mesh, *distance_m);
        if occluders.is_empty() {
            continue;
        }
        let world_from_mesh = &assets.still.world_from_mesh[*i as usize];
        let camera_from_mesh = in_sequence(camera_from_world, world_from_mesh);
        for occluder in occluders {
            rest = rest.saturating_sub(blocks.draw(occluder, &camera_from_mesh) as usize);
        }
    }
}

/// Whether scenery belongs to a tile that this camera does not see, though another sensor may have
/// brought it here: what a camera sees follows from its own place.
fn is_of_far_tile(sphere: &Sphere, world_from_camera: &Isometry3<f64>) -> bool {
    let (centre, at) = (sphere.centre_m, world_from_camera.translation.vector);
    sphere.radius_m <= stream::WIDE_M
        && !stream::is_near(
            stream::tile_at(centre.x, centre.y),
            at.x,
            at.y,
            stream::VIEW_REACH_M,
        )
}

fn quaternion(transform: &Isometry3<f64>) -> [f32; 4] {
    let q = transform.rotation.quaternion();
    [q.i as f32, q.j as f32, q.k as f32, q.w as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: projected points of a sphere. A sphere with a point in the image is seen, and one
    /// that lies outside by its radius is not.
    #[test]
    fn spheres_are_seen_if_they_reach_into_the_image() {
        let lens = Intrinsics::from_fov(320, 200, 1.3);
        let [fx, fy, cx, cy] = lens.as_array();
        let mut rng = fastrand::Rng::with_seed(1);
        let mut spheres: [Vec<f64>; 4] = Default::default();
        for _ in 0..2003 {
            let place = [
                rng.f64() * 80.0 - 40.0,
                rng.f64() * 80.0 - 40.0,
                rng.f64() * 90.0 - 30.0,
                rng.f64() * 6.0 + 0.1,
            ];
            spheres
                .iter_mut()
                .zip(place)
                .for_each(|(numbers, x)| numbers.push(x));
        }
        let pose = Isometry3::new([1.0, -2.0, 0.5].into(), [0.3, -0.8, 0.2].into());
        let seen = seen_spheres(&spheres, &Frustum::new(&lens), &matrix_rows(&pose));
        let mut n_inside = 0;
        for (i, x) in spheres[0].iter().enumerate() {
            let [y, z, radius_m] = [1, 2, 3].map(|k| spheres[k][i]);
            let centre = pose * nalgebra::Point3::new(*x, y, z);
            let reaches = (0..200).any(|k| {
                let (theta, phi) = (
                    (k as f64 * 0.618).fract() * std::f64::consts::TAU,
                    (1.0 - 2.0 * (k as f64 + 0.5) / 200.0).acos(),
                );
                let p = centre.coords
                    + radius_m
                        * nalgebra::Vector3::new(
                            phi.sin() * theta.cos(),
                            phi.sin() * theta.sin(),
                            phi.cos(),
                        );
                let [u, v] = [cx + fx * p.x / p.z, cy + fy * p.y / p.z];
                p.z > NEAR_M && (0.0..320.0).contains(&u) && (0.0..200.0).contains(&v)
            });
            n_inside += reaches as usize;
            assert!(
                !reaches || seen.binary_search(&(i as u32)).is_ok(),
                "sphere {i} reaches into the image"
            );
            let behind = centre.z + radius_m < 0.0;
            assert!(
                !behind || seen.binary_search(&(i as u32)).is_err(),
                "sphere {i} lies behind"
            );
        }
        assert!(
            n_inside > 200 && seen.len() < 2 * n_inside + 200,
            "{n_inside} of {} seen",
            seen.len()
        );
    }

    #[test]
    fn products_are_those_of_matrices() {
        let a = Isometry3::new([100.0, -2.0, 0.5].into(), [0.3, -0.8, 0.2].into());
        let b = Isometry3::new([-3.0, 7.0, 1e4].into(), [1.0, 0.1, -0.4].into());
        let (found, expected) = (product(&matrix_rows(&a), &matrix_rows(&b)), rows(&(a * b)));
        let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
        assert!(
            found
                .iter()
                .flatten()
                .zip(expected.iter().flatten())
                .all(near),
            "{found:?} instead of {expected:?}"
        );
    }
}
