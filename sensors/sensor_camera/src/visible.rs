//! What a view sees: culling, levels of detail, what walls hide, front-to-back order, and the
//! matrices of visible instances.

use nalgebra::Isometry3;
use schema_types::ActorId;
use sensor_core::{MeshId, Scene, stream};
use sensor_spec::Intrinsics;

use crate::assets::{Bounds, MeshDraw, Meshes, Reach, Sphere, bounds_of, matrix_rows, quaternion};
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

/// How static instances are given to whoever draws them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StillAs {
    /// As all others, with their matrices.
    Instances,
    /// By their numbers: a shader makes the matrices.
    Numbers,
}

/// A view's lens, its firing before, the actors that it does not show, and how it is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'v> {
    pub lens: Intrinsics,
    pub previous: Option<&'v Firing>,
    pub hidden: &'v [ActorId],
    pub still: StillAs,
    /// Whether what walls hide is left out, which changes no image.
    pub by_walls: bool,
}

/// What all views of a tick need of moving instances.
#[derive(Clone, Debug)]
pub(crate) struct Moving {
    spheres: Vec<Sphere>,
    bounds: Bounds,
    /// Numbers of those that stand on the ground.
    pub standing: Vec<u32>,
}

impl Moving {
    pub fn of(scene: &Scene, assets: &Meshes) -> Moving {
        let of_mesh = |mesh| assets.scene_assets.mesh(mesh);
        let moving = scene.dynamics.iter();
        let spheres: Vec<Sphere> = moving
            .map(|it| Sphere::of(of_mesh(it.mesh), &it.world_from_mesh))
            .collect();
        let numbered = (0..).zip(&scene.dynamics);
        Moving {
            bounds: bounds_of(&spheres),
            spheres,
            standing: numbered
                .filter(|(_, it)| assets.stands(it.mesh))
                .map(|(number, _)| number)
                .collect(),
        }
    }
}

/// What a view draws.
#[derive(Clone, Debug, Default)]
pub(crate) struct Drawn {
    /// In runs of up to [`RUN_TRIANGLES`], nearest first. Each run has meshes without walls first,
    /// then those with walls, each kind nearest first.
    pub calls: Vec<DrawCall>,
    /// Where each run begins.
    pub runs: Vec<usize>,
    /// Numbers of static instances, whose matrices a shader makes.
    pub still: Vec<u32>,
    /// All other instances; their indices in the view follow those of `still`.
    pub instances: Vec<InstanceData>,
    /// Index of the view's first entry of `instances` in the list of all views.
    pub first_instance: u32,
    /// The same of `still`, whose instances lie behind all others in that list.
    pub first_still: u32,
    pub n_triangles: u32,
    /// What moves and darkens the ground that it stands on.
    pub blockers: Blockers,
    /// Static instances in view: index, mesh, distance.
    candidates: Vec<(u32, MeshDraw, f64)>,
    /// How far one can see between walls.
    blocks: Blocks,
    /// Reused allocations.
    spare: Spare,
}

#[derive(Clone, Debug, Default)]
struct Spare {
    reaching: Vec<u32>,
    keys: Vec<u64>,
    calls: Vec<DrawCall>,
    walls: Vec<DrawCall>,
}

impl Drawn {
    fn clear(&mut self) {
        self.calls.clear();
        self.runs.clear();
        self.still.clear();
        self.instances.clear();
        self.candidates.clear();
        (self.first_instance, self.first_still, self.n_triangles) = (0, 0, 0);
    }

    fn add(&mut self, mesh: MeshDraw, distance_m: f64, data: InstanceData) {
        self.add_call(mesh, distance_m);
        self.instances.push(data);
    }

    /// Adds a static instance by its number, before all that are added with their matrices.
    fn add_still(&mut self, mesh: MeshDraw, distance_m: f64, number: u32) {
        self.add_call(mesh, distance_m);
        self.still.push(number);
    }

    fn add_call(&mut self, mesh: MeshDraw, distance_m: f64) {
        self.calls.push(DrawCall {
            mesh,
            instance_idx: (self.still.len() + self.instances.len()) as u32,
            distance_m,
        });
        self.n_triangles += mesh.n_indices / 3;
    }

    /// Where an instance of the view lies in the list of all views.
    pub fn instance(&self, call: &DrawCall) -> u32 {
        let n_still = self.still.len() as u32;
        match call.instance_idx.checked_sub(n_still) {
            Some(beyond) => self.first_instance + beyond,
            None => self.first_still + call.instance_idx,
        }
    }

    /// Sorts the calls. Changing the pipeline costs a software rasteriser as much as a dozen draw
    /// calls, so it is changed twice per run at most.
    fn sort(&mut self) {
        let Spare {
            keys, calls, walls, ..
        } = &mut self.spare;
        // The distance in single precision above the place, which is the instance's index, too.
        // Distances are not negative, so their bits are in their order.
        let key = |(place, call): (u64, &DrawCall)| {
            u64::from((call.distance_m as f32).to_bits()) << 32 | place
        };
        keys.clear();
        keys.extend((0..).zip(&self.calls).map(key));
        keys.sort_unstable();
        let call_of = |key: &u64| &self.calls[*key as u32 as usize];
        for alike in keys.chunk_by_mut(|a, b| a >> 32 == b >> 32) {
            if alike.len() > 1 {
                alike.sort_unstable_by(|a, b| {
                    let by_distance = call_of(a).distance_m.total_cmp(&call_of(b).distance_m);
                    by_distance.then(a.cmp(b))
                });
            }
        }
        calls.clear();
        let mut n_triangles = 0;
        for key in &*keys {
            let call = call_of(key);
            let n_own = call.mesh.n_indices / 3;
            n_triangles += n_own;
            if self.runs.is_empty() || n_triangles > RUN_TRIANGLES {
                calls.append(walls);
                self.runs.push(calls.len());
                n_triangles = n_own;
            }
            match call.mesh.has_walls {
                true => walls.push(*call),
                false => calls.push(*call),
            }
        }
        calls.append(walls);
        std::mem::swap(&mut self.calls, calls);
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

    fn sees(&self, [x, y, z]: [f64; 3], radius_m: f64) -> bool {
        let (aside, above) = (self.sideways[0] * x.abs(), self.upright[0] * y.abs());
        (z > NEAR_M - radius_m)
            & (self.sideways[1] * z - aside > -radius_m)
            & (self.upright[1] * z - above > -radius_m)
    }

    /// The same for a search in single precision.
    fn reach(&self) -> Reach {
        Reach {
            sideways: self.sideways,
            upright: self.upright,
            near_m: NEAR_M,
        }
    }
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

/// Finds the visible instances of `scene`, whose moving ones are `moving`; `drawn` is reused to avoid
/// allocations.
pub(crate) fn visible(
    scene: &Scene,
    assets: &Meshes,
    moving: &Moving,
    seen: Seen<'_>,
    motion: &CameraMotion,
    drawn: &mut Drawn,
) {
    let Seen {
        ref lens,
        previous,
        hidden,
        still,
        by_walls,
    } = seen;
    drawn.clear();
    let frustum = Frustum::new(lens);
    let camera_from_world = matrix_rows(&motion.camera_from_world);
    // The distance of a sphere that is seen.
    let distance_m = |Sphere { centre_m, radius_m }: &Sphere| {
        let at @ [x, y, z] = apply(&camera_from_world, centre_m.coords.into());
        let is_seen = frustum.sees(at, *radius_m);
        is_seen.then(|| ((x * x + y * y + z * z).sqrt() - radius_m).max(0.0))
    };
    let mut reaching = std::mem::take(&mut drawn.spare.reaching);
    let mut blocks = std::mem::take(&mut drawn.blocks);
    let mut candidates = std::mem::take(&mut drawn.candidates);
    reaching.clear();
    let in_still = &assets.still.bounds;
    in_still.reaching(&frustum.reach(), &camera_from_world, &mut reaching);
    for i in &reaching {
        let sphere = &assets.spheres[*i as usize];
        let Some(distance_m) = distance_m(sphere) else {
            continue;
        };
        let Some(mesh) = assets.level(assets.still.meshes[*i as usize], distance_m) else {
            continue;
        };
        if assets.scene_assets.streamed && is_of_far_tile(sphere, &motion.world_from_camera) {
            continue;
        }
        candidates.push((*i, mesh, distance_m));
    }
    if by_walls {
        blocks.clear(lens);
        candidates.sort_unstable_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)));
        draw_walls(assets, &camera_from_world, &candidates, &mut blocks);
    }
    let is_hidden = |mesh: MeshId, camera_from_mesh: &[[f32; 4]; 3]| {
        by_walls && blocks.hide(&box_in_camera(assets.box_m(mesh), camera_from_mesh))
    };
    let static_previous = static_previous(motion);
    for (i, mesh, distance_m) in &candidates {
        let (i, mesh, distance_m) = (*i, *mesh, *distance_m);
        let instance = &assets.scene_assets.statics[i as usize];
        let camera_from_mesh = (by_walls || still == StillAs::Instances).then(|| {
            let world_from_mesh = &assets.still.world_from_mesh[i as usize];
            product(&camera_from_world, world_from_mesh)
        });
        if camera_from_mesh.is_some_and(|rows| is_hidden(instance.mesh, &rows)) {
            continue;
        }
        match camera_from_mesh {
            Some(camera_from_mesh) if still == StillAs::Instances => {
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
            _ => drawn.add_still(mesh, distance_m, i),
        }
    }
    reaching.clear();
    let in_moving = &moving.bounds;
    in_moving.reaching(&frustum.reach(), &camera_from_world, &mut reaching);
    for i in &reaching {
        let (instance, sphere) = (&scene.dynamics[*i as usize], &moving.spheres[*i as usize]);
        if hidden.binary_search(&instance.actor).is_ok() {
            continue;
        }
        let Some(distance_m) = distance_m(sphere) else {
            continue;
        };
        let Some(mesh) = assets.level(instance.mesh, distance_m) else {
            continue;
        };
        let camera_from_mesh = product(&camera_from_world, &matrix_rows(&instance.world_from_mesh));
        if is_hidden(instance.mesh, &camera_from_mesh) {
            continue;
        }
        let before = previous
            .and_then(|firing| firing.poses.get_near(*i as usize, instance.key()))
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
    drawn.spare.reaching = reaching;
    let still = drawn.candidates.iter().map(|candidate| candidate.0);
    drawn.blockers.find(
        scene,
        assets,
        (hidden, &moving.standing),
        still,
        motion,
        |centre, radius_m| {
            let centre = apply(&camera_from_world, centre.coords.into());
            frustum.sees(centre, radius_m)
        },
    );
    drawn.sort();
}

/// Camera space now to camera space at the previous firing, for what stands still.
pub(crate) fn static_previous(motion: &CameraMotion) -> [[f32; 4]; 3] {
    rows(&(motion.previous_camera_from_world * motion.world_from_camera))
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

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Oracle: projected points of a sphere. A sphere with a point in the image is seen, and one
    /// that lies outside by its radius is not.
    #[test]
    fn spheres_are_seen_if_they_reach_into_the_image() {
        let lens = Intrinsics::from_fov(320, 200, 1.3);
        let [fx, fy, cx, cy] = lens.as_array();
        let mut rng = fastrand::Rng::with_seed(1);
        let spheres: Vec<Sphere> = (0..2003)
            .map(|_| Sphere {
                centre_m: Point3::new(
                    rng.f64() * 80.0 - 40.0,
                    rng.f64() * 80.0 - 40.0,
                    rng.f64() * 90.0 - 30.0,
                ),
                radius_m: rng.f64() * 6.0 + 0.1,
            })
            .collect();
        let pose = Isometry3::new([1.0, -2.0, 0.5].into(), [0.3, -0.8, 0.2].into());
        let (frustum, rows) = (Frustum::new(&lens), matrix_rows(&pose));
        let mut seen = Vec::new();
        bounds_of(&spheres).reaching(&frustum.reach(), &rows, &mut seen);
        let exactly = |i: &u32| {
            let Sphere { centre_m, radius_m } = spheres[*i as usize];
            frustum.sees(apply(&rows, centre_m.coords.into()), radius_m)
        };
        let all: Vec<u32> = (0..2003).filter(exactly).collect();
        let n_reaching = seen.len();
        seen.retain(exactly);
        assert_eq!(seen, all, "none is lost in single precision");
        assert!(n_reaching < all.len() + 5, "{n_reaching} for {}", all.len());
        let mut n_inside = 0;
        for (i, Sphere { centre_m, radius_m }) in spheres.iter().enumerate() {
            let centre = pose * centre_m;
            let reaches = (0..200).any(|k| {
                let (theta, phi) = (
                    (k as f64 * 0.618).fract() * std::f64::consts::TAU,
                    (1.0 - 2.0 * (k as f64 + 0.5) / 200.0).acos(),
                );
                let p = centre.coords
                    + *radius_m
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

    /// Oracle: a plain sort by distance and index, runs that end when they are full, and a stable sort
    /// of each. Many distances differ in double precision alone, and many are equal.
    #[test]
    fn calls_are_sorted_by_distance_then_index_and_walls_come_last_in_each_run() {
        let mut rng = fastrand::Rng::with_seed(3);
        let mut drawn = Drawn::default();
        let data: InstanceData = bytemuck::Zeroable::zeroed();
        for i in 0..900u32 {
            let mesh = MeshDraw {
                first_idx: i,
                n_indices: 3 * rng.u32(1..200),
                base_vertex: 0,
                has_walls: rng.bool(),
            };
            let distance_m = f64::from(rng.u32(0..60)) + f64::from(rng.u32(0..3)) * 1e-9;
            match i < 600 {
                true => drawn.add_still(mesh, distance_m, i),
                false => drawn.add(mesh, distance_m, data),
            }
        }
        let mut expected = drawn.calls.clone();
        expected.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        let (mut begins, mut n_triangles) = (Vec::new(), 0);
        for (i, call) in expected.iter().enumerate() {
            n_triangles += call.mesh.n_indices / 3;
            if i == 0 || n_triangles > RUN_TRIANGLES {
                begins.push(i);
                n_triangles = call.mesh.n_indices / 3;
            }
        }
        for (k, begin) in begins.iter().enumerate() {
            let end = begins.get(k + 1).copied().unwrap_or(expected.len());
            expected[*begin..end].sort_by_key(|call| call.mesh.has_walls);
        }
        drawn.sort();
        let indices = |calls: &[DrawCall]| -> Vec<u32> {
            calls.iter().map(|call| call.instance_idx).collect()
        };
        assert_eq!(indices(&drawn.calls), indices(&expected));
        assert_eq!(drawn.runs, begins);
        assert!(begins.len() > 10, "{}", begins.len());
        // Those by number lie behind all others in the list of all views.
        (drawn.first_instance, drawn.first_still) = (70, 5000);
        let places: Vec<u32> = drawn
            .calls
            .iter()
            .map(|call| drawn.instance(call))
            .collect();
        for (call, place) in drawn.calls.iter().zip(places) {
            let expected = match call.instance_idx {
                i if i < 600 => 5000 + i,
                i => 70 + i - 600,
            };
            assert_eq!(place, expected);
        }
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
