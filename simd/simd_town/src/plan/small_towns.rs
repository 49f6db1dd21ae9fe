//! Plans of the towns whose streets are drawn by hand.

use super::layout::{AVENUE, HIGHWAY, Houses, Plan, STREET};
use super::sketch::{BOULEVARD, COUNTRY, ELEVATED, HIGH_STREET, LANE, Sketch};
use crate::geometry::{P2, left, unit, wrap};

/// Town01: a small town in which every junction is a T.
pub fn small_town(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x101, (49.02, 8.41), Houses::Cottages);
    let (w, h) = (195.0, 155.0);
    let below = s.moved([-112.0, 18.0, 122.0], 4.0);
    let above = s.moved([-52.0, 72.0], 4.0);
    let [high, low, upper] = s.moved([8.0, -72.0, 84.0], 4.0);
    let south = below.map(|x| s.node(x, -h));
    let north = above.map(|x| s.node(x, h));
    let west = [high, upper].map(|y| s.node(-w, y));
    let east = [low, high, upper].map(|y| s.node(w, y));
    let middle_below = below.map(|x| s.node(x, high));
    let middle_above = above.map(|x| s.node(x, high));
    let cross_low = below.map(|x| s.node(x, low));
    let cross_upper = above.map(|x| s.node(x, upper));
    let [b0, b1, b2] = middle_below;
    let [a0, a1] = middle_above;
    s.chain(&[west[0], b0, a0, b1, a1, b2, east[1]], HIGH_STREET);
    for i in 0..3 {
        s.chain(&[south[i], cross_low[i], middle_below[i]], LANE);
    }
    for i in 0..2 {
        s.chain(&[middle_above[i], cross_upper[i], north[i]], LANE);
    }
    s.chain(&[cross_low[0], cross_low[1]], STREET);
    s.chain(&[cross_low[2], east[0]], LANE);
    s.chain(&[west[1], cross_upper[0]], LANE);
    s.chain(&[cross_upper[1], east[2]], STREET);
    s.chain(&south, LANE);
    s.chain(&north, LANE);
    s.chain(&west, LANE);
    s.chain(&east, LANE);
    s.street(west[0], south[0], &[(-w, -h, 30.0)], LANE);
    s.street(south[2], east[0], &[(w, -h, 30.0)], LANE);
    s.street(east[2], north[1], &[(w, h, 30.0)], LANE);
    s.street(north[0], west[1], &[(-w, h, 30.0)], LANE);
    s.plan.parks_m = vec![P2::new(-20.0, 40.0)];
    s.plan.ponds_m = vec![(P2::new(14.0, 46.0), 13.0)];
    s.plan
}

/// Town02: compact, short blocks, narrow streets, one lane each way.
pub fn compact(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x102, (47.66, 9.18), Houses::Terraces);
    let (w, h) = (135.0, 128.0);
    let xs = s.moved([-62.0, 4.0, 70.0], 3.0);
    let ys = s.moved([-62.0, 0.0, 62.0], 3.0);
    let south = xs.map(|x| s.node(x, -h));
    let north = xs.map(|x| s.node(x, h));
    let west = ys.map(|y| s.node(-w, y));
    let east = ys.map(|y| s.node(w, y));
    let inner = ys.map(|y| xs.map(|x| s.node(x, y)));
    for r in 0..3 {
        let profile = [STREET, HIGH_STREET, LANE][r];
        s.chain(
            &[west[r], inner[r][0], inner[r][1], inner[r][2], east[r]],
            profile,
        );
    }
    for c in 0..3 {
        let profile = [LANE, HIGH_STREET, STREET][c];
        s.chain(
            &[south[c], inner[0][c], inner[1][c], inner[2][c], north[c]],
            profile,
        );
    }
    for side in [south, north, west, east] {
        s.chain(&side, LANE);
    }
    s.street(west[0], south[0], &[(-w, -h, 24.0)], LANE);
    s.street(south[2], east[0], &[(w, -h, 24.0)], LANE);
    s.street(east[2], north[2], &[(w, h, 24.0)], LANE);
    s.street(north[0], west[2], &[(-w, h, 24.0)], LANE);
    s.plan.parks_m = vec![P2::new(36.0, 30.0)];
    s.plan
}

/// Town05: a grid of streets with several lanes, a wide ring round it.
pub fn multi_lane_grid(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(
        name,
        seed,
        0x105,
        (33.75, -84.39),
        Houses::Towers { within_m: 190.0 },
    );
    let (w, h) = (345.0, 240.0);
    let xs = s.moved([-190.0, -95.0, 5.0, 100.0, 195.0], 5.0);
    let ys = s.moved([-145.0, -52.0, 58.0, 150.0], 4.0);
    let south = xs.map(|x| s.node(x, -h));
    let north = xs.map(|x| s.node(x, h));
    let west = ys.map(|y| s.node(-w, y));
    let east = ys.map(|y| s.node(w, y));
    let inner = ys.map(|y| xs.map(|x| s.node(x, y)));
    for r in 0..4 {
        let mut row = vec![west[r]];
        row.extend(inner[r]);
        row.push(east[r]);
        s.chain(&row, if r == 2 { BOULEVARD } else { AVENUE });
    }
    for c in 0..5 {
        let mut column = vec![south[c]];
        column.extend(inner.iter().map(|row| row[c]));
        column.push(north[c]);
        s.chain(&column, [AVENUE, AVENUE, BOULEVARD, STREET, AVENUE][c]);
    }
    // The elevated road crosses the middle of the town over five streets.
    let over_y = 0.5 * (ys[1] + ys[2]);
    let ends = [-w, w].map(|x| s.node(x, over_y));
    s.street(ends[0], ends[1], &[], ELEVATED);
    s.bridge(
        (85.0, 2.0 * w - 85.0),
        &[(128.0 / (2.0 * w), 6.4), (1.0 - 128.0 / (2.0 * w), 6.4)],
    );
    for (side, end) in [(&west, ends[0]), (&east, ends[1])] {
        s.chain(&[side[0], side[1], end, side[2], side[3]], HIGHWAY);
    }
    for side in [&south[..], &north[..]] {
        s.chain(side, HIGHWAY);
    }
    s.street(west[0], south[0], &[(-w, -h, 60.0)], HIGHWAY);
    s.street(south[4], east[0], &[(w, -h, 60.0)], HIGHWAY);
    s.street(east[3], north[4], &[(w, h, 60.0)], HIGHWAY);
    s.street(north[0], west[3], &[(-w, h, 60.0)], HIGHWAY);
    s.plan.parks_m = vec![P2::new(-145.0, 0.0), P2::new(50.0, -190.0)];
    s.plan
}

/// Town07: country roads over hills, a village in the middle.
pub fn country(name: &str, seed: u64) -> Plan {
    let mut s = Sketch::new(name, seed, 0x107, (47.55, 10.71), Houses::Farms);
    const SQUARE: [(f64, f64); 6] = [
        (-52.0, -46.0),
        (4.0, -50.0),
        (58.0, -44.0),
        (60.0, 48.0),
        (2.0, 52.0),
        (-56.0, 46.0),
    ];
    let square = SQUARE.map(|(x, y)| s.node(x, y));
    let mut at: Vec<(f64, f64)> = Vec::new();
    for (i, (x, y)) in SQUARE.into_iter().enumerate() {
        let away = [318.0, 262.0, 300.0, 330.0, 285.0, 305.0][i] + s.random.between(-10.0, 10.0);
        at.push((y.atan2(x) + s.random.between(-0.06, 0.06), away));
    }
    let outer: Vec<usize> = at
        .iter()
        .map(|&(angle, away)| unit(angle) * away)
        .map(|p| s.node(p.x, p.y))
        .collect();
    for i in 0..6 {
        let (a, b) = (at[i], at[(i + 1) % 6]);
        let turn = wrap(b.0 - a.0);
        let bend = |share: f64, factor: f64| {
            unit(a.0 + share * turn) * ((a.1 + (b.1 - a.1) * share) * factor)
        };
        let (first, second) = (
            bend(0.36, [1.16, 0.98][i % 2]),
            bend(0.66, [0.97, 1.17][i % 2]),
        );
        s.street(
            outer[i],
            outer[(i + 1) % 6],
            &[(first.x, first.y, 80.0), (second.x, second.y, 80.0)],
            COUNTRY,
        );
        s.crest([3.0, -2.5, 2.0, 0.0][i % 4]);
        s.street(square[i], square[(i + 1) % 6], &[], HIGH_STREET);
    }
    s.street(square[1], square[4], &[], HIGH_STREET);
    // Winding roads from the village to the loop.
    for i in 0..6 {
        let (p, q) = (s.plan.nodes_m[square[i]], s.plan.nodes_m[outer[i]]);
        let across = left((q - p).normalize()) * [16.0, -14.0][i % 2];
        let (first, second) = (p + (q - p) * 0.36 + across, p + (q - p) * 0.68 - across);
        s.street(
            square[i],
            outer[i],
            &[(first.x, first.y, 70.0), (second.x, second.y, 70.0)],
            COUNTRY,
        );
        s.crest([2.0, -1.5][i % 2]);
    }
    let phases = [s.random.between(0.0, 6.0), s.random.between(0.0, 6.0)];
    for (p, height) in s.plan.nodes_m.iter().zip(&mut s.plan.heights_m) {
        let rolling = 4.0 * (p.x / 140.0 + phases[0]).sin() * (p.y / 160.0 + phases[1]).cos();
        *height = 5.0 + rolling * (p.norm() / 120.0).min(1.0);
    }
    s.plan.hills_m = 46.0;
    s.plan.ponds_m = vec![(P2::new(77.0, 151.0), 28.0)];
    s.plan
}

/// Town03: a hilly town about a large roundabout, and a tunnel.
pub fn roundabouts(name: &str, seed: u64) -> Plan {
    use std::f64::consts::{FRAC_PI_2, PI};
    let mut s = Sketch::new(
        name,
        seed,
        0x103,
        (45.76, 4.84),
        Houses::Towers { within_m: 0.0 },
    );
    let (w, h) = (270.0, 225.0);
    let xs = s.moved([-155.0, 0.0, 160.0], 4.0);
    let ys = s.moved([-120.0, 0.0, 122.0], 4.0);
    let [x1, y1] = [xs[1], ys[1]];
    let centre = s.roundabout(P2::new(x1, y1), 34.0, &[0.0, FRAC_PI_2, PI, -FRAC_PI_2]);
    let second = s.roundabout(P2::new(xs[2], y1), 27.0, &[0.0, FRAC_PI_2, PI, -FRAC_PI_2]);
    let south = xs.map(|x| s.node(x, -h));
    let north = xs.map(|x| s.node(x, h));
    let west = ys.map(|y| s.node(-w, y));
    let east = ys.map(|y| s.node(w, y));
    let low = xs.map(|x| s.node(x, ys[0]));
    let high = xs.map(|x| s.node(x, ys[2]));
    let middle_west = s.node(xs[0], y1);
    s.chain(&[west[1], middle_west, centre[2]], LANE);
    s.chain(&[centre[0], second[2]], LANE);
    s.chain(&[second[0], east[1]], LANE);
    s.chain(&[south[1], low[1], centre[3]], LANE);
    s.chain(&[centre[1], high[1], north[1]], LANE);
    s.chain(&[west[0], low[0], low[1], low[2], east[0]], HIGH_STREET);
    s.chain(&[west[2], high[0], high[1], high[2], east[2]], HIGH_STREET);
    s.chain(&[south[0], low[0], middle_west, high[0], north[0]], STREET);
    s.chain(&[south[2], low[2], second[3]], LANE);
    s.chain(&[second[1], high[2], north[2]], LANE);
    s.chain(&south, LANE);
    s.chain(&north, LANE);
    s.chain(&west, LANE);
    s.chain(&east, LANE);
    s.street(west[0], south[0], &[(-w, -h, 40.0)], LANE);
    s.street(south[2], east[0], &[(w, -h, 40.0)], LANE);
    s.street(east[2], north[2], &[(w, h, 40.0)], LANE);
    s.street(north[0], west[2], &[(-w, h, 40.0)], LANE);
    for street in s
        .plan
        .streets
        .iter_mut()
        .filter(|street| street.from == north[1])
    {
        street.tunnel = true;
    }
    for i in 0..s.plan.nodes_m.len() {
        // A roundabout is level.
        let p = if i < 4 {
            P2::new(x1, y1)
        } else if i < 8 {
            P2::new(xs[2], y1)
        } else {
            s.plan.nodes_m[i]
        };
        s.plan.heights_m[i] = 6.0 + 5.0 * (p.x / 150.0 + 0.6).sin() * (p.y / 140.0 - 0.4).cos();
    }
    s.plan.hills_m = 34.0;
    s.plan
}
