//! Finds cars and people in a lidar's cloud without learning: drops the ground, joins points to
//! clusters, and keeps those of a size that fits. One of the benchmark's worked programs.
//!
//! `cargo run --release -p consumer_kit --example lidar_detector -- '{"height_m": 2.0}'`;
//! `docs/how-to/perception-benchmark.md` explains it.

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;

use consumer_kit::{Program, Take};
use schema_frames::{Box3d, LidarPoint};
use schema_types::Pose;

const CLASSES: [&str; 2] = ["car", "person"];
/// Half of the box of an ordinary car, metres: what a cluster shows of it is completed to this.
const CAR_HALF_M: [f64; 3] = [2.25, 0.92, 0.75];
/// Heights above the road between which points belong to objects, metres.
const GROUND_M: f32 = 0.3;
const CEILING_M: f32 = 2.6;
/// Points in neighbouring cells of this size belong together, metres.
const CELL_M: f32 = 0.4;
/// Fewer points than this are noise.
const MIN_POINTS: usize = 5;

#[derive(serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Settings {
    /// Height of the lidar above the road, metres.
    height_m: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { height_m: 2.0 }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut program = Program::open("lidar_detector", Take::Newest)?;
    let settings: Settings = program.params()?;
    let lidar = program.input("ego/roof/lidar");
    let boxes = program.output::<Box3d>("lidar_detector/boxes", &CLASSES)?;
    while let Some(frames) = program.next()? {
        let points = frames[lidar].elements::<LidarPoint>().unwrap_or_default();
        let found = clusters(points, settings.height_m);
        let found: Vec<Box3d> = found.iter().filter_map(|points| object(points)).collect();
        boxes.send(&found, &frames.all())?;
    }
    Ok(())
}

/// Groups of points above the ground.
fn clusters(points: &[LidarPoint], height_m: f32) -> Vec<Vec<[f64; 3]>> {
    let mut cells: BTreeMap<(i32, i32), Vec<[f64; 3]>> = BTreeMap::new();
    for [x, y, z] in points.iter().map(|point| point.hit_in_sensor_m) {
        if (GROUND_M..CEILING_M).contains(&(z + height_m)) {
            let cell = ((x / CELL_M).floor() as i32, (y / CELL_M).floor() as i32);
            cells
                .entry(cell)
                .or_default()
                .push([x, y, z].map(f64::from));
        }
    }
    let mut seen = BTreeSet::new();
    let mut groups = Vec::new();
    for start in cells.keys() {
        let (mut group, mut open) = (Vec::new(), vec![*start]);
        while let Some((x, y)) = open.pop() {
            let Some(points) = cells.get(&(x, y)).filter(|_| seen.insert((x, y))) else {
                continue;
            };
            group.extend_from_slice(points);
            open.extend((-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy))));
        }
        if group.len() >= MIN_POINTS {
            groups.push(group);
        }
    }
    groups
}

/// The box of a group whose size is that of a car or of a person.
fn object(points: &[[f64; 3]]) -> Option<Box3d> {
    let (low, high) = extent(points.iter().map(|point| point[2]));
    let (yaw, sides) = fitted(points);
    let [length, width] = sides.map(|(low, high)| high - low);
    let height = high - low;
    let person = length < 1.1 && width < 0.9 && (0.8..2.1).contains(&height);
    let car = (1.2..6.0).contains(&length) && width < 2.6 && (0.5..2.2).contains(&height);
    let mut half = [length / 2.0, width / 2.0, height / 2.0];
    let mut at = sides.map(|(low, high)| (low + high) / 2.0);
    if car && !person {
        // The lidar sees the near sides: what is missing lies behind them.
        for axis in 0..2 {
            let missing = (CAR_HALF_M[axis] - half[axis]).max(0.0);
            at[axis] += missing.copysign(at[axis]);
            half[axis] += missing;
        }
        half[2] = half[2].max(CAR_HALF_M[2]);
    }
    let (sin, cos) = yaw.sin_cos();
    let filled = (points.len() as f32 / 100.0).min(1.0);
    (car || person).then(|| Box3d {
        pose: Pose {
            translation_m: [
                cos * at[0] - sin * at[1],
                sin * at[0] + cos * at[1],
                high - half[2],
            ],
            rotation_xyzw: [0.0, 0.0, (yaw / 2.0).sin(), (yaw / 2.0).cos()],
        },
        half_m: half.map(|half| half as f32),
        velocity_mps: [f32::NAN; 3],
        score: 0.2 + 0.8 * filled,
        class: u32::from(person),
        n_points: points.len() as u32,
        id: 0,
        reserved: [0; 2],
    })
}

/// The direction along which a rectangle round the points lies closest to them, and its sides there:
/// the longer one first (Zhang et al. 2017, closeness).
fn fitted(points: &[[f64; 3]]) -> (f64, [(f64, f64); 2]) {
    let turned = |yaw: f64| {
        let (sin, cos) = yaw.sin_cos();
        let along = points.iter().map(move |[x, y, _]| cos * x + sin * y);
        let aside = points.iter().map(move |[x, y, _]| cos * y - sin * x);
        (along, aside)
    };
    let closeness = |yaw: f64| {
        let (along, aside) = turned(yaw);
        let (a, b) = (extent(along.clone()), extent(aside.clone()));
        let to_side = |value: f64, (low, high): (f64, f64)| (value - low).min(high - value);
        let near = along
            .zip(aside)
            .map(|(u, v)| to_side(u, a).min(to_side(v, b)).max(0.05));
        near.map(|distance| 1.0 / distance).sum::<f64>()
    };
    let yaws = (0..45).map(|step| f64::from(step) * 2.0_f64.to_radians());
    let best = yaws.max_by(|a, b| closeness(*a).total_cmp(&closeness(*b)));
    let yaw = best.unwrap_or_default();
    let (along, aside) = turned(yaw);
    let (along, aside) = (extent(along), extent(aside));
    // What cannot be told apart, front or rear, is taken to face as the lidar does.
    if along.1 - along.0 >= aside.1 - aside.0 {
        (yaw, [along, aside])
    } else {
        let turned = yaw - std::f64::consts::FRAC_PI_2;
        (turned, [(-aside.1, -aside.0), along])
    }
}

/// Smallest and largest value.
fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}
