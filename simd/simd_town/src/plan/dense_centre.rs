//! Plan of the dense centre: an irregular grid inside a ring.

use super::layout::{AVENUE, Houses, Plan, Profile, RING, SIGNED_FROM_M, STREET, Street};
use crate::geometry::{Bend, P2, left};
use crate::random::Random;

const COLUMNS_M: [f64; 6] = [-205.0, -128.0, -48.0, 38.0, 122.0, 205.0];
const ROWS_M: [f64; 6] = [-200.0, -120.0, -38.0, 44.0, 126.0, 200.0];
/// Grid edges that are left out: (column, row) of the first node, and whether it runs along x.
const LEFT_OUT: [(usize, usize, bool); 5] = [
    (1, 1, false),
    (3, 1, true),
    (3, 4, true),
    (1, 4, true),
    (4, 2, false),
];
/// Grid edges that bow: the edge as in `LEFT_OUT`, and by how many metres its middle lies to the
/// left.
const BOWED: [(usize, usize, bool, f64); 5] = [
    (1, 2, true, 7.0),
    (4, 1, false, -8.0),
    (3, 4, false, 6.0),
    (0, 3, false, 9.0),
    (3, 0, true, -9.0),
];

/// The dense centre: an irregular grid inside a ring with rounded corners, two avenues crossing.
pub fn dense_centre(name: &str, seed: u64) -> Plan {
    let mut random = Random::new(seed, 0x70, 0);
    let n = COLUMNS_M.len();
    let grid: Vec<P2> = (0..n * n)
        .map(|i| {
            let (c, r) = (i % n, i / n);
            let (jx, jy) = (random.between(-6.0, 6.0), random.between(-6.0, 6.0));
            let inner = |k: usize| k > 0 && k + 1 < n;
            P2::new(
                COLUMNS_M[c] + if inner(c) { jx } else { 0.0 },
                ROWS_M[r] + if inner(r) { jy } else { 0.0 },
            )
        })
        .collect();
    let is_corner =
        |i: usize| (i.is_multiple_of(n) || i % n == n - 1) && (i / n == 0 || i / n == n - 1);
    let (mut nodes_m, mut node_of) = (Vec::new(), vec![usize::MAX; n * n]);
    for i in (0..n * n).filter(|&i| !is_corner(i)) {
        node_of[i] = nodes_m.len();
        nodes_m.push(grid[i]);
    }
    let mut streets = Vec::new();
    for i in 0..n * n {
        for along_x in [true, false] {
            let (c, r) = (i % n, i / n);
            if (along_x && c + 1 == n)
                || (!along_x && r + 1 == n)
                || LEFT_OUT.contains(&(c, r, along_x))
            {
                continue;
            }
            let j = if along_x { i + 1 } else { i + n };
            if !is_corner(i) && !is_corner(j) {
                let bends = bow(&grid, i, j, along_x, n);
                streets.push(Street::new(
                    node_of[i],
                    node_of[j],
                    bends,
                    profile(c, r, along_x, n),
                ));
            }
        }
    }
    for (corner, a, b) in [
        (0, 1, n),
        (n - 1, n - 2, 2 * n - 1),
        (n * (n - 1), n * (n - 2), n * (n - 1) + 1),
        (n * n - 1, n * n - 2, n * (n - 1) - 1),
    ] {
        let bends = vec![Bend {
            corner_m: grid[corner],
            radius_m: 34.0,
        }];
        streets.push(Street::new(node_of[a], node_of[b], bends, RING));
    }
    let middle = |i: usize, j: usize| 0.5 * (grid[i] + grid[j]);
    let parks_m = vec![middle(4 + 2 * n, 4 + 3 * n)];
    let heights_m = vec![0.0; nodes_m.len()];
    Plan {
        name: name.to_owned(),
        lat_lon_deg: (48.137, 11.575),
        nodes_m,
        heights_m,
        hills_m: 0.0,
        streets,
        ponds_m: Vec::new(),
        parks_m,
        all_lights: true,
        houses: Houses::Towers { within_m: 150.0 },
        cottages_m: Vec::new(),
        green_courts: false,
        limits_from_m: SIGNED_FROM_M,
    }
}

fn profile(c: usize, r: usize, along_x: bool, n: usize) -> Profile {
    if (along_x && (r == 0 || r + 1 == n)) || (!along_x && (c == 0 || c + 1 == n)) {
        RING
    } else if (along_x && r == 3) || (!along_x && c == 2) {
        AVENUE
    } else {
        STREET
    }
}

fn bow(grid: &[P2], i: usize, j: usize, along_x: bool, n: usize) -> Vec<Bend> {
    let Some(&(.., aside_m)) = BOWED
        .iter()
        .find(|b| (b.0, b.1, b.2) == (i % n, i / n, along_x))
    else {
        return Vec::new();
    };
    let middle = 0.5 * (grid[i] + grid[j]);
    let across = left((grid[j] - grid[i]).normalize());
    vec![Bend {
        corner_m: middle + across * aside_m,
        radius_m: 55.0,
    }]
}
