//! Lamps as sources of light: gathered per view, sorted into tiles of the image.

use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use sensor_core::Scene;
use sensor_spec::Intrinsics;

use crate::assets::{Emitter, Meshes, StillLamp};
use crate::camera_motion::{CameraMotion, NEAR_M};
use crate::quality::Quality;
use crate::uniform::LampData;

/// Upper limit of lamps in one view: the bits of a tile's set in `lamps.wgsl`, or fewer where every
/// lamp costs CPU time.
fn max_per_view(quality: Quality) -> usize {
    match quality {
        Quality::Low => 16,
        Quality::High => 64,
    }
}

/// Side of a tile, pixels, as in `lamps.wgsl`.
const TILE_PX: u32 = 32;
/// Lamps whose light on a surface at 1 m is darker than this share of white are ignored.
const MIN_LIGHT: f32 = 0.02;

/// A lamp that shines, in the world.
#[derive(Debug)]
pub(crate) struct Shining<'a> {
    place: Point3<f64>,
    axis: Vector3<f64>,
    emitter: &'a Emitter,
    /// Strength in display units.
    strength: f32,
}

/// All lamps that shine. `exposure` converts kilolux to display values; `dark_ratio` is how much
/// the scenery's lamps shine.
pub(crate) fn shining<'a>(
    scene: &Scene,
    assets: &'a Meshes,
    exposure: f32,
    dark_ratio: f32,
) -> Vec<Shining<'a>> {
    let mut found = Vec::new();
    let mut add = |place: Point3<f64>, axis: Vector3<f64>, emitter: &'a Emitter, share: f32| {
        let strength = emitter.beam.candela * 1e-3 * share * exposure;
        if strength >= MIN_LIGHT {
            found.push(Shining {
                place,
                axis,
                emitter,
                strength,
            });
        }
    };
    for StillLamp {
        place,
        emitter,
        is_on,
    } in &assets.still_lamps
    {
        if *is_on || dark_ratio > 0.0 {
            add(
                *place,
                axis_of(emitter),
                emitter,
                if *is_on { 1.0 } else { dark_ratio },
            );
        }
    }
    for instance in scene.dynamics.iter().filter(|instance| instance.lamps != 0) {
        let pose = &instance.world_from_mesh;
        for emitter in assets
            .emitters(instance.mesh)
            .iter()
            .filter(|emitter| emitter.bit < 32 && instance.lamps >> emitter.bit & 1 == 1)
        {
            add(
                pose * Point3::from(emitter.place_m.map(f64::from)),
                pose.rotation * axis_of(emitter),
                emitter,
                1.0,
            );
        }
    }
    found
}

/// A lamp for the shader, and the tiles that it reaches: first and last column, first and last row.
pub(crate) type LampInView = (LampData, [u32; 4]);

/// The lamps that reach into a view, sorted by the light they throw to the eye, strongest first.
pub(crate) fn reaching(
    shining: &[Shining<'_>],
    quality: Quality,
    lens: &Intrinsics,
    motion: &CameraMotion,
) -> Vec<LampInView> {
    let eye = Point3::from(motion.world_from_camera.translation.vector);
    let mut found: Vec<(f64, LampInView)> = Vec::new();
    for lamp in shining {
        let distance_m = (lamp.place - eye).norm();
        if distance_m > MAX_DISTANCE_M + lamp.emitter.beam.reach_m as f64 {
            continue;
        }
        let (data, centre, radius_m) = in_camera(lamp, &motion.camera_from_world);
        if let Some(rect) = tiles_of(lens, centre, radius_m) {
            found.push((distance_m / f64::from(lamp.strength).sqrt(), (data, rect)));
        }
    }
    // If there are too many, those that throw most light to the eye are kept.
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(max_per_view(quality));
    found.into_iter().map(|(_, lamp)| lamp).collect()
}

/// The lamps and tiles of all views, for upload.
#[derive(Debug, Default)]
pub(crate) struct LampLists {
    pub lamps: Vec<LampData>,
    pub tiles: Vec<[u32; 2]>,
}

/// Range of a view's lamps in the lists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LampRange {
    pub first_lamp: u32,
    pub first_tile: u32,
    pub n: u32,
}

impl LampLists {
    /// Adds the lamps that reach into a view.
    pub fn add_view(&mut self, found: &[LampInView], lens: &Intrinsics) -> LampRange {
        let range = LampRange {
            first_lamp: self.lamps.len() as u32,
            first_tile: self.tiles.len() as u32,
            n: found.len() as u32,
        };
        let [n_across, n_down] = n_tiles(lens);
        self.tiles
            .resize(self.tiles.len() + (n_across * n_down) as usize, [0; 2]);
        let tiles = &mut self.tiles[range.first_tile as usize..];
        for (bit, (data, [x0, x1, y0, y1])) in found.iter().enumerate() {
            self.lamps.push(*data);
            for y in *y0..=*y1 {
                for x in *x0..=*x1 {
                    tiles[(y * n_across + x) as usize][bit / 32] |= 1 << (bit % 32);
                }
            }
        }
        range
    }
}

/// The light of lamps further away is indistinguishable from darkness in an image.
const MAX_DISTANCE_M: f64 = 160.0;

fn axis_of(emitter: &Emitter) -> Vector3<f64> {
    UnitVector3::new_normalize(Vector3::from(emitter.beam.axis).cast()).into_inner()
}

fn n_tiles(lens: &Intrinsics) -> [u32; 2] {
    [
        lens.width_px.div_ceil(TILE_PX),
        lens.height_px.div_ceil(TILE_PX),
    ]
}

/// The lamp for the shader, and the bounding sphere of what it lights, camera space.
fn in_camera(
    lamp: &Shining<'_>,
    camera_from_world: &Isometry3<f64>,
) -> (LampData, Vector3<f64>, f64) {
    let (beam, strength) = (&lamp.emitter.beam, lamp.strength);
    let place = (camera_from_world * lamp.place).coords;
    let axis = camera_from_world.rotation * lamp.axis;
    let [full, edge] = [beam.full_deg, beam.edge_deg].map(|deg| deg.to_radians().cos());
    let data = LampData {
        place: [place.x as f32, place.y as f32, place.z as f32, beam.reach_m],
        axis: [axis.x as f32, axis.y as f32, axis.z as f32, edge],
        rgb: [
            lamp.emitter.rgb[0] * strength,
            lamp.emitter.rgb[1] * strength,
            lamp.emitter.rgb[2] * strength,
            1.0 / (full - edge),
        ],
    };
    let reach_m = beam.reach_m as f64;
    if beam.edge_deg < 45.0 {
        // Holds the tip and the rim of the cone.
        let radius_m = reach_m * (1.25 - edge as f64).sqrt().max(0.5);
        (data, place + axis * (0.5 * reach_m), radius_m)
    } else {
        (data, place, reach_m)
    }
}

/// Tiles that a sphere can touch: first and last column, first and last row.
fn tiles_of(lens: &Intrinsics, centre: Vector3<f64>, radius_m: f64) -> Option<[u32; 4]> {
    if centre.z + radius_m < NEAR_M {
        return None;
    }
    let [fx, fy, cx, cy] = lens.as_array();
    let span = |across: f64, focal: f64, middle: f64, n_px: u32| {
        let distance = across.hypot(centre.z);
        let (mut low, mut high) = (0.0, n_px as f64 - 1.0);
        if distance > radius_m {
            let (angle, half) = (across.atan2(centre.z), (radius_m / distance).asin());
            const EDGE: f64 = 1.55;
            if angle - half > EDGE || angle + half < -EDGE {
                return None;
            }
            low = if angle - half < -EDGE {
                low
            } else {
                f64::max(low, middle + focal * (angle - half).tan())
            };
            high = if angle + half > EDGE {
                high
            } else {
                f64::min(high, middle + focal * (angle + half).tan())
            };
        }
        (low <= high).then_some([low as u32 / TILE_PX, high as u32 / TILE_PX])
    };
    let ([x0, x1], [y0, y1]) = (
        span(centre.x, fx, cx, lens.width_px)?,
        span(centre.y, fy, cy, lens.height_px)?,
    );
    Some([x0, x1, y0, y1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: every point on the sphere that a pixel shows lies in one of the tiles.
    #[test]
    fn tiles_hold_every_visible_point_of_the_sphere() {
        let lens = Intrinsics::from_fov(320, 200, 1.4);
        let [fx, fy, cx, cy] = lens.as_array();
        let mut n_seen = 0;
        for k in 0..400u64 {
            let noise = schema_types::noise::Noise::new(5, 1, k);
            let draw = |i: u64, low: f64, high: f64| low + (high - low) * noise.uniform(i);
            let centre = Vector3::new(
                draw(0, -20.0, 20.0),
                draw(1, -8.0, 8.0),
                draw(2, -10.0, 30.0),
            );
            let radius_m = draw(3, 0.5, 12.0);
            let rect = tiles_of(&lens, centre, radius_m);
            for i in 0..300 {
                let (theta, phi) = (
                    (i as f64 * 0.618).fract() * std::f64::consts::TAU,
                    (1.0 - 2.0 * (i as f64 + 0.5) / 300.0).acos(),
                );
                let point = centre
                    + radius_m
                        * Vector3::new(phi.sin() * theta.cos(), phi.sin() * theta.sin(), phi.cos());
                let [u, v] = [cx + fx * point.x / point.z, cy + fy * point.y / point.z];
                if point.z > NEAR_M && (0.0..319.99).contains(&u) && (0.0..199.99).contains(&v) {
                    let [x0, x1, y0, y1] = rect.expect("a visible sphere has tiles");
                    let [x, y] = [u as u32 / TILE_PX, v as u32 / TILE_PX];
                    assert!(
                        (x0..=x1).contains(&x) && (y0..=y1).contains(&y),
                        "{point} of {centre} r {radius_m}: {x} {y} not in {rect:?}"
                    );
                    n_seen += 1;
                }
            }
        }
        assert!(n_seen > 5000, "{n_seen}");
    }
}
