//! Plans of Town08, Town09 and Town15.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::layout::{AVENUE, Houses, Plan, Profile, RING, STREET};
use super::sketch::{HIGH_STREET, LANE, Sketch};
use crate::geometry::{P2, unit};

/// Adds a ring of streets through nodes on a circle about the origin; each bends in its middle.
fn ring(s: &mut Sketch, nodes: &[usize], headings: &[f64], radius_m: f64, profile: Profile) {
    for i in 0..nodes.len() {
        let k = (i + 1) % nodes.len();
        let half = 0.5 * (headings[k] - headings[i]).rem_euclid(TAU);
        let corner = unit(headings[i] + half) * (radius_m / half.cos());
        s.street(
            nodes[i],
            nodes[k],
            &[(corner.x, corner.y, 0.55 * radius_m)],
            profile,
        );
    }
}

/// Town08: an old town of rings and radial streets about a green.
pub fn rings(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x108, (51.34, 12.37), Houses::Terraces);
    const RADII_M: [f64; 4] = [74.0, 158.0, 246.0, 330.0];
    const N: usize = 7;
    let headings: Vec<f64> = (0..N)
        .map(|i| TAU * i as f64 / N as f64 + s.random.between(-0.06, 0.06))
        .collect();
    let at: Vec<Vec<usize>> = RADII_M
        .iter()
        .map(|radius_m| {
            headings
                .iter()
                .map(|h| {
                    let p = unit(*h) * *radius_m;
                    s.node(p.x, p.y)
                })
                .collect()
        })
        .collect();
    for (k, profile) in [HIGH_STREET, LANE, LANE, RING].into_iter().enumerate() {
        ring(&mut s, &at[k], &headings, RADII_M[k], profile);
    }
    for i in 0..N {
        let profile = [HIGH_STREET, STREET, LANE, STREET][i % 4];
        s.chain(&[at[0][i], at[1][i], at[2][i]], profile);
        // Every second radial street goes on to the ring road.
        if i % 2 == 0 {
            s.chain(&[at[2][i], at[3][i]], LANE);
        }
    }
    // Where no street arrives, the ring road passes without a junction.
    s.drop_passages();
    s.plan.parks_m = vec![P2::new(0.0, 0.0)];
    s.plan.green_courts = true;
    s.plan
}

/// Town09: a town on a slope, whose streets follow the slope in waves; an avenue below.
pub fn hillside(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x109, (43.32, -1.98), Houses::Cottages);
    let xs = s.moved([-390.0, -255.0, -128.0, 4.0, 130.0, 258.0, 392.0], 6.0);
    let ys = s.moved([-150.0, -52.0, 50.0, 152.0], 4.0);
    let wave = |x: f64, row: usize| 16.0 * (x / 150.0 + row as f64).sin();
    let rows: Vec<Vec<usize>> = (0..ys.len())
        .map(|r| xs.iter().map(|x| s.node(*x, ys[r] + wave(*x, r))).collect())
        .collect();
    for (r, row) in rows.iter().enumerate() {
        s.chain(row, [AVENUE, LANE, HIGH_STREET, LANE][r]);
    }
    for c in 0..xs.len() {
        for (below, pair) in rows.windows(2).enumerate() {
            let r = below + 1;
            // Stairs take the place of every third street up the slope.
            if (c + 2 * r) % 3 != 0 || c == 0 || c + 1 == xs.len() {
                s.chain(
                    &[pair[0][c], pair[1][c]],
                    if c % 2 == 0 { LANE } else { STREET },
                );
            }
        }
    }
    for (p, height) in s.plan.nodes_m.iter().zip(&mut s.plan.heights_m) {
        *height = 6.0 + 0.02 * p.y + 1.5 * (p.x / 190.0).sin();
    }
    s.drop_passages();
    s.plan.hills_m = 42.0;
    s.plan.parks_m = vec![P2::new(66.0, 0.0)];
    s.plan
}

/// Town15: a campus on a hill, three roundabouts in a row and winding roads round it.
pub fn campus(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(
        name,
        seed,
        0x115,
        (41.5, 2.11),
        Houses::Towers { within_m: 0.0 },
    );
    let four = [0.0, FRAC_PI_2, PI, -FRAC_PI_2];
    let centres = [(-205.0, 0.0), (0.0, 0.0), (210.0, 0.0)].map(|(x, y)| P2::new(x, y));
    let circles: Vec<Vec<usize>> = centres
        .iter()
        .map(|centre| s.roundabout(*centre, 30.0, &four))
        .collect();
    let (w, h) = (345.0, 210.0);
    s.chain(&[circles[0][0], circles[1][2]], LANE);
    s.chain(&[circles[1][0], circles[2][2]], LANE);
    let [west, east] = [-w, w].map(|x| s.node(x, 0.0));
    s.chain(&[west, circles[0][2]], LANE);
    s.chain(&[circles[2][0], east], LANE);
    let mut outer: Vec<Vec<usize>> = Vec::new();
    for (sign, arm) in [(1.0, 1), (-1.0, 3)] {
        let near: Vec<usize> = centres
            .iter()
            .map(|centre| s.node(centre.x, sign * 105.0))
            .collect();
        let far: Vec<usize> = centres
            .iter()
            .map(|centre| s.node(centre.x, sign * h))
            .collect();
        s.chain(&near, STREET);
        s.chain(&far, RING);
        for k in 0..3 {
            s.chain(&[circles[k][arm], near[k]], LANE);
            s.chain(&[near[k], far[k]], if k == 1 { HIGH_STREET } else { LANE });
        }
        outer.push(far);
    }
    for (sign, far) in [(1.0, &outer[0]), (-1.0, &outer[1])] {
        s.street(far[2], east, &[(w, sign * h, 60.0)], RING);
        s.street(west, far[0], &[(-w, sign * h, 60.0)], RING);
    }
    for i in 0..s.plan.nodes_m.len() {
        // A roundabout is level.
        let p = if i < 12 {
            centres[i / 4]
        } else {
            s.plan.nodes_m[i]
        };
        s.plan.heights_m[i] = 6.0 + 4.5 * (p.x / 170.0 + 0.4).sin() * (p.y / 130.0 + 0.9).cos();
    }
    s.plan.hills_m = 44.0;
    s.plan.green_courts = true;
    s.plan
}
