//! From outlines to convex faces.

use std::collections::{BTreeMap, HashMap};

use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation as _};

use super::arrange::{Arrangement, STEPS_PER_M, Step};
use super::mesh::{Ground, WalkFace, WalkMesh, turn};
use super::outlines::{Outline, inside};

/// Most corners of a face.
const MAX_CORNERS: usize = 6;
/// Width of the cells in which outlines are looked up, metres.
const CELL_M: f64 = 20.0;

/// A point of the triangulation: steps of the grid, which `f64` holds exactly, and the height in
/// metres.
#[derive(Clone, Copy)]
struct Corner {
    at: [f64; 3],
}

impl HasPosition for Corner {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        Point2::new(self.at[0], self.at[1])
    }
}

/// The mesh of the outlines; where several lie over each other the first kind of [`Ground`] counts.
pub fn mesh(outlines: &[Outline]) -> WalkMesh {
    let net = net(&Arrangement::new(outlines));
    let lookup = Lookup::new(outlines);
    let vertices_m: Vec<[f64; 3]> = net
        .vertices()
        .map(|vertex| metres(vertex.data().at))
        .collect();
    let mut polygons: Vec<(Vec<u32>, Ground)> = Vec::new();
    for face in net.inner_faces() {
        let corners = face.vertices().map(|vertex| vertex.index() as u32);
        let [a, b, c] = corners.map(|corner| vertices_m[corner as usize]);
        let middle: [f64; 3] = std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0);
        if let Some(ground) = lookup.ground(middle).filter(|_| turn(a, b, c) > 1e-7) {
            polygons.push((corners.to_vec(), ground));
        }
    }
    finish(vertices_m, merged(polygons, &net))
}

fn metres([x, y, height_m]: [f64; 3]) -> [f64; 3] {
    [x / STEPS_PER_M, y / STEPS_PER_M, height_m]
}

/// The triangulation. A segment that crosses another one would be left out; an arrangement has
/// none.
fn net(all: &Arrangement) -> ConstrainedDelaunayTriangulation<Corner> {
    let mut net: ConstrainedDelaunayTriangulation<Corner> = ConstrainedDelaunayTriangulation::new();
    let mut handles: BTreeMap<Step, FixedVertexHandle> = BTreeMap::new();
    for (place, height_m) in &all.heights_m {
        if let Ok(handle) = net.insert(Corner {
            at: [place[0] as f64, place[1] as f64, *height_m],
        }) {
            handles.insert(*place, handle);
        }
    }
    for ends in &all.segments {
        if let [Some(from), Some(to)] = ends.map(|end| handles.get(&end)) {
            net.try_add_constraint(*from, *to);
        }
    }
    net
}

/// Outlines by cell.
struct Lookup<'o> {
    outlines: &'o [Outline],
    cells: HashMap<(i64, i64), Vec<usize>>,
}

fn cell(x: f64) -> i64 {
    (x / CELL_M).floor() as i64
}

impl<'o> Lookup<'o> {
    fn new(outlines: &'o [Outline]) -> Self {
        let mut cells: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
        for (idx, outline) in outlines.iter().enumerate() {
            let span = |axis: usize| {
                let values = outline.corners_m.iter().map(|corner| corner[axis]);
                let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), x| {
                    (low.min(x), high.max(x))
                });
                cell(low)..=cell(high)
            };
            for x in span(0) {
                for y in span(1) {
                    cells.entry((x, y)).or_default().push(idx);
                }
            }
        }
        Lookup { outlines, cells }
    }

    fn ground(&self, point: [f64; 3]) -> Option<Ground> {
        let near = self.cells.get(&(cell(point[0]), cell(point[1])))?;
        near.iter()
            .filter(|idx| inside(&self.outlines[**idx].corners_m, point))
            .map(|idx| self.outlines[*idx].ground)
            .min()
    }
}

/// Joins polygons over their longest edges while they stay convex.
fn merged(
    polygons: Vec<(Vec<u32>, Ground)>,
    net: &ConstrainedDelaunayTriangulation<Corner>,
) -> Vec<(Vec<u32>, Ground)> {
    let at = |corner: u32| {
        net.vertex(FixedVertexHandle::from_index(corner as usize))
            .data()
            .at
    };
    let mut edges: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (idx, (corners, _)) in polygons.iter().enumerate() {
        for (a, b) in pairs(corners) {
            edges.entry((a.min(b), a.max(b))).or_default().push(idx);
        }
    }
    let length2 = |(a, b): (u32, u32)| {
        let (p, q) = (at(a), at(b));
        (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)
    };
    let mut order: Vec<((u32, u32), [usize; 2])> = edges
        .iter()
        .filter_map(|(edge, list)| Some((*edge, [*list.first()?, *list.get(1)?])))
        .collect();
    order.sort_by(|a, b| length2(b.0).total_cmp(&length2(a.0)).then(a.0.cmp(&b.0)));
    let mut owner: Vec<usize> = (0..polygons.len()).collect();
    let mut kept: Vec<Option<(Vec<u32>, Ground)>> = polygons.into_iter().map(Some).collect();
    for (edge, [first, second]) in order {
        let (first, second) = (root(&mut owner, first), root(&mut owner, second));
        let (Some((a, ground)), Some((b, other))) = (&kept[first], &kept[second]) else {
            continue;
        };
        if first == second || ground != other {
            continue;
        }
        if let Some(corners) = joined(a, b, edge, &at) {
            kept[first] = Some((corners, *ground));
            kept[second] = None;
            owner[second] = first;
        }
    }
    kept.into_iter().flatten().collect()
}

fn root(owner: &mut [usize], mut idx: usize) -> usize {
    while owner[idx] != idx {
        owner[idx] = owner[owner[idx]];
        idx = owner[idx];
    }
    idx
}

fn pairs(corners: &[u32]) -> impl Iterator<Item = (u32, u32)> + '_ {
    (0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()]))
}

/// Two polygons as one over their common edge, if that is convex and has few corners.
fn joined(
    a: &[u32],
    b: &[u32],
    edge: (u32, u32),
    at: &impl Fn(u32) -> [f64; 3],
) -> Option<Vec<u32>> {
    let is_edge = |p: u32, q: u32| (p.min(q), p.max(q)) == edge;
    let i = pairs(a).position(|(p, q)| is_edge(p, q))?;
    let j = pairs(b).position(|(p, q)| is_edge(p, q))?;
    if a.len() + b.len() - 2 > MAX_CORNERS {
        return None;
    }
    let rest_a = (0..a.len()).map(|k| a[(i + 1 + k) % a.len()]);
    let rest_b = (1..b.len() - 1).map(|k| b[(j + 1 + k) % b.len()]);
    let corners: Vec<u32> = rest_a.chain(rest_b).collect();
    let n = corners.len();
    let convex = (0..n).all(|k| {
        turn(
            at(corners[k]),
            at(corners[(k + 1) % n]),
            at(corners[(k + 2) % n]),
        ) >= 0.0
    });
    convex.then_some(corners)
}

/// Numbers the corners that are used and finds neighbours.
fn finish(vertices_m: Vec<[f64; 3]>, polygons: Vec<(Vec<u32>, Ground)>) -> WalkMesh {
    let mut number: BTreeMap<u32, u32> = BTreeMap::new();
    let mut mesh = WalkMesh::default();
    let mut sides: HashMap<(u32, u32), u32> = HashMap::new();
    for (corners, ground) in polygons {
        let corners: Vec<u32> = corners
            .into_iter()
            .map(|corner| {
                *number.entry(corner).or_insert_with(|| {
                    mesh.vertices_m.push(vertices_m[corner as usize]);
                    mesh.vertices_m.len() as u32 - 1
                })
            })
            .collect();
        sides.extend(pairs(&corners).map(|side| (side, mesh.faces.len() as u32)));
        mesh.faces.push(WalkFace {
            neighbours: vec![None; corners.len()],
            corners,
            ground,
        });
    }
    for face in &mut mesh.faces {
        face.neighbours = pairs(&face.corners)
            .map(|(a, b)| sides.get(&(b, a)).copied())
            .collect();
    }
    mesh
}
