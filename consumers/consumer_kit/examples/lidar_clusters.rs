//! Finds what stands on the road: drops the ground from a lidar's points, joins the rest to
//! clusters, and publishes a box round each. One step per tick, in lockstep.
//!
//! `cargo run --release -p consumer_kit --example lidar_clusters`; `docs/how-to/pipelines.md` explains it.

use std::collections::{HashMap, HashSet};
use std::error::Error;
use std::time::Duration;

use consumer_kit::{Follower, Publisher, Steps, Take};
use schema_bus::names::default_domain;
use schema_frames::{Box3d, LidarPoint};
use schema_types::{Class, Pose};

/// Height of the lidar above the road, metres, as the launch file mounts it.
const LIDAR_HEIGHT_M: f32 = 2.0;
/// Points lower than this above the road are ground, metres.
const GROUND_M: f32 = 0.25;
/// Points higher than this above the road are bridges and leaves, metres.
const CEILING_M: f32 = 3.0;
/// Points in neighbouring cells of this size belong together, metres.
const CELL_M: f32 = 0.5;
/// Fewer points than this are noise.
const MIN_POINTS: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut follower = Follower::open(&default_domain(), "clusters")?;
    let lidar = follower.follow("ego/roof/lidar", Take::All);
    let boxes = Publisher::<Box3d>::open(follower.bus(), "clusters/boxes")?;
    let mut steps = Steps::join(&mut follower, "clusters", Duration::from_secs(60))?;
    // The simulator waits after every tick until this loop asks for the next one.
    while steps
        .next(follower.bus(), Duration::from_secs(60))?
        .is_some()
    {
        while let Some(turn) = follower.take(lidar)? {
            let points = turn.elements::<LidarPoint>().unwrap_or_default();
            boxes.send(&clusters(points), &[&turn])?;
        }
    }
    Ok(())
}

type Cell = (i32, i32);

/// Boxes round the clusters of points above the ground, in the lidar's space.
fn clusters(points: &[LidarPoint]) -> Vec<Box3d> {
    let mut cells: HashMap<Cell, Vec<[f32; 3]>> = HashMap::new();
    for point in points {
        let [x, y, z] = point.hit_in_sensor_m;
        if (GROUND_M..CEILING_M).contains(&(z + LIDAR_HEIGHT_M)) {
            let cell = ((x / CELL_M).floor() as i32, (y / CELL_M).floor() as i32);
            cells.entry(cell).or_default().push([x, y, z]);
        }
    }
    // In the order of cells, so that every run finds the clusters in the same order.
    let mut all: Vec<Cell> = cells.keys().copied().collect();
    all.sort_unstable();
    let mut seen = HashSet::new();
    let mut boxes = Vec::new();
    for start in all {
        let mut cluster = Vec::new();
        let mut open = vec![start];
        while let Some((x, y)) = open.pop() {
            let Some(points) = cells.get(&(x, y)).filter(|_| seen.insert((x, y))) else {
                continue;
            };
            cluster.extend_from_slice(points);
            open.extend((-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy))));
        }
        if cluster.len() >= MIN_POINTS {
            boxes.push(box_round(&cluster));
        }
    }
    boxes
}

fn box_round(points: &[[f32; 3]]) -> Box3d {
    let corner = |pick: fn(f32, f32) -> f32| {
        let first = points[0];
        points
            .iter()
            .fold(first, |a, b| [0, 1, 2].map(|i| pick(a[i], b[i])))
    };
    let (low, high) = (corner(f32::min), corner(f32::max));
    Box3d {
        pose: Pose {
            translation_m: [0, 1, 2].map(|i| f64::from(low[i] + high[i]) / 2.0),
            ..Pose::IDENTITY
        },
        half_m: [0, 1, 2].map(|i| (high[i] - low[i]) / 2.0),
        velocity_mps: [f32::NAN; 3],
        score: 1.0,
        class: u32::from(Class::OTHER.0),
        n_points: points.len() as u32,
        id: 0,
        reserved: [0; 2],
    }
}
