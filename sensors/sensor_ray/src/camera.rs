//! Images of a camera with a lens, by a ray through the middle of each pixel: depth, classes, objects,
//! normals.
//!
//! Rays see the fronts of triangles alone, as cameras do, and nothing nearer than [`NEAR_M`]. Depth is
//! the distance along the ray, because beyond 90° there is none along the optical axis. The bytes
//! depend on scene, lens and pose alone, not on the number of threads.

use half::f16;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;
use schema_stages::Stage;
use schema_types::space::sensor_from_camera;
use schema_types::{ActorId, Class, Lens, ObjectId};
use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};

use crate::ray_scene::RayScene;
use crate::rays::{
    Bundle, Caster, GROUP, Hit, Hits, RAYS, Sides, Stacks, WorldRay, smooth_normal, surface,
};

/// Nothing is seen nearer than this, metres.
pub const NEAR_M: f64 = 0.1;
/// Nothing is seen farther away, metres.
const FAR_M: f64 = 1e6;
/// Pixels of a tile's side: its rays are one bundle.
const TILE_PX: usize = 8;
/// Pixels of a group of a bundle.
const GROUP_PX: [usize; 2] = [4, 2];
/// In a bundle: no pixel.
const NO_PIXEL: u32 = u32::MAX;

/// Casting the rays of images, on whatever threads it is done.
static RAYS_OF_IMAGES: Stage = Stage::new("image rays");

/// Where the images of one firing go; each that is asked for has the pixels of the camera, row by row
/// without gaps.
#[derive(Debug, Default)]
pub struct LabelImages<'a> {
    /// `f32` metres along the ray; +∞ where nothing was hit.
    pub depth: Option<&'a mut [u8]>,
    /// `u8` class; the sky's where nothing was hit, 0 beyond the lens's field.
    pub class: Option<&'a mut [u8]>,
    /// `u32` object; 0 where nothing was hit.
    pub instance: Option<&'a mut [u8]>,
    /// `f16` × 4: normal in the world and 0; four zeros where nothing was hit.
    pub normals: Option<&'a mut [u8]>,
}

/// A camera whose lens gives each pixel a direction.
#[derive(Debug)]
pub struct RayCamera {
    size_px: [usize; 2],
    /// Directions in sensor space of all pixels; `None` beyond the field.
    directions: Vec<Option<Vector3<f64>>>,
    /// Bundles of each row of tiles.
    rows: Vec<Vec<Bunch>>,
}

/// Rays of neighbouring pixels.
#[derive(Debug)]
struct Bunch {
    bundle: Bundle,
    /// Pixel of each ray, counted from the first of the row of tiles.
    pixels: Vec<u32>,
}

impl RayCamera {
    /// A camera of so many pixels.
    pub fn new(lens: &Lens, size_px: [u32; 2]) -> RayCamera {
        let [width, height] = size_px.map(|side| side as usize);
        let turn = sensor_from_camera();
        let direction = |pixel: usize| {
            let [x, y] = [pixel % width, pixel / width];
            let seen = lens.unproject([x as f64 + 0.5, y as f64 + 0.5])?;
            Some(turn * Vector3::from(seen))
        };
        let directions: Vec<_> = (0..width * height).into_par_iter().map(direction).collect();
        let rows = directions
            .par_chunks((TILE_PX * width).max(1))
            .map(|row| bunches_of(row, width))
            .collect();
        RayCamera {
            size_px: [width, height],
            directions,
            rows,
        }
    }

    /// Casts the images that are asked for, on the current rayon pool. Rays pass through the actors
    /// of `hidden`, whose ids rise.
    ///
    /// Panics if an image is shorter than its pixels need.
    pub fn cast(
        &self,
        scene: &RayScene,
        world_from_sensor: &Isometry3<f64>,
        hidden: &[ActorId],
        images: LabelImages<'_>,
    ) {
        let [width, height] = self.size_px;
        let row_px = TILE_PX * width;
        let firing = Firing {
            scene,
            origin_m: world_from_sensor.translation.vector.into(),
            world_from_sensor: *world_from_sensor.rotation.to_rotation_matrix().matrix(),
            hidden,
        };
        let mut rows: Vec<LabelImages<'_>> = (0..self.rows.len())
            .map(|_| LabelImages::default())
            .collect();
        let n_pixels = width * height;
        if let Some(bytes) = images.depth {
            let parts = bytes[..4 * n_pixels].chunks_mut(4 * row_px);
            rows.iter_mut()
                .zip(parts)
                .for_each(|(row, part)| row.depth = Some(part));
        }
        if let Some(bytes) = images.class {
            let parts = bytes[..n_pixels].chunks_mut(row_px);
            rows.iter_mut()
                .zip(parts)
                .for_each(|(row, part)| row.class = Some(part));
        }
        if let Some(bytes) = images.instance {
            let parts = bytes[..4 * n_pixels].chunks_mut(4 * row_px);
            rows.iter_mut()
                .zip(parts)
                .for_each(|(row, part)| row.instance = Some(part));
        }
        if let Some(bytes) = images.normals {
            let parts = bytes[..8 * n_pixels].chunks_mut(8 * row_px);
            rows.iter_mut()
                .zip(parts)
                .for_each(|(row, part)| row.normals = Some(part));
        }
        let all = rows.par_iter_mut().zip(&self.rows);
        all.zip(self.directions.par_chunks(row_px.max(1)))
            .for_each_init(
                || (RAYS_OF_IMAGES.span(), Stacks::default()),
                |(_span, stacks), ((images, bunches), directions)| {
                    images.clear(directions);
                    let caster = Caster {
                        scene,
                        ignored: None,
                        moment: None,
                        stacks: std::mem::take(stacks),
                    };
                    *stacks = in_lanes(Row {
                        firing: &firing,
                        caster,
                        bunches,
                        directions,
                        images,
                    });
                },
            );
    }
}

/// The rays of a row of tiles as bundles: one a tile, or smaller ones where a tile's rays spread too
/// far for one.
fn bunches_of(directions: &[Option<Vector3<f64>>], width: usize) -> Vec<Bunch> {
    let height = directions.len() / width.max(1);
    let mut bunches = Vec::new();
    for left in (0..width).step_by(TILE_PX) {
        let mut pixels = [NO_PIXEL; RAYS];
        for (ray, pixel) in pixels.iter_mut().enumerate() {
            let (group, lane) = (ray / GROUP, ray % GROUP);
            let across = TILE_PX / GROUP_PX[0];
            let x = left + group % across * GROUP_PX[0] + lane % GROUP_PX[0];
            let y = group / across * GROUP_PX[1] + lane / GROUP_PX[0];
            if x < width && y < height {
                *pixel = (y * width + x) as u32;
            }
        }
        if !bunch(directions, &pixels, &mut bunches) {
            for group in pixels.chunks(GROUP) {
                if !bunch(directions, group, &mut bunches) {
                    group.chunks(1).for_each(|one| {
                        bunch(directions, one, &mut bunches);
                    });
                }
            }
        }
    }
    bunches
}

/// Adds the rays of some pixels as one bundle; false if they spread too far, or if none sees anything.
fn bunch(directions: &[Option<Vector3<f64>>], pixels: &[u32], bunches: &mut Vec<Bunch>) -> bool {
    let of = |pixel: &u32| directions.get(*pixel as usize).copied().flatten();
    let rays: Vec<_> = pixels.iter().map(of).collect();
    if rays.iter().all(Option::is_none) {
        return true;
    }
    let Some(bundle) = Bundle::new(&rays) else {
        return false;
    };
    bunches.push(Bunch {
        bundle,
        pixels: pixels.to_vec(),
    });
    true
}

/// What all rays of a firing share.
struct Firing<'a> {
    scene: &'a RayScene,
    origin_m: Point3<f64>,
    world_from_sensor: Matrix3<f64>,
    hidden: &'a [ActorId],
}

/// The rays of a row of tiles, and where their pixels go.
struct Row<'t, 'a> {
    firing: &'t Firing<'t>,
    caster: Caster<'t>,
    bunches: &'t [Bunch],
    directions: &'t [Option<Vector3<f64>>],
    images: &'t mut LabelImages<'a>,
}

impl LaneWork for Row<'_, '_> {
    type Out = Stacks;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> Stacks {
        let firing = self.firing;
        for Bunch { bundle, pixels } in self.bunches {
            let mut hits = Hits::new(bundle, FAR_M);
            hits.sides = Sides::Front;
            hits.begin::<L>();
            self.caster.cast::<L>(
                &firing.origin_m,
                &firing.world_from_sensor,
                bundle,
                &mut hits,
            );
            for (ray, pixel) in pixels.iter().enumerate() {
                let Some(Some(direction)) = self.directions.get(*pixel as usize) else {
                    continue;
                };
                let direction = firing.world_from_sensor * direction;
                let world_ray = WorldRay {
                    origin_m: &firing.origin_m,
                    direction: &direction,
                    moment: None,
                };
                let mut hit = surface(firing.scene, &hits, bundle, ray, &world_ray);
                if hit.as_ref().is_some_and(|hit| firing.passes(hit)) {
                    hit = firing.behind(&direction, hit);
                }
                if let Some(hit) = hit {
                    self.images.put(*pixel as usize, &hit, || {
                        smooth_normal(firing.scene, &hit, &world_ray)
                    });
                }
            }
        }
        self.caster.stacks
    }
}

impl Firing<'_> {
    /// Whether a ray passes through what it hit.
    fn passes(&self, hit: &Hit) -> bool {
        hit.distance_m < NEAR_M || self.hides(hit.object)
    }

    fn hides(&self, object: ObjectId) -> bool {
        let actor = |actor: &ActorId| ObjectId::from(*actor);
        self.hidden.binary_search_by_key(&object, actor).is_ok()
    }

    /// The first surface behind one that the ray passes through that it does not.
    fn behind(&self, direction: &Vector3<f64>, mut hit: Option<Hit>) -> Option<Hit> {
        /// Surfaces nearer to one another than this count as one, metres.
        const STEP_M: f64 = 1e-4;
        while let Some(passed) = hit.filter(|hit| self.passes(hit)) {
            let from_m = (passed.distance_m + STEP_M).max(NEAR_M);
            let origin_m = self.origin_m + direction * from_m;
            hit = self.scene.cast_fronts(&origin_m, direction, FAR_M);
            if let Some(hit) = &mut hit {
                hit.distance_m += from_m;
            }
        }
        hit
    }
}

impl LabelImages<'_> {
    /// What pixels show that no ray reaches: nothing.
    fn clear(&mut self, directions: &[Option<Vector3<f64>>]) {
        if let Some(depth) = &mut self.depth {
            let nothing = f32::INFINITY.to_le_bytes();
            depth
                .chunks_exact_mut(4)
                .for_each(|it| it.copy_from_slice(&nothing));
        }
        if let Some(class) = &mut self.class {
            for (class, direction) in class.iter_mut().zip(directions) {
                *class = match direction {
                    Some(_) => Class::SKY.0,
                    None => Class::UNLABELED.0,
                };
            }
        }
        for image in [&mut self.instance, &mut self.normals]
            .into_iter()
            .flatten()
        {
            image.fill(0);
        }
    }

    #[inline(always)]
    fn put(&mut self, pixel: usize, hit: &Hit, normal: impl FnOnce() -> Vector3<f64>) {
        if let Some(depth) = &mut self.depth {
            let bytes = (hit.distance_m as f32).to_le_bytes();
            depth[4 * pixel..4 * pixel + 4].copy_from_slice(&bytes);
        }
        if let Some(class) = &mut self.class {
            class[pixel] = hit.class.0;
        }
        if let Some(instance) = &mut self.instance {
            instance[4 * pixel..4 * pixel + 4].copy_from_slice(&hit.object.0.to_le_bytes());
        }
        if let Some(normals) = &mut self.normals {
            let normal = normal();
            for axis in 0..3 {
                let bytes = f16::from_f64(normal[axis]).to_le_bytes();
                let at = 8 * pixel + 2 * axis;
                normals[at..at + 2].copy_from_slice(&bytes);
            }
        }
    }
}
