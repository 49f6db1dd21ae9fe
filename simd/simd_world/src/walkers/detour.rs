//! Round what stands in the way: vehicles as upright boxes, seen from above.

use nalgebra::{Isometry2, Point2, Vector2};

/// Distance that whoever goes round a vehicle keeps from it, metres.
const ROOM_M: f64 = 0.3;
/// Nearer than this is in the way, metres: less than the above, so that the way round is not.
const TOUCH_M: f64 = 0.15;
/// A vehicle farther ahead than this is no matter yet, metres.
const AHEAD_M: f64 = 4.0;
/// A moving vehicle is given way to when it is as near as this, metres.
const YIELD_M: f64 = 1.5;

/// A vehicle on the ground.
#[derive(Clone, Copy, Debug)]
pub(super) struct Obstacle {
    pub world_from_box: Isometry2<f64>,
    pub half_m: Vector2<f64>,
    pub moves: bool,
}

/// What to do about the vehicles near by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    /// Straight on.
    Ahead,
    /// To this place first.
    Via(Vector2<f64>),
    /// Stand until the way is free.
    Wait,
    /// The place that is walked to lies under a vehicle.
    Taken,
}

impl Obstacle {
    fn local(&self, p: Vector2<f64>) -> Vector2<f64> {
        self.world_from_box.inverse_transform_point(&Point2::from(p)).coords
    }

    fn world(&self, p: Vector2<f64>) -> Vector2<f64> {
        (self.world_from_box * Point2::from(p)).coords
    }

    /// Whether a point is less than `room_m` from the box.
    fn holds(&self, p: Vector2<f64>, room_m: f64) -> bool {
        let local = self.local(p);
        (0..2).all(|i| local[i].abs() < self.half_m[i] + room_m)
    }

    /// Share of the way from `a` to `b` at which it comes within `room_m` of the box.
    fn entry(&self, a: Vector2<f64>, b: Vector2<f64>, room_m: f64) -> Option<f64> {
        let (from, way) = (self.local(a), self.local(b) - self.local(a));
        let (mut enters, mut leaves) = (0.0f64, 1.0f64);
        for i in 0..2 {
            let half = self.half_m[i] + room_m;
            if way[i].abs() < 1e-9 {
                if from[i].abs() >= half {
                    return None;
                }
                continue;
            }
            let (low, high) = ((-half - from[i]) / way[i], (half - from[i]) / way[i]);
            (enters, leaves) = (enters.max(low.min(high)), leaves.min(low.max(high)));
        }
        (enters < leaves - 1e-9).then_some(enters)
    }

    /// The nearest place outside, from a place within `room_m`.
    fn way_out(&self, p: Vector2<f64>, room_m: f64) -> Vector2<f64> {
        let local = self.local(p);
        let depth = |i: usize| self.half_m[i] + room_m - local[i].abs();
        let axis = usize::from(depth(1) < depth(0));
        let mut out = local;
        out[axis] = (self.half_m[axis] + room_m) * if local[axis] < 0.0 { -1.0 } else { 1.0 };
        self.world(out)
    }

    /// Corners at `room_m`, round the box.
    fn corners(&self, room_m: f64) -> [Vector2<f64>; 4] {
        let half = self.half_m.add_scalar(room_m);
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(|(x, y)| self.world(Vector2::new(x * half.x, y * half.y)))
    }
}

/// The next step of somebody of this radius from `at` to `to`.
pub(super) fn step(at: Vector2<f64>, to: Vector2<f64>, radius_m: f64, obstacles: &[Obstacle]) -> Step {
    let (touch_m, room_m) = (radius_m + TOUCH_M, radius_m + ROOM_M);
    let length = (to - at).norm();
    if let Some(over) = obstacles.iter().find(|each| !each.moves && each.holds(at, touch_m)) {
        return Step::Via(over.way_out(at, room_m + 0.1));
    }
    let blocking = |each: &&Obstacle| each.entry(at, to, touch_m).map(|share| share * length);
    let near = |each: &Obstacle| blocking(&each).filter(|away| *away < if each.moves { YIELD_M } else { AHEAD_M });
    let first = obstacles.iter().filter_map(|each| near(each).map(|away| (away, each))).min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, obstacle)) = first else { return Step::Ahead };
    if obstacle.moves {
        return Step::Wait;
    }
    if obstacle.holds(to, room_m) {
        return Step::Taken;
    }
    let corners = obstacle.corners(room_m);
    let is_free = |a, b| obstacle.entry(a, b, touch_m).is_none();
    let others_leave = |b| obstacles.iter().all(|each| each.entry(at, b, touch_m).is_none());
    let mut best: Option<(f64, Vector2<f64>)> = None;
    let mut offer = |via: &[Vector2<f64>]| {
        let mut stops = vec![at];
        stops.extend(via);
        stops.push(to);
        let clear = stops.windows(2).all(|pair| is_free(pair[0], pair[1])) && others_leave(via[0]);
        let long = stops.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        if clear && best.is_none_or(|(known, _)| long < known) {
            best = Some((long, via[0]));
        }
    };
    for i in 0..4 {
        offer(&[corners[i]]);
        offer(&[corners[i], corners[(i + 1) % 4]]);
        offer(&[corners[i], corners[(i + 3) % 4]]);
    }
    best.map_or(Step::Wait, |(_, via)| Step::Via(via))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADIUS_M: f64 = 0.3;

    fn car(x: f64, y: f64, yaw_rad: f64) -> Obstacle {
        Obstacle { world_from_box: Isometry2::new(Vector2::new(x, y), yaw_rad), half_m: Vector2::new(2.4, 1.0), moves: false }
    }

    /// Walks in steps of 5 cm; the way gone, and how near it came to any box.
    fn walk(from: [f64; 2], to: [f64; 2], obstacles: &[Obstacle]) -> (f64, f64) {
        let (mut at, to) = (Vector2::from(from), Vector2::from(to));
        let (mut gone, mut nearest) = (0.0, f64::INFINITY);
        while (to - at).norm() > 0.1 {
            let target = match step(at, to, RADIUS_M, obstacles) {
                Step::Ahead => to,
                Step::Via(place) => place,
                other => panic!("{other:?} at {at}"),
            };
            let way = target - at;
            at += way.normalize() * way.norm().min(0.05);
            gone += 0.05;
            for each in obstacles {
                let local = each.local(at).abs() - each.half_m;
                nearest = nearest.min(local.x.max(0.0).hypot(local.y.max(0.0)));
            }
            assert!(gone < 60.0, "goes in circles at {at}");
        }
        (gone, nearest)
    }

    #[test]
    fn the_way_round_is_the_shorter_one_and_touches_nothing() {
        // Across the middle of a car's side, a little off: round its nearer end. By Pythagoras the shortest way is 11.6 m.
        for yaw in [0.0, 0.4, 1.2] {
            let turn = Isometry2::new(Vector2::zeros(), yaw);
            let world = |x: f64, y: f64| <[f64; 2]>::from((turn * Point2::new(x, y)).coords);
            let (gone, nearest) = walk(world(0.5, -5.0), world(0.5, 5.0), &[car(0.0, 0.0, yaw)]);
            let room = RADIUS_M + ROOM_M;
            let corner = Vector2::new(2.4 + room, 1.0 + room);
            let shortest = 2.0 * ((corner.x - 0.5).hypot(5.0 - corner.y) + corner.y);
            assert!((gone - shortest).abs() < 0.8 && nearest > RADIUS_M, "{yaw}: {gone} m instead of {shortest}, {nearest}");
        }
    }

    #[test]
    fn between_two_cars_one_goes_round_both_and_from_under_one_out() {
        let (_, nearest) = walk([0.0, -5.0], [0.0, 5.0], &[car(0.0, 0.0, 0.0), car(0.2, 2.8, 0.1)]);
        assert!(nearest > RADIUS_M - 0.01, "{nearest}");
        let (gone, _) = walk([0.5, 0.9], [6.0, 0.9], &[car(0.0, 0.0, 0.0)]);
        assert!(gone < 8.0, "{gone}");
    }

    #[test]
    fn moving_vehicles_are_waited_for_and_places_under_cars_are_given_up() {
        let moving = Obstacle { moves: true, ..car(0.0, 0.0, 0.0) };
        let at = |y: f64| Vector2::new(0.0, y);
        assert_eq!(step(at(-2.0), at(5.0), RADIUS_M, &[moving]), Step::Wait);
        assert_eq!(step(at(-5.0), at(5.0), RADIUS_M, &[moving]), Step::Ahead);
        assert_eq!(step(at(-2.5), at(0.2), RADIUS_M, &[car(0.0, 0.0, 0.0)]), Step::Taken);
        assert_eq!(step(at(-5.0), at(-2.0), RADIUS_M, &[car(0.0, 0.0, 0.0)]), Step::Ahead);
    }
}
