//! Ways around vehicles, which count as upright boxes seen from above.

use nalgebra::{Isometry2, Point2, Vector2};

/// Distance that a walker keeps from a vehicle that it goes around, metres.
const ROOM_M: f64 = 0.3;
/// A vehicle is in the way if it is nearer to the line of walk than this, metres. It is less than
/// `ROOM_M`, so that the way around the vehicle is free.
const TOUCH_M: f64 = 0.15;
/// A standing vehicle is gone round once it is nearer ahead than this, metres.
const AHEAD_M: f64 = 4.0;
/// A walker waits for a moving vehicle that is as near as this, metres.
const YIELD_M: f64 = 1.5;

/// A vehicle's outline on the ground.
#[derive(Clone, Copy, Debug)]
pub struct Obstacle {
    /// Middle and heading of its box.
    pub world_from_box: Isometry2<f64>,
    /// Half length and half width, metres.
    pub half_m: Vector2<f64>,
    /// Whether it drives: then it is waited for instead of gone round.
    pub moves: bool,
}

/// What to do about the vehicles near by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Straight on.
    Ahead,
    /// Walk to this place first.
    Via(Vector2<f64>),
    /// Stand still until the way is free.
    Wait,
    /// The destination lies under a vehicle.
    Taken,
}

impl Obstacle {
    fn local(&self, p: Vector2<f64>) -> Vector2<f64> {
        self.world_from_box
            .inverse_transform_point(&Point2::from(p))
            .coords
    }

    fn world(&self, p: Vector2<f64>) -> Vector2<f64> {
        (self.world_from_box * Point2::from(p)).coords
    }

    /// Whether a point is less than `room_m` from the box.
    fn holds(&self, p: Vector2<f64>, room_m: f64) -> bool {
        let local = self.local(p);
        (0..2).all(|i| local[i].abs() < self.half_m[i] + room_m)
    }

    /// Share of the line from `a` to `b` at which it comes within `room_m` of the box.
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

    /// The nearest walkable place outside the box, for somebody within `room_m` of it; if no place
    /// outside is walkable, the nearest of all.
    fn way_out(
        &self,
        p: Vector2<f64>,
        room_m: f64,
        is_walkable: &impl Fn(Vector2<f64>) -> bool,
    ) -> Vector2<f64> {
        let local = self.local(p);
        let mut ways: Vec<(f64, Vector2<f64>)> = [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)]
            .map(|(axis, sign)| {
                let mut out = local;
                out[axis] = (self.half_m[axis] + room_m) * sign;
                ((out - local).norm(), self.world(out))
            })
            .into();
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        ways.iter()
            .find(|(_, out)| is_walkable(*out))
            .unwrap_or(&ways[0])
            .1
    }

    /// Corners of the box grown by `room_m`.
    fn corners(&self, room_m: f64) -> [Vector2<f64>; 4] {
        let half = self.half_m.add_scalar(room_m);
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| self.world(Vector2::new(x * half.x, y * half.y)))
    }
}

/// Distance between the points of a line at which the ground is tested, metres.
const PROBE_M: f64 = 0.25;

/// Whether a straight line stays on walkable ground once it has reached it: somebody who was pushed
/// off the ground may come back. The end counts as walkable.
pub fn is_on_ground(
    at: Vector2<f64>,
    to: Vector2<f64>,
    is_walkable: &impl Fn(Vector2<f64>) -> bool,
) -> bool {
    let n = ((to - at).norm() / PROBE_M).ceil() as usize;
    let mut places = (0..n).map(|k| is_walkable(at + (to - at) * (k as f64 / n as f64)));
    places.find(|is_walkable| *is_walkable);
    places.all(|is_walkable| is_walkable)
}

/// The next step from `at` to `to` for a walker of this radius, over walkable ground.
pub fn step(
    at: Vector2<f64>,
    to: Vector2<f64>,
    radius_m: f64,
    obstacles: &[Obstacle],
    is_walkable: &impl Fn(Vector2<f64>) -> bool,
) -> Step {
    let (touch_m, room_m) = (radius_m + TOUCH_M, radius_m + ROOM_M);
    let length = (to - at).norm();
    if let Some(over) = obstacles
        .iter()
        .find(|each| !each.moves && each.holds(at, touch_m))
    {
        return Step::Via(over.way_out(at, room_m + 0.1, is_walkable));
    }
    let blocking = |each: &&Obstacle| each.entry(at, to, touch_m).map(|share| share * length);
    let near = |each: &Obstacle| {
        blocking(&each).filter(|away| *away < if each.moves { YIELD_M } else { AHEAD_M })
    };
    let first = obstacles
        .iter()
        .filter_map(|each| near(each).map(|away| (away, each)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, obstacle)) = first else {
        return Step::Ahead;
    };
    if obstacle.moves {
        return Step::Wait;
    }
    if obstacle.holds(to, room_m) {
        return Step::Taken;
    }
    let corners = obstacle.corners(room_m);
    let is_free = |a, b| obstacle.entry(a, b, touch_m).is_none();
    let others_leave = |b| {
        obstacles
            .iter()
            .all(|each| each.entry(at, b, touch_m).is_none())
    };
    let mut best: Option<(f64, Vector2<f64>)> = None;
    let mut offer = |via: &[Vector2<f64>]| {
        let mut stops = vec![at];
        stops.extend(via);
        stops.push(to);
        let clear = stops.windows(2).all(|pair| is_free(pair[0], pair[1])) && others_leave(via[0]);
        let clear = clear
            && via.iter().all(|place| is_walkable(*place))
            && stops
                .windows(2)
                .all(|pair| is_on_ground(pair[0], pair[1], is_walkable));
        let long = stops
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).norm())
            .sum();
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
        Obstacle {
            world_from_box: Isometry2::new(Vector2::new(x, y), yaw_rad),
            half_m: Vector2::new(2.4, 1.0),
            moves: false,
        }
    }

    fn everywhere(_: Vector2<f64>) -> bool {
        true
    }

    /// Walks in steps of 5 cm; returns the length of the way and the smallest distance to any box.
    fn walk(from: [f64; 2], to: [f64; 2], obstacles: &[Obstacle]) -> (f64, f64) {
        let (mut at, to) = (Vector2::from(from), Vector2::from(to));
        let (mut gone, mut nearest) = (0.0, f64::INFINITY);
        while (to - at).norm() > 0.1 {
            let target = match step(at, to, RADIUS_M, obstacles, &everywhere) {
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
        // The way crosses the middle of a car's side, a little off centre, so it must go around the
        // nearer end. By Pythagoras the shortest way is 11.6 m.
        for yaw in [0.0, 0.4, 1.2] {
            let turn = Isometry2::new(Vector2::zeros(), yaw);
            let world = |x: f64, y: f64| <[f64; 2]>::from((turn * Point2::new(x, y)).coords);
            let (gone, nearest) = walk(world(0.5, -5.0), world(0.5, 5.0), &[car(0.0, 0.0, yaw)]);
            let room = RADIUS_M + ROOM_M;
            let corner = Vector2::new(2.4 + room, 1.0 + room);
            let shortest = 2.0 * ((corner.x - 0.5).hypot(5.0 - corner.y) + corner.y);
            assert!(
                (gone - shortest).abs() < 0.8 && nearest > RADIUS_M,
                "{yaw}: {gone} m instead of {shortest}, {nearest}"
            );
        }
    }

    #[test]
    fn between_two_cars_one_goes_round_both_and_from_under_one_out() {
        let (_, nearest) = walk(
            [0.0, -5.0],
            [0.0, 5.0],
            &[car(0.0, 0.0, 0.0), car(0.2, 2.8, 0.1)],
        );
        assert!(nearest > RADIUS_M - 0.01, "{nearest}");
        let (gone, _) = walk([0.5, 0.9], [6.0, 0.9], &[car(0.0, 0.0, 0.0)]);
        assert!(gone < 8.0, "{gone}");
    }

    #[test]
    fn moving_vehicles_are_waited_for_and_places_under_cars_are_given_up() {
        let moving = Obstacle {
            moves: true,
            ..car(0.0, 0.0, 0.0)
        };
        let at = |y: f64| Vector2::new(0.0, y);
        assert_eq!(
            step(at(-2.0), at(5.0), RADIUS_M, &[moving], &everywhere),
            Step::Wait
        );
        assert_eq!(
            step(at(-5.0), at(5.0), RADIUS_M, &[moving], &everywhere),
            Step::Ahead
        );
        assert_eq!(
            step(
                at(-2.5),
                at(0.2),
                RADIUS_M,
                &[car(0.0, 0.0, 0.0)],
                &everywhere
            ),
            Step::Taken
        );
        assert_eq!(
            step(
                at(-5.0),
                at(-2.0),
                RADIUS_M,
                &[car(0.0, 0.0, 0.0)],
                &everywhere
            ),
            Step::Ahead
        );
    }

    #[test]
    fn the_way_round_stays_on_the_ground_that_may_be_walked_on() {
        // A car stands across a pavement from y = -3 to y = 1.2; the shorter way around it would be
        // on the road beyond.
        let pavement = |p: Vector2<f64>| (-3.0..1.2).contains(&p.y);
        let at = Vector2::new(-5.0, 0.3);
        let car = [Obstacle {
            half_m: Vector2::new(1.0, 1.0),
            ..car(0.0, 0.2, 0.0)
        }];
        let Step::Via(place) = step(at, Vector2::new(5.0, 0.3), RADIUS_M, &car, &everywhere) else {
            panic!("no way round")
        };
        assert!(place.y > 1.2, "{place}");
        let Step::Via(place) = step(at, Vector2::new(5.0, 0.3), RADIUS_M, &car, &pavement) else {
            panic!("no way round")
        };
        assert!(
            (place.y - (0.2 - 1.0 - RADIUS_M - ROOM_M)).abs() < 1e-9,
            "{place}"
        );
        // A narrow pavement has no way around the car; somebody under the car leaves it towards
        // where the pavement goes on.
        let narrow = |p: Vector2<f64>| (-0.5..1.2).contains(&p.y);
        assert_eq!(
            step(at, Vector2::new(5.0, 0.3), RADIUS_M, &car, &narrow),
            Step::Wait
        );
        let Step::Via(place) = step(
            Vector2::new(0.3, 0.9),
            Vector2::new(5.0, 0.3),
            RADIUS_M,
            &car,
            &narrow,
        ) else {
            panic!("stuck")
        };
        assert!(place.x > 1.0 && narrow(place), "{place}");
    }

    #[test]
    fn who_was_pushed_off_the_ground_may_come_back_and_others_may_not_leave_it() {
        let ground = |p: Vector2<f64>| p.y < 0.0;
        let at = |y: f64| Vector2::new(0.0, y);
        assert!(
            is_on_ground(at(1.0), at(-4.0), &ground) && is_on_ground(at(-1.0), at(-4.0), &ground)
        );
        assert!(!is_on_ground(at(-1.0), at(4.0), &ground));
        assert!(!is_on_ground(
            Vector2::new(-2.0, -1.0),
            Vector2::new(2.0, -1.0),
            &|p: Vector2<f64>| p.x.abs() > 0.5
        ));
    }
}
