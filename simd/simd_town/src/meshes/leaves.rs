//! Leaves: a crown is one lumpy hull round its clumps, with sprays of leaves that stand off it like
//! scales.
//!
//! Sprays need no transparency, so cameras, shadows and rays see the same triangles. Hull and
//! sprays have the normals of the clumps' common surface: the crown is lit as one round, lumpy
//! thing, and only its rim and its texture are ragged.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use crate::random::Random;

/// An ellipsoid of leaves.
#[derive(Clone, Copy, Debug)]
pub struct Clump {
    /// Middle, metres.
    pub middle: [f32; 3],
    /// Half axes, metres.
    pub half: [f32; 3],
}

/// What a crown is made of.
#[derive(Clone, Copy, Debug)]
pub struct Cover {
    /// The hull.
    pub hull: Globe,
    /// Size of the hull relative to the clumps, and its lightness relative to the sprays.
    pub inside: (f32, f32),
    /// Number of sprays, and their length, metres.
    pub sprays: (usize, f32),
}

type V = nalgebra::Vector3<f32>;

/// How sharply the creases between clumps are cut.
const SHARPNESS: f32 = 3.4;
/// How fine a hull is.
#[derive(Clone, Copy, Debug)]
pub struct Globe {
    /// Rings from below upwards.
    pub n_rings: usize,
    /// Corners of each.
    pub n_around: usize,
    /// Whether it is closed below.
    pub is_whole: bool,
}

/// Heights of the lowest and the highest ring of a hull that is open below.
const DOME: (f32, f32) = (-0.72, 0.25);

/// The common surface of clumps, as seen from a place among them.
struct Shape<'a> {
    clumps: &'a [Clump],
    middle: V,
    /// Half extents, and heights of the lowest and the highest point.
    reach: V,
    span: [f32; 2],
}

impl<'a> Shape<'a> {
    fn of(clumps: &'a [Clump]) -> Shape<'a> {
        let edge = |sign: f32| {
            V::from_fn(|i, _| {
                clumps
                    .iter()
                    .map(|c| sign * (c.middle[i] + sign * c.half[i]))
                    .fold(f32::MIN, f32::max)
            })
        };
        let (high, low) = (edge(1.0), -edge(-1.0));
        Shape {
            clumps,
            middle: 0.5 * (low + high),
            reach: 0.5 * (high - low),
            span: [low.z, high.z],
        }
    }

    /// Density of the clumps at a place (1 on the surface), and the direction outwards.
    fn at(&self, p: V) -> (f32, V) {
        let (mut sum, mut out) = (0.0, V::zeros());
        for clump in self.clumps {
            let away = V::from_fn(|i, _| (p[i] - clump.middle[i]) / clump.half[i]);
            let weight = (-SHARPNESS * (away.norm_squared() - 1.0)).exp();
            sum += weight;
            out += V::from_fn(|i, _| away[i] / clump.half[i]) * weight;
        }
        (
            sum,
            out.try_normalize(1e-9)
                .unwrap_or((p - self.middle).try_normalize(1e-6).unwrap_or(V::z())),
        )
    }

    /// The outermost place of the surface towards a point of the unit sphere, and the normal there.
    fn surface(&self, towards: V) -> (V, V) {
        let ray = towards.component_mul(&self.reach);
        // The surface lies at or beyond the point where the ray leaves the last clump. A ray that
        // meets no clump ends in a crease.
        let farthest = self
            .clumps
            .iter()
            .filter_map(|clump| leaves_at(clump, self.middle, ray))
            .fold(0.0, f32::max);
        let is_inside = |share: f32| self.at(self.middle + ray * share).0 >= 1.0;
        let (mut inside, mut outside) = if farthest > 0.25 {
            (farthest, farthest + 0.4)
        } else {
            (0.25, 0.9)
        };
        for _ in 0..7 {
            let half = 0.5 * (inside + outside);
            if is_inside(half) {
                inside = half
            } else {
                outside = half
            }
        }
        let p = self.middle + ray * inside;
        (p, self.at(p).1)
    }

    /// Lightness at a height: the lower part of a crown is darker because little light reaches it.
    fn light(&self, z: f32) -> f32 {
        0.80 + 0.26 * ((z - self.span[0]) / (self.span[1] - self.span[0])).clamp(0.0, 1.0)
    }
}

/// Share of a ray at which it leaves a clump.
fn leaves_at(clump: &Clump, from: V, ray: V) -> Option<f32> {
    let scaled = |v: V| V::from_fn(|i, _| v[i] / clump.half[i]);
    let (d, o) = (scaled(ray), scaled(from - V::from(clump.middle)));
    let (a, b, c) = (d.norm_squared(), d.dot(&o), o.norm_squared() - 1.0);
    let root = b * b - a * c;
    (root >= 0.0)
        .then(|| (root.sqrt() - b) / a)
        .filter(|t| *t > 0.0)
}

/// Foliage of this colour, lighter or darker.
pub fn foliage(rgb: [u8; 3], k: f32) -> Surface {
    Surface::new(
        Class::VEGETATION,
        Material::Foliage,
        rgb.map(|x| (f32::from(x) * k).clamp(0.0, 255.0) as u8),
    )
}

/// Corners of a sphere in rings, each turned by half a step against the one below, and its
/// triangles; or of a dome, open below.
fn globe(globe: Globe) -> (Vec<V>, Vec<[usize; 3]>) {
    let Globe {
        n_rings,
        n_around: n,
        is_whole,
    } = globe;
    let mut corners = Vec::new();
    for ring in 0..n_rings {
        let z = if is_whole {
            -(std::f32::consts::PI * (ring + 1) as f32 / (n_rings + 1) as f32).cos()
        } else {
            DOME.0 + (DOME.1 - DOME.0) * ring as f32 / (n_rings - 1) as f32
        };
        let radius = (1.0 - z * z).sqrt();
        let around =
            (0..n).map(|k| std::f32::consts::TAU * (k as f32 + 0.5 * ring as f32) / n as f32);
        corners.extend(around.map(|a| V::new(radius * a.cos(), radius * a.sin(), z)));
    }
    let at = |ring: usize, k: usize| ring * n + k % n;
    let mut triangles = Vec::new();
    for ring in 1..n_rings {
        for k in 0..n {
            triangles.push([at(ring - 1, k), at(ring - 1, k + 1), at(ring, k)]);
            triangles.push([at(ring, k), at(ring - 1, k + 1), at(ring, k + 1)]);
        }
    }
    let (top, bottom) = (corners.len(), corners.len() + 1);
    corners.push(V::z());
    triangles.extend((0..n).map(|k| [at(n_rings - 1, k), at(n_rings - 1, k + 1), top]));
    if is_whole {
        corners.push(-V::z());
        triangles.extend((0..n).map(|k| [bottom, at(0, k + 1), at(0, k)]));
    }
    (corners, triangles)
}

/// Adds a triangle of leaves. Normals that point away from the face are turned towards it, since a
/// face must not be lit from behind.
fn leaf(builder: &mut MeshBuilder, surface: Surface, corners: [V; 3], normals: [V; 3]) {
    let Some(face) = (corners[1] - corners[0])
        .cross(&(corners[2] - corners[0]))
        .try_normalize(1e-9)
    else {
        return;
    };
    let normals = normals.map(|n| (n + face * (2.0 * (0.45 - n.dot(&face)).max(0.0))).normalize());
    builder.polygon_with_normals(
        surface,
        &corners.map(Into::into),
        &normals.map(Into::into),
        &[[0.0; 2]; 3],
    );
}

/// A corner of a hull: place, normal.
type Corner = (V, V);

/// Puts a hull round clumps and sprays on it.
pub fn crown(
    builder: &mut MeshBuilder,
    clumps: &[Clump],
    cover: Cover,
    rgb: [u8; 3],
    random: &mut Random,
) {
    let shape = Shape::of(clumps);
    let hull = hull(&shape, cover);
    for corners in &hull {
        let z = corners.iter().map(|(p, _)| p.z).sum::<f32>() / 3.0;
        let surface = foliage(rgb, cover.inside.1 * shape.light(z));
        leaf(
            builder,
            surface,
            corners.map(|(p, _)| p),
            corners.map(|(_, normal)| normal),
        );
    }
    let (n, length_m) = cover.sprays;
    for i in 0..n {
        // Sprays are spread evenly over the hull: each triangle gets one in turn; if there are few
        // sprays, triangles are skipped.
        let corners =
            &hull[(i * hull.len() / n.min(hull.len()).max(1) + i / hull.len()) % hull.len()];
        spray(builder, &shape, corners, length_m, rgb, random);
    }
}

fn hull(shape: &Shape<'_>, cover: Cover) -> Vec<[Corner; 3]> {
    let (directions, triangles) = globe(cover.hull);
    let found: Vec<Corner> = directions.iter().map(|d| shape.surface(*d)).collect();
    let corners: Vec<V> = found
        .iter()
        .map(|(p, _)| shape.middle + (p - shape.middle) * cover.inside.0)
        .collect();
    let face =
        |t: &[usize; 3]| (corners[t[1]] - corners[t[0]]).cross(&(corners[t[2]] - corners[t[0]]));
    // Half the surface's own normal, half that of the triangles about the corner.
    let mut around = vec![V::zeros(); corners.len()];
    for t in &triangles {
        t.iter().for_each(|&k| around[k] += face(t));
    }
    let mixed = |faces: &V, own: &V| {
        (faces.try_normalize(1e-9).unwrap_or(*own) + own)
            .try_normalize(1e-3)
            .unwrap_or(*own)
    };
    let normals: Vec<V> = around
        .iter()
        .zip(&found)
        .map(|(faces, (_, own))| mixed(faces, own))
        .collect();
    triangles
        .iter()
        .map(|t| t.map(|k| (corners[k], normals[k])))
        .collect()
}

/// Adds a spray of leaves: its foot lies in the hull, its tip stands a little off it.
fn spray(
    builder: &mut MeshBuilder,
    shape: &Shape<'_>,
    hull: &[Corner; 3],
    length_m: f32,
    rgb: [u8; 3],
    random: &mut Random,
) {
    let mut draw = |low: f32, high: f32| random.between(f64::from(low), f64::from(high)) as f32;
    let weights = [draw(0.05, 1.0), draw(0.05, 1.0), draw(0.05, 1.0)];
    let total: f32 = weights.iter().sum();
    let mean = |of: fn(&Corner) -> V| {
        hull.iter()
            .zip(weights)
            .map(|(corner, weight)| of(corner) * (weight / total))
            .sum::<V>()
    };
    let p = mean(|corner| corner.0);
    let out = mean(|corner| corner.1)
        .try_normalize(1e-3)
        .unwrap_or(hull[0].1);
    // Tips point anywhere, most of them a little down.
    let wish = V::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-1.2, 0.7));
    let along = (wish - out * wish.dot(&out))
        .try_normalize(1e-3)
        .unwrap_or(out.cross(&V::x()).normalize());
    let across = out.cross(&along);
    let length = length_m * draw(0.7, 1.3);
    let foot = p - along * (0.35 * length) - out * (0.10 * length);
    let half = across * (0.42 * length * draw(0.8, 1.2));
    let tip = p + along * (0.65 * length) + out * (length * draw(0.10, 0.55));
    let corners = [
        foot + half,
        foot - half + along * (length * draw(-0.12, 0.12)),
        tip,
    ];
    let normals = corners.map(|c| (shape.at(c).1 + 2.0 * out).normalize());
    let warm = draw(-0.05, 0.06);
    let tint = [1.0 + warm, 1.0, 1.0 - 1.3 * warm];
    let rgb = std::array::from_fn(|i| (f32::from(rgb[i]) * tint[i]).clamp(0.0, 255.0) as u8);
    leaf(
        builder,
        foliage(rgb, shape.light(p.z) * draw(0.95, 1.06)),
        corners,
        normals,
    );
}
