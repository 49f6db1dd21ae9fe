//! Trees and bushes.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

use crate::random::Random;
use crate::vehicle::loft::{spike, tube};

const LEAVES: [[u8; 3]; 6] = [[78, 110, 48], [92, 122, 54], [66, 98, 46], [104, 128, 60], [84, 104, 44], [120, 126, 58]];
/// Number of kinds of trees.
pub const N_KINDS: usize = LEAVES.len();

/// A tree of this kind, standing on its origin, 6 to 9 m high.
pub fn tree(kind: usize) -> Mesh {
    let mut random = Random::new(0x7ee, kind as u64, 0);
    let mut builder = MeshBuilder::new(format!("tree {kind}"));
    let height = random.between(6.2, 9.0) as f32;
    let crown = random.between(1.7, 2.4) as f32;
    let clumps: Vec<([f32; 3], f32)> = (0..7)
        .map(|i| {
            let a = std::f32::consts::TAU * i as f32 / 6.0 + random.between(-0.3, 0.3) as f32;
            let (away, z) =
                if i == 6 { (0.0, height - crown * 0.75) } else { (crown * 0.62, height * 0.52 + random.between(0.0, 1.5) as f32) };
            ([away * a.cos(), away * a.sin(), z], crown * random.between(0.62, 0.82) as f32)
        })
        .collect();
    let bark = Surface::new(Class::VEGETATION, Material::Bark, [92, 76, 60]);
    let split = height * 0.42;
    for (level, until_m) in [(0, 18.0), (1, 52.0), (2, 120.0), (3, 600.0)] {
        match level {
            0..=2 => tube(&mut builder, bark, ([0.0, 0.0, -0.05], 0.17), ([0.02, 0.03, split], 0.11), [8, 5, 3][level]),
            _ => spike(&mut builder, bark, ([0.0, 0.0, -0.05], 0.2), [0.02, 0.03, split + 0.5]),
        }
        if level == 0 {
            for (centre, _) in &clumps {
                tube(&mut builder, bark, ([0.02, 0.03, split - 0.05], 0.07), (*centre, 0.03), 4);
            }
        }
        let shade = |c: &([f32; 3], f32)| {
            let k = 0.86 + 0.2 * (c.0[2] / height);
            LEAVES[kind].map(|x| (f32::from(x) * k) as u8)
        };
        let leaves = |rgb| Surface::new(Class::VEGETATION, Material::Foliage, rgb);
        match level {
            0 => clumps.iter().for_each(|c| blob(&mut builder, leaves(shade(c)), c.0, c.1, 1, kind as u64)),
            1 => clumps.iter().step_by(2).for_each(|c| blob(&mut builder, leaves(shade(c)), c.0, c.1 * 1.2, 0, kind as u64)),
            3 => {
                let middle = [0.0, 0.0, 0.5 * (height * 0.42 + height)];
                diamond(&mut builder, leaves(LEAVES[kind]), middle, [crown * 1.25, height * 0.36]);
            }
            _ => {
                let middle = [0.0, 0.0, 0.5 * (height * 0.42 + height)];
                blob(&mut builder, leaves(LEAVES[kind]), middle, crown * 1.2, 0, kind as u64);
            }
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// An octahedron standing on its tip, [reach, half height], rounded by its normals.
fn diamond(builder: &mut MeshBuilder, surface: Surface, centre: [f32; 3], [reach, half]: [f32; 2]) {
    let at = |d: [f32; 3]| [centre[0] + reach * d[0], centre[1] + reach * d[1], centre[2] + half * d[2]];
    let around = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    for k in 0..4 {
        let (a, b) = (around[k], around[(k + 1) % 4]);
        for directions in [[a, b, [0.0, 0.0, 1.0]], [b, a, [0.0, 0.0, -1.0]]] {
            builder.polygon_with_normals(surface, &directions.map(at), &directions, &[[0.0; 2]; 3]);
        }
    }
}

/// Number of kinds of conifers.
pub const N_CONIFERS: usize = 2;

/// A fir: cones of branches round a trunk.
pub fn conifer(kind: usize) -> Mesh {
    let mut builder = MeshBuilder::new(format!("conifer {kind}"));
    let (height, reach) = [(10.5f32, 2.3f32), (8.0, 1.9)][kind % N_CONIFERS];
    let bark = Surface::new(Class::VEGETATION, Material::Bark, [84, 66, 52]);
    let needles = |k: f32| {
        let rgb = [[48.0, 76.0, 46.0], [58.0, 84.0, 50.0]][kind % N_CONIFERS].map(|x: f32| (x * k) as u8);
        Surface::new(Class::VEGETATION, Material::Foliage, rgb)
    };
    for (n, n_tiers, until_m) in [(9, 5, 22.0), (6, 3, 60.0), (5, 1, 140.0), (4, 1, 600.0)] {
        if n > 4 {
            tube(&mut builder, bark, ([0.0, 0.0, -0.05], 0.17), ([0.0, 0.0, 0.2 * height], 0.13), n.min(6));
        } else {
            spike(&mut builder, bark, ([0.0, 0.0, -0.05], 0.2), [0.0, 0.0, 0.3 * height]);
        }
        for tier in 0..n_tiers {
            let share = tier as f32 / n_tiers as f32;
            let (low, radius) = (height * (0.14 + 0.8 * share), reach * (1.0 - 0.82 * share));
            let top = if tier + 1 == n_tiers { height } else { low + 1.5 * height / n_tiers as f32 };
            cone(&mut builder, needles(0.88 + 0.2 * share), low, top, radius, n, tier as f32 * 0.7);
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// A cone with a wavy rim, and its underside.
fn cone(builder: &mut MeshBuilder, surface: Surface, low: f32, top: f32, radius: f32, n: usize, turn: f32) {
    let rim = |k: usize| {
        let a = std::f32::consts::TAU * (k % n) as f32 / n as f32 + turn;
        let r = radius * if k.is_multiple_of(2) { 1.0 } else { 0.84 };
        [r * a.cos(), r * a.sin(), low + if k.is_multiple_of(2) { 0.0 } else { 0.12 }]
    };
    for k in 0..n {
        builder.triangle(surface, [rim(k), rim(k + 1), [0.0, 0.0, top]]);
        if n > 4 {
            builder.triangle(surface, [rim(k + 1), rim(k), [0.0, 0.0, low + 0.35]]);
        }
    }
}

/// A clipped bush, 0.9 m high.
pub fn bush() -> Mesh {
    let mut builder = MeshBuilder::new("bush");
    let leaves = Surface::new(Class::VEGETATION, Material::Foliage, [70, 102, 46]);
    blob(&mut builder, leaves, [0.0, 0.0, 0.42], 0.55, 1, 99);
    builder.end_level(30.0);
    blob(&mut builder, leaves, [0.0, 0.0, 0.42], 0.55, 0, 99);
    builder.end_level(60.0);
    diamond(&mut builder, leaves, [0.0, 0.0, 0.42], [0.58, 0.5]);
    builder.end_level(160.0);
    builder.finish()
}

/// A lumpy ball made from an icosahedron split `splits` times.
fn blob(builder: &mut MeshBuilder, surface: Surface, centre: [f32; 3], radius: f32, splits: usize, seed: u64) {
    let g = 1.618_034;
    let corners: [[f32; 3]; 12] = [
        [-1., g, 0.],
        [1., g, 0.],
        [-1., -g, 0.],
        [1., -g, 0.],
        [0., -1., g],
        [0., 1., g],
        [0., -1., -g],
        [0., 1., -g],
        [g, 0., -1.],
        [g, 0., 1.],
        [-g, 0., -1.],
        [-g, 0., 1.],
    ];
    const FACES: [[usize; 3]; 20] = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let unit = |p: [f32; 3]| {
        let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
        p.map(|x| x / length)
    };
    let mut triangles: Vec<[[f32; 3]; 3]> = FACES.iter().map(|f| f.map(|i| unit(corners[i]))).collect();
    for _ in 0..splits {
        let mid = |a: [f32; 3], b: [f32; 3]| unit(std::array::from_fn(|i| a[i] + b[i]));
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (mid(a, b), mid(b, c), mid(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    // The same direction gets the same lump in every triangle.
    let lump = |d: [f32; 3]| {
        let key = d.iter().fold(seed, |h, &x| schema_types::noise::mix(h ^ ((x * 512.0).round() as i64 as u64)));
        radius * (0.86 + 0.28 * ((key >> 40) as f32 / (1u64 << 24) as f32))
    };
    for directions in triangles {
        let points = directions.map(|d| std::array::from_fn::<f32, 3, _>(|i| centre[i] + d[i] * lump(d) * if i == 2 { 0.88 } else { 1.0 }));
        builder.polygon_with_normals(surface, &points, &directions, &directions.map(|d| [d[0] * radius, d[2] * radius]));
    }
}
