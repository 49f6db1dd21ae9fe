//! Trees and bushes.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};
use simd_body::solid::{spike, tube};

use super::leaves::{Clump, Cover, Globe, crown, foliage};
use crate::random::Random;

/// How a kind of broad-leaved tree grows.
struct Species {
    height_m: f32,
    /// Half width of the crown.
    reach_m: f32,
    /// Share of the height below the crown.
    bare_ratio: f32,
    /// Number of clumps of leaves, and their half width relative to the crown's.
    n_clumps: usize,
    clump_ratio: f32,
    leaves: [u8; 3],
    bark: [u8; 3],
}

const fn species(
    height_m: f32,
    reach_m: f32,
    bare_ratio: f32,
    n_clumps: usize,
    clump_ratio: f32,
    leaves: [u8; 3],
    bark: [u8; 3],
) -> Species {
    Species {
        height_m,
        reach_m,
        bare_ratio,
        n_clumps,
        clump_ratio,
        leaves,
        bark,
    }
}

/// Lime, plane, oak, birch, hornbeam, maple, cherry, a younger lime.
const SPECIES: [Species; N_KINDS] = [
    species(8.2, 2.2, 0.36, 8, 0.50, [86, 109, 76], [92, 76, 60]),
    species(9.0, 2.7, 0.40, 9, 0.46, [104, 123, 92], [126, 116, 94]),
    species(8.4, 3.0, 0.34, 10, 0.42, [72, 94, 67], [80, 66, 52]),
    species(9.4, 1.6, 0.30, 7, 0.62, [115, 133, 100], [208, 204, 194]),
    species(8.8, 1.35, 0.26, 6, 0.72, [87, 107, 74], [104, 92, 74]),
    species(7.4, 2.2, 0.38, 8, 0.50, [113, 123, 87], [92, 78, 62]),
    species(6.0, 1.9, 0.36, 7, 0.52, [97, 119, 92], [96, 66, 56]),
    species(6.8, 1.8, 0.36, 7, 0.54, [93, 116, 82], [98, 82, 64]),
];
/// Number of kinds of trees.
pub const N_KINDS: usize = 8;

type V = nalgebra::Vector3<f32>;

/// Stream of random numbers.
const TREE: u64 = 0x7ee;

/// A tree of this kind, standing on its origin, 6 to 10 m high.
pub fn tree(kind: usize) -> Mesh {
    let species = &SPECIES[kind];
    let mut random = Random::new(TREE, kind as u64, 0);
    let mut builder = MeshBuilder::new(format!("tree {kind}"));
    let clumps = clumps(species, &mut random);
    let bark = Surface::new(Class::VEGETATION, Material::Bark, species.bark);
    let (height, split) = (
        species.height_m,
        species.height_m * (species.bare_ratio + 0.05),
    );
    let half_z = 0.5 * height * (1.0 - species.bare_ratio);
    for (level, until_m) in [(0, 14.0), (1, 38.0), (2, 105.0), (3, 540.0)] {
        match level {
            0 | 1 => {
                let n = [8, 5][level];
                tube(
                    &mut builder,
                    bark,
                    ([0.0, 0.0, -0.05], 0.018 * height),
                    ([0.03, 0.03, split], 0.013 * height),
                    n,
                );
            }
            _ => spike(
                &mut builder,
                bark,
                ([0.0, 0.0, -0.05], 0.022 * height),
                [0.03, 0.03, split + 0.5],
            ),
        }
        if level == 0 {
            tube(
                &mut builder,
                bark,
                ([0.03, 0.03, split], 0.013 * height),
                ([0.0, 0.0, split + 0.8 * half_z], 0.03),
                5,
            );
            for clump in &clumps {
                tube(
                    &mut builder,
                    bark,
                    ([0.03, 0.03, split - 0.15], 0.06),
                    (clump.middle, 0.025),
                    3,
                );
            }
        }
        let cover = [
            Cover {
                hull: Globe {
                    n_rings: 5,
                    n_around: 8,
                    is_whole: true,
                },
                inside: (0.92, 0.66),
                sprays: (384, 0.32 + 0.12 * species.reach_m),
            },
            Cover {
                hull: Globe {
                    n_rings: 4,
                    n_around: 7,
                    is_whole: true,
                },
                inside: (1.0, 0.92),
                sprays: (45, 0.43 + 0.28 * species.reach_m),
            },
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 5,
                    is_whole: true,
                },
                inside: (1.08, 0.97),
                sprays: (9, 0.55 + 0.45 * species.reach_m),
            },
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 3,
                    is_whole: false,
                },
                inside: (1.18, 1.0),
                sprays: (0, 0.0),
            },
        ][level];
        crown(&mut builder, &clumps, cover, species.leaves, &mut random);
        builder.end_level(until_m);
    }
    builder.finish()
}

/// The clumps of a crown: round the stem from below upwards, and one on top.
fn clumps(species: &Species, random: &mut Random) -> Vec<Clump> {
    let (reach, low) = (species.reach_m, species.height_m * species.bare_ratio);
    let n = species.n_clumps - 1;
    let mut draw = |low: f32, high: f32| random.between(f64::from(low), f64::from(high)) as f32;
    let size = |k: f32| [k, k, 0.84 * k].map(|x| x * species.clump_ratio * reach);
    let mut all: Vec<Clump> = (0..n)
        .map(|i| {
            let up = (i as f32 + 0.5) / n as f32;
            let a = 2.399_963 * i as f32 + draw(-0.3, 0.3);
            // Widest below the middle.
            let away = reach
                * (1.0 - species.clump_ratio)
                * (1.0 - (1.35 * up - 0.45).powi(2)).max(0.1).sqrt()
                * draw(0.92, 1.08);
            let half = size(draw(0.88, 1.12));
            let span = species.height_m - low - 2.0 * half[2];
            Clump {
                middle: [
                    away * a.cos(),
                    away * a.sin(),
                    low + half[2] + 0.86 * up * span + draw(-0.15, 0.15),
                ],
                half,
            }
        })
        .collect();
    let half = size(0.92);
    all.push(Clump {
        middle: [draw(-0.2, 0.2), draw(-0.2, 0.2), species.height_m - half[2]],
        half,
    });
    all
}

/// Number of kinds of conifers.
pub const N_CONIFERS: usize = 3;

/// A fir, a young one, or a pine.
pub fn conifer(kind: usize) -> Mesh {
    let mut builder = MeshBuilder::new(format!("conifer {kind}"));
    if kind % N_CONIFERS == 2 {
        pine(&mut builder);
        return builder.finish();
    }
    let mut random = Random::new(TREE, 100 + kind as u64, 0);
    let (height, reach) = [(10.5f32, 2.3f32), (7.6, 1.8)][kind % N_CONIFERS];
    let bark = Surface::new(Class::VEGETATION, Material::Bark, [84, 66, 52]);
    let rgb = [[48, 76, 46], [58, 84, 50]][kind % N_CONIFERS];
    for (n, n_tiers, until_m) in [(15, 8, 20.0), (9, 5, 55.0), (6, 2, 130.0), (3, 1, 540.0)] {
        if n > 6 {
            tube(
                &mut builder,
                bark,
                ([0.0, 0.0, -0.05], 0.17),
                ([0.0, 0.0, 0.2 * height], 0.13),
                6,
            );
        } else {
            spike(
                &mut builder,
                bark,
                ([0.0, 0.0, -0.05], 0.2),
                [0.0, 0.0, 0.3 * height],
            );
        }
        for tier in 0..n_tiers {
            let share = tier as f32 / n_tiers as f32;
            let (low, radius) = (height * (0.10 + 0.84 * share), reach * (1.0 - 0.86 * share));
            let top = if tier + 1 == n_tiers {
                height
            } else {
                low + (1.9 * height / n_tiers as f32).min(height - low)
            };
            branches(
                &mut builder,
                rgb,
                0.84 + 0.24 * share,
                [low, top, radius],
                n,
                &mut random,
            );
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// One whorl of drooping branches: a cone with a deeply cut rim, [rim, top, radius], and its dark
/// underside.
fn branches(
    builder: &mut MeshBuilder,
    rgb: [u8; 3],
    k: f32,
    [low, top, radius]: [f32; 3],
    n: usize,
    random: &mut Random,
) {
    let turn = random.between(0.0, 6.0) as f32;
    let rim: Vec<[f32; 3]> = (0..2 * n)
        .map(|i| {
            let a = std::f32::consts::TAU * (i as f32 + random.between(-0.22, 0.22) as f32)
                / (2 * n) as f32
                + turn;
            // Tips hang down, and the next whorl is visible between two branches.
            let (r, lift) = if i.is_multiple_of(2) {
                (random.between(0.86, 1.1) as f32, 0.0)
            } else {
                (0.66, 0.16)
            };
            [
                radius * r * a.cos(),
                radius * r * a.sin(),
                low + lift * (top - low) + random.between(-0.06, 0.06) as f32,
            ]
        })
        .collect();
    // Normals are mostly those of the cone that it looks like from afar, and a little those of its
    // ridges.
    let slope = radius / (top - low);
    let round = |p: [f32; 3], face: V| {
        let out = V::new(p[0], p[1], 0.0)
            .try_normalize(1e-4)
            .unwrap_or(V::new(face.x, face.y, 0.0));
        let lit = (out + V::z() * slope).normalize() + 0.5 * face;
        <[f32; 3]>::from(lit.normalize())
    };
    for i in 0..2 * n {
        let (a, b) = (rim[i], rim[(i + 1) % (2 * n)]);
        let light =
            if i.is_multiple_of(2) { 1.0 } else { 0.95 } * random.between(0.94, 1.06) as f32;
        let corners = [a, b, [0.0, 0.0, top]];
        let face = (V::from(b) - V::from(a))
            .cross(&(V::from(corners[2]) - V::from(a)))
            .normalize();
        builder.polygon_with_normals(
            foliage(rgb, k * light),
            &corners,
            &corners.map(|p| round(p, face)),
            &[[0.0; 2]; 3],
        );
        if n > 6 {
            builder.triangle(
                foliage(rgb, 0.55 * k),
                [b, a, [0.0, 0.0, low + 0.3 * (top - low)]],
            );
        }
    }
}

/// A pine: a bare stem under flat clouds of needles.
fn pine(builder: &mut MeshBuilder) {
    let mut random = Random::new(TREE, 102, 0);
    let bark = Surface::new(Class::VEGETATION, Material::Bark, [122, 84, 62]);
    let rgb = [70, 92, 54];
    let clump = |a: f32, away: f32, z: f32, half: [f32; 2]| Clump {
        middle: [away * a.cos(), away * a.sin(), z],
        half: [half[0], half[0], half[1]],
    };
    let clumps = [
        clump(0.4, 1.1, 5.6, [1.1, 0.5]),
        clump(2.6, 1.2, 6.5, [1.2, 0.55]),
        clump(4.7, 1.0, 7.3, [1.15, 0.5]),
        clump(1.3, 0.7, 8.0, [1.2, 0.55]),
        clump(3.4, 0.5, 8.8, [1.1, 0.6]),
    ];
    let whole = [clump(0.0, 0.1, 7.3, [1.8, 2.0])];
    for (level, until_m) in [(0, 14.0), (1, 38.0), (2, 105.0), (3, 540.0)] {
        if level < 2 {
            tube(
                builder,
                bark,
                ([0.0, 0.0, -0.05], 0.19),
                ([0.15, 0.1, 5.0], 0.13),
                [7, 5][level],
            );
            tube(
                builder,
                bark,
                ([0.15, 0.1, 5.0], 0.13),
                ([0.0, 0.0, 8.6], 0.05),
                5,
            );
        } else {
            spike(builder, bark, ([0.0, 0.0, -0.05], 0.21), [0.1, 0.05, 6.6]);
        }
        let cover = [
            Cover {
                hull: Globe {
                    n_rings: 3,
                    n_around: 6,
                    is_whole: true,
                },
                inside: (0.92, 0.68),
                sprays: (50, 0.55),
            },
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 4,
                    is_whole: true,
                },
                inside: (1.05, 0.92),
                sprays: (8, 0.8),
            },
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 5,
                    is_whole: true,
                },
                inside: (1.02, 0.97),
                sprays: (10, 1.3),
            },
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 3,
                    is_whole: false,
                },
                inside: (1.15, 1.0),
                sprays: (0, 0.0),
            },
        ][level];
        if level == 0 {
            for clump in &clumps {
                tube(
                    builder,
                    bark,
                    ([0.1, 0.05, clump.middle[2] - 0.7], 0.06),
                    (clump.middle, 0.03),
                    3,
                );
            }
        }
        // The clouds of needles do not touch.
        let groups: Vec<&[Clump]> = match level {
            0 => clumps.chunks(1).collect(),
            1 => clumps[..4].chunks(1).collect(),
            _ => vec![&whole],
        };
        groups
            .into_iter()
            .for_each(|group| crown(builder, group, cover, rgb, &mut random));
        builder.end_level(until_m);
    }
}

/// A palm, for towns where it is warm: a leaning stem and a tuft of fronds.
pub fn palm() -> Mesh {
    let mut random = Random::new(TREE, 200, 0);
    let mut builder = MeshBuilder::new("palm");
    let bark = Surface::new(Class::VEGETATION, Material::Bark, [134, 112, 86]);
    let top = [0.35f32, 0.1, 7.4];
    for (n_sides, n_fronds, n_parts, until_m) in [
        (7, 17, 3, 22.0),
        (5, 11, 2, 60.0),
        (3, 7, 1, 160.0),
        (3, 4, 1, 600.0),
    ] {
        tube(
            &mut builder,
            bark,
            ([0.0, 0.0, -0.05], 0.22),
            ([0.12, 0.03, 3.2], 0.15),
            n_sides,
        );
        tube(
            &mut builder,
            bark,
            ([0.12, 0.03, 3.2], 0.15),
            (top, 0.13),
            n_sides,
        );
        for i in 0..n_fronds {
            let a = 2.399_963 * i as f32 + random.between(-0.2, 0.2) as f32;
            // Inner fronds stand up, outer fronds hang down.
            let rise = 1.15 - 1.75 * (i as f32 + 0.5) / n_fronds as f32;
            let k = 0.74 + 0.3 * rise.max(0.0) + random.between(-0.05, 0.05) as f32;
            frond(&mut builder, k, top, a, rise, n_parts);
        }
        builder.end_level(until_m);
    }
    builder.finish()
}

/// Adds a frond at the stem's top: bent down by its weight, folded along its rib, visible from both
/// sides.
fn frond(
    builder: &mut MeshBuilder,
    k: f32,
    foot: [f32; 3],
    around: f32,
    rise: f32,
    n_parts: usize,
) {
    const LENGTH_M: f32 = 2.5;
    let along = |t: f32| {
        let (r, z) = (
            LENGTH_M * t * (1.0 - 0.12 * t),
            LENGTH_M * (rise * t - (0.55 + 0.35 * rise.max(0.0)) * t * t),
        );
        [
            foot[0] + r * around.cos(),
            foot[1] + r * around.sin(),
            foot[2] + z,
        ]
    };
    let side = |t: f32, s: f32| {
        let [x, y, z] = along(t);
        let half = 0.42 * (t * (1.08 - t)).max(0.0).sqrt() * 1.6;
        [
            x - s * half * around.sin(),
            y + s * half * around.cos(),
            z - 0.45 * half,
        ]
    };
    for i in 0..n_parts {
        let (t, u) = (i as f32 / n_parts as f32, (i + 1) as f32 / n_parts as f32);
        for s in [1.0f32, -1.0] {
            let corners = [along(t), along(u), side(u, s), side(t, s)];
            let kept: Vec<[f32; 3]> = if i == 0 {
                corners[..3].to_vec()
            } else {
                corners.to_vec()
            };
            let above: Vec<[f32; 3]> = if s > 0.0 {
                kept.clone()
            } else {
                kept.iter().rev().copied().collect()
            };
            let below: Vec<[f32; 3]> = above.iter().rev().copied().collect();
            let uv = vec![[0.0; 2]; kept.len()];
            builder.polygon(foliage([96, 122, 58], k), &above, &uv);
            builder.polygon(foliage([96, 122, 58], 0.6 * k), &below, &uv);
        }
    }
}

/// A clipped bush, 0.9 m high.
pub fn bush() -> Mesh {
    let mut random = Random::new(TREE, 300, 0);
    let mut builder = MeshBuilder::new("bush");
    let clumps = [Clump {
        middle: [0.0, 0.0, 0.42],
        half: [0.55, 0.55, 0.48],
    }];
    let covers = [
        (
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 6,
                    is_whole: true,
                },
                inside: (0.92, 0.7),
                sprays: (44, 0.34),
            },
            20.0,
        ),
        (
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 4,
                    is_whole: true,
                },
                inside: (1.05, 0.95),
                sprays: (3, 0.5),
            },
            60.0,
        ),
        (
            Cover {
                hull: Globe {
                    n_rings: 2,
                    n_around: 3,
                    is_whole: false,
                },
                inside: (1.15, 1.0),
                sprays: (0, 0.0),
            },
            160.0,
        ),
    ];
    for (cover, until_m) in covers {
        crown(&mut builder, &clumps, cover, [74, 106, 48], &mut random);
        builder.end_level(until_m);
    }
    builder.finish()
}
