//! Finds solid things that stand where vehicles drive: segments across and along every lane, held
//! against the triangles that vehicles run into.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use schema_roads::{LanePosition, RoadMap};
use simd_town::Town;

/// Heights over the lane, metres.
const HEIGHTS_M: [f64; 3] = [0.35, 0.9, 1.5];
/// Distance between two stations, metres.
const STEP_M: f64 = 1.0;
/// Share of the lane's half width that must be free.
const FREE: f64 = 0.9;
/// Side of the cells in which triangles are looked up, metres.
const CELL_M: f64 = 6.0;

type Triangle = [Point3<f64>; 3];

fn cell(p: [f64; 2]) -> (i32, i32) {
    (
        (p[0] / CELL_M).floor() as i32,
        (p[1] / CELL_M).floor() as i32,
    )
}

/// Names of the objects that stand in lanes, each with a place.
pub fn solids_in_lanes(town: &Town, roads: &RoadMap) -> Vec<String> {
    let mut triangles: Vec<(Triangle, String)> = Vec::new();
    let mut cells: HashMap<(i32, i32), Vec<usize>> = HashMap::new();
    for mesh in town
        .collision
        .iter()
        .filter(|mesh| mesh.name == "buildings and poles")
    {
        for (corners, object) in mesh.triangles.iter().zip(&mesh.objects) {
            let points = corners.map(|c| {
                let p = mesh.vertices_m[c as usize].map(f64::from);
                Point3::from(std::array::from_fn::<f64, 3, _>(|i| {
                    p[i] + town.origin_m[i]
                }))
            });
            let name = town.objects.iter().find(|it| it.id == *object);
            let span = |axis: usize| {
                let low = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
                let high = points
                    .iter()
                    .map(|p| p[axis])
                    .fold(f64::NEG_INFINITY, f64::max);
                (low / CELL_M).floor() as i32..=(high / CELL_M).floor() as i32
            };
            for x in span(0) {
                for y in span(1) {
                    cells.entry((x, y)).or_default().push(triangles.len());
                }
            }
            triangles.push((points, name.map_or(String::new(), |it| it.name.clone())));
        }
    }
    let mut found = Vec::new();
    let mut hit = |a: Point3<f64>, b: Point3<f64>| {
        let mut near = vec![cell([a.x, a.y]), cell([b.x, b.y])];
        near.dedup();
        for idx in near.iter().filter_map(|at| cells.get(at)).flatten() {
            if crosses(a, b, &triangles[*idx].0) {
                let name = &triangles[*idx].1;
                found.push(format!("{name} at ({:.1}, {:.1}, {:.1})", a.x, a.y, a.z));
            }
        }
    };
    for lane in roads.lanes().iter().filter(|lane| lane.kind.is_drivable()) {
        let n = (lane.length_m / STEP_M).ceil().max(1.0) as usize;
        let mut before: Option<Vec<Point3<f64>>> = None;
        for i in 0..=n {
            let at = LanePosition::new(lane.key, lane.length_m * i as f64 / n as f64);
            let Some(pose) = roads.pose(at) else { continue };
            let half_m = 0.5 * roads.width_m(at) * FREE;
            // About a quarter of a metre apart: a thinner post is crossed by one across.
            let sides = (half_m / 0.125).floor() as i32;
            let row: Vec<Point3<f64>> = (-sides..=sides)
                .flat_map(|k| HEIGHTS_M.map(|z| (k, z)))
                .map(|(k, z)| pose * Point3::new(0.0, 0.125 * f64::from(k), z))
                .collect();
            let n_heights = HEIGHTS_M.len();
            if row.len() >= 2 * n_heights {
                for z in 0..n_heights {
                    hit(row[z], row[row.len() - n_heights + z]);
                }
                if let Some(before) = before.filter(|it| it.len() == row.len()) {
                    before.iter().zip(&row).for_each(|(a, b)| hit(*a, *b));
                }
            }
            before = Some(row);
        }
    }
    found.sort();
    found.dedup_by(|a, b| a.split(" at ").next() == b.split(" at ").next());
    found
}

/// Whether a segment goes through a triangle (Möller and Trumbore).
fn crosses(a: Point3<f64>, b: Point3<f64>, [p, q, r]: &Triangle) -> bool {
    let (along, u, v): (Vector3<f64>, _, _) = (b - a, q - p, r - p);
    let h = along.cross(&v);
    let det = u.dot(&h);
    if det.abs() < 1e-12 {
        return false;
    }
    let s = a - p;
    let x = s.dot(&h) / det;
    let w = s.cross(&u);
    let y = along.dot(&w) / det;
    let t = v.dot(&w) / det;
    (0.0..=1.0).contains(&x) && y >= 0.0 && x + y <= 1.0 && (0.0..=1.0).contains(&t)
}
