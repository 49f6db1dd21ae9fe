//! A wheel: tyre, rim and spokes, turned about y.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

/// A wheel about its own centre, axle along y, outer side towards −y.
pub fn wheel(class: Class, radius_m: f32, width_m: f32, spokes: usize) -> Mesh {
    let mut builder = MeshBuilder::new("wheel");
    level(&mut builder, class, radius_m, width_m, 20, spokes);
    builder.end_level(14.0);
    // Spokes of slim wheels are too thin to be seen from there.
    let far_spokes = if width_m < OPEN_WIDTH_M { 0 } else { spokes };
    level(&mut builder, class, radius_m, width_m, 10, far_spokes);
    builder.end_level(40.0);
    far(&mut builder, class, radius_m, width_m, true);
    builder.end_level(90.0);
    far(&mut builder, class, radius_m, width_m, false);
    builder.finish()
}

/// A hexagonal drum without inner side, or only its outer side.
fn far(builder: &mut MeshBuilder, class: Class, r: f32, width_m: f32, has_tread: bool) {
    let (half, tyre) = (
        0.5 * width_m,
        Surface::new(class, Material::Rubber, [30, 30, 32]),
    );
    let corner = |k: usize| {
        let a = std::f32::consts::TAU * k as f32 / 6.0;
        [r * a.cos(), r * a.sin()]
    };
    for k in 0..if has_tread { 6 } else { 0 } {
        let ([x0, z0], [x1, z1]) = (corner(k), corner(k + 1));
        builder.polygon(
            tyre,
            &[
                [x0, half, z0],
                [x0, -half, z0],
                [x1, -half, z1],
                [x1, half, z1],
            ],
            &[[0.0; 2]; 4],
        );
    }
    let face: Vec<[f32; 3]> = (0..6)
        .map(|k| [corner(k)[0], -half, corner(k)[1]])
        .collect();
    // Tyre, rim and the dark between spokes in one.
    builder.polygon(
        Surface::new(class, Material::Metal, [74, 75, 78]),
        &face,
        &[[0.0; 2]; 6],
    );
}

/// Widest wheel that is open between its spokes.
const OPEN_WIDTH_M: f32 = 0.16;

fn level(builder: &mut MeshBuilder, class: Class, r: f32, width_m: f32, n: usize, spokes: usize) {
    let half = 0.5 * width_m;
    let tyre = Surface::new(class, Material::Rubber, [26, 26, 28]);
    let rim = Surface::new(class, Material::Metal, [176, 178, 182]);
    let hole = Surface::new(class, Material::Rubber, [34, 34, 38]);
    // Wheels of two-wheelers are open between their spokes.
    let is_open = width_m < OPEN_WIDTH_M && spokes > 0;
    // (radius, y) of the turned profile from the inner side over the tread to the hub outside.
    let profile: [([f32; 2], Surface); 6] = [
        if is_open {
            ([r * 0.60, half * 0.9], rim)
        } else {
            ([0.0, half * 0.8], hole)
        },
        ([r * 0.66, half], tyre),
        ([r, half * 0.72], tyre),
        ([r, -half * 0.72], tyre),
        ([r * 0.68, -half], rim),
        (
            [r * 0.60, -half * 0.82],
            if spokes > 0 { hole } else { rim },
        ),
    ];
    let end = [0.0, -half * if spokes > 0 { 0.35 } else { 0.8 }];
    let n_rings = if is_open {
        profile.len() - 1
    } else {
        profile.len()
    };
    for k in 0..n {
        let angle = |k: usize| std::f32::consts::TAU * k as f32 / n as f32;
        let (a0, a1) = (angle(k), angle(k + 1));
        let at = |p: [f32; 2], a: f32| [p[0] * a.cos(), p[1], p[0] * a.sin()];
        for (i, &(p, surface)) in profile.iter().enumerate().take(n_rings) {
            let q = profile.get(i + 1).map_or(end, |next| next.0);
            // Counter-clockwise from outside; at the axle two corners coincide.
            let corners = [at(p, a0), at(p, a1), at(q, a1), at(q, a0)];
            let kept: Vec<[f32; 3]> = if p[0] == 0.0 {
                vec![corners[0], corners[2], corners[3]]
            } else if q[0] == 0.0 {
                vec![corners[0], corners[1], corners[2]]
            } else {
                corners.to_vec()
            };
            builder.polygon(surface, &kept, &vec![[0.0; 2]; kept.len()]);
        }
    }
    for k in 0..spokes {
        let a = std::f32::consts::TAU * k as f32 / spokes as f32;
        let (c, s) = (a.cos(), a.sin());
        let at = |along: f32, aside: f32, y: f32| [along * c - aside * s, y, along * s + aside * c];
        let (y0, y1) = (-half * 0.94, -half * 0.86);
        let quad = [
            at(r * 0.08, -r * 0.09, y0),
            at(r * 0.64, -r * 0.05, y1),
            at(r * 0.64, r * 0.05, y1),
            at(r * 0.08, r * 0.09, y0),
        ];
        builder.polygon(rim, &quad, &[[0.0; 2]; 4]);
        if is_open {
            let back = [quad[3], quad[2], quad[1], quad[0]].map(|[x, y, z]| [x, -y, z]);
            builder.polygon(rim, &back, &[[0.0; 2]; 4]);
        }
    }
    if spokes > 0 {
        let hub: Vec<[f32; 3]> = (0..8)
            .map(|k| {
                let a = std::f32::consts::TAU * k as f32 / 8.0;
                [r * 0.14 * a.cos(), -half * 0.95, r * 0.14 * a.sin()]
            })
            .collect();
        builder.polygon(rim, &hub, &[[0.0; 2]; 8]);
        if is_open {
            let back: Vec<[f32; 3]> = hub.iter().rev().map(|[x, y, z]| [*x, -y, *z]).collect();
            builder.polygon(rim, &back, &[[0.0; 2]; 8]);
            // The rim from within.
            for k in 0..n {
                let at = |k: usize, y: f32| {
                    let a = std::f32::consts::TAU * (k % n) as f32 / n as f32;
                    [r * 0.60 * a.cos(), y, r * 0.60 * a.sin()]
                };
                let (inner, outer) = (half * 0.9, -half * 0.82);
                builder.polygon(
                    rim,
                    &[
                        at(k, outer),
                        at(k + 1, outer),
                        at(k + 1, inner),
                        at(k, inner),
                    ],
                    &[[0.0; 2]; 4],
                );
            }
        }
    }
}
