//! A slow, plain ray caster in `f64` over a scene's triangles, with which sensors are compared. It
//! shares no code with them.

use nalgebra::{Isometry3, Point3, Vector3};
use sensor_core::{Lod, Mesh, Scene};

/// Which level of detail of the meshes is used.
#[derive(Clone, Copy, Debug)]
pub enum Detail {
    /// The finest, as rays see it.
    Finest,
    /// The level that [`Lod::until_m`] selects for an eye at this place.
    SeenFrom(Point3<f64>),
}

/// One triangle of the world.
#[derive(Clone, Debug)]
pub struct Triangle {
    /// Corners, counter-clockwise from outside.
    pub corners: [Point3<f64>; 3],
    /// Normals stored at the corners, world, unit length.
    pub normals: [Vector3<f64>; 3],
    /// Normal of its plane.
    pub face: Vector3<f64>,
    /// Class number.
    pub class: u8,
    /// Object id.
    pub object: u32,
    /// Index into `Scene::dynamics`, if it moves.
    pub dynamic: Option<usize>,
}

/// Where a ray met a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Met<'o> {
    /// Multiples of the ray's direction.
    pub t: f64,
    /// Shares of the triangle's second and third corner.
    pub uv: [f64; 2],
    /// What was met.
    pub triangle: &'o Triangle,
}

impl Met<'_> {
    /// Normal between those of the corners.
    pub fn normal(&self) -> Vector3<f64> {
        let [u, v] = self.uv;
        let [a, b, c] = self.triangle.normals;
        (a * (1.0 - u - v) + b * u + c * v).normalize()
    }

    /// Whether the corners' normals are one, so that the surface is meant to be flat.
    pub fn is_flat(&self) -> bool {
        let [a, b, c] = self.triangle.normals;
        (a - b).norm() < 1e-9 && (a - c).norm() < 1e-9
    }

    /// Whether another ray met the same plane of the same thing.
    pub fn is_beside(&self, other: &Met<'_>) -> bool {
        let (a, b) = (self.triangle, other.triangle);
        let same = (a.class, a.object, a.dynamic) == (b.class, b.object, b.dynamic);
        same && (a.face - b.face).norm() < 1e-3
            && a.face.dot(&(b.corners[0] - a.corners[0])).abs() < 1e-3
    }
}

struct Node {
    low: [f64; 3],
    high: [f64; 3],
    /// A leaf's triangles; of an inner node `n` is 0, its first child follows it and `first` is the
    /// second.
    first: u32,
    n: u32,
}

/// A scene's triangles in boxes within boxes.
pub struct Oracle {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
}

const LEAF: usize = 6;

impl Oracle {
    /// All of a scene that is within `reach_m` of `eye`, whole meshes.
    pub fn of(scene: &Scene, detail: Detail, eye: Point3<f64>, reach_m: f64) -> Oracle {
        let mut triangles = Vec::new();
        let mut add = |mesh: &Mesh, pose: &Isometry3<f64>, id: u32, dynamic: Option<usize>| {
            let middle = pose * Point3::from(mesh.centre_m.map(f64::from));
            if (middle - eye).norm() - f64::from(mesh.radius_m) > reach_m {
                return;
            }
            let Some(lod) = level(mesh, middle, detail) else {
                return;
            };
            let range = lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize;
            for t in mesh.indices[range].chunks_exact(3) {
                let vertices = [0, 1, 2].map(|i| &mesh.vertices[t[i] as usize]);
                let corners = vertices.map(|v| pose * Point3::from(v.position_m.map(f64::from)));
                let across = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
                if across.norm() < 1e-12 {
                    continue;
                }
                let normals = vertices.map(|v| {
                    pose.rotation
                        * Vector3::new(v.normal[0], v.normal[1], v.normal[2])
                            .cast::<f64>()
                            .normalize()
                });
                let object = if vertices[0].object_id == 0 {
                    id
                } else {
                    vertices[0].object_id
                };
                triangles.push(Triangle {
                    corners,
                    normals,
                    face: across.normalize(),
                    class: vertices[0].class,
                    object,
                    dynamic,
                });
            }
        };
        for instance in &scene.assets.statics {
            add(
                scene.assets.mesh(instance.mesh),
                &instance.world_from_mesh,
                instance.object.0,
                None,
            );
        }
        for (i, instance) in scene.dynamics.iter().enumerate() {
            add(
                scene.assets.mesh(instance.mesh),
                &instance.world_from_mesh,
                instance.actor.0,
                Some(i),
            );
        }
        let mut oracle = Oracle {
            triangles: Vec::new(),
            nodes: Vec::new(),
        };
        let mut order: Vec<(u32, [f64; 3])> = triangles
            .iter()
            .enumerate()
            .map(|(i, t)| (i as u32, middle_of(t)))
            .collect();
        oracle.split(&triangles, &mut order, 0);
        oracle.triangles = order
            .iter()
            .map(|(i, _)| triangles[*i as usize].clone())
            .collect();
        oracle
    }

    /// Number of triangles.
    pub fn n_triangles(&self) -> usize {
        self.triangles.len()
    }

    fn split(&mut self, triangles: &[Triangle], order: &mut [(u32, [f64; 3])], first: usize) {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in order
            .iter()
            .flat_map(|(i, _)| &triangles[*i as usize].corners)
        {
            for axis in 0..3 {
                low[axis] = low[axis].min(corner[axis]);
                high[axis] = high[axis].max(corner[axis]);
            }
        }
        let node = self.nodes.len();
        self.nodes.push(Node {
            low,
            high,
            first: first as u32,
            n: order.len() as u32,
        });
        if order.len() <= LEAF {
            return;
        }
        let axis = (0..3)
            .max_by(|a, b| (high[*a] - low[*a]).total_cmp(&(high[*b] - low[*b])))
            .unwrap_or(0);
        let half = order.len() / 2;
        order.select_nth_unstable_by(half, |a, b| a.1[axis].total_cmp(&b.1[axis]));
        let (left, right) = order.split_at_mut(half);
        self.split(triangles, left, first);
        self.nodes[node].n = 0;
        self.nodes[node].first = self.nodes.len() as u32;
        self.split(triangles, right, first + half);
    }

    /// The nearest triangle that `origin + t · direction` meets at `t ≥ from`; only its front, or
    /// both sides.
    pub fn cast(
        &self,
        origin: Point3<f64>,
        direction: Vector3<f64>,
        from: f64,
        both_sides: bool,
    ) -> Option<Met<'_>> {
        let mut nearest: Option<Met<'_>> = None;
        let mut open = vec![0usize];
        while let Some(at) = open.pop() {
            let Some(node) = self.nodes.get(at) else {
                continue;
            };
            if !enters(
                node,
                &origin,
                &direction,
                nearest.map_or(f64::INFINITY, |met| met.t),
            ) {
                continue;
            }
            if node.n == 0 {
                open.extend([node.first as usize, at + 1]);
                continue;
            }
            for triangle in &self.triangles[node.first as usize..(node.first + node.n) as usize] {
                if let Some(met) = meet(triangle, &origin, &direction, both_sides)
                    && met.t >= from
                    && nearest.is_none_or(|best| met.t < best.t)
                {
                    nearest = Some(met);
                }
            }
        }
        nearest
    }

    /// As [`Oracle::cast`], but tests every triangle; used to check the boxes.
    pub fn cast_plainly(
        &self,
        origin: Point3<f64>,
        direction: Vector3<f64>,
        from: f64,
        both_sides: bool,
    ) -> Option<Met<'_>> {
        let all = self
            .triangles
            .iter()
            .filter_map(|triangle| meet(triangle, &origin, &direction, both_sides));
        all.filter(|met| met.t >= from)
            .min_by(|a, b| a.t.total_cmp(&b.t))
    }
}

fn level(mesh: &Mesh, middle: Point3<f64>, detail: Detail) -> Option<Lod> {
    match detail {
        Detail::Finest => mesh.lods.first().copied(),
        Detail::SeenFrom(eye) => {
            let distance_m = ((middle - eye).norm() - f64::from(mesh.radius_m)).max(0.0);
            mesh.lods
                .iter()
                .find(|lod| distance_m < f64::from(lod.until_m))
                .copied()
        }
    }
}

fn middle_of(triangle: &Triangle) -> [f64; 3] {
    let [a, b, c] = triangle.corners;
    std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0)
}

fn enters(node: &Node, origin: &Point3<f64>, direction: &Vector3<f64>, limit: f64) -> bool {
    let (mut from, mut to) = (0.0f64, limit);
    for axis in 0..3 {
        let (a, b) = (
            (node.low[axis] - origin[axis]) / direction[axis],
            (node.high[axis] - origin[axis]) / direction[axis],
        );
        // Parallel to the slab and on its face, 0/0: counts as within.
        if a.is_nan() || b.is_nan() {
            continue;
        }
        (from, to) = (from.max(a.min(b) - 1e-9), to.min(a.max(b) + 1e-9));
    }
    from <= to
}

/// Intersection of ray and triangle by Möller and Trumbore.
fn meet<'o>(
    triangle: &'o Triangle,
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    both_sides: bool,
) -> Option<Met<'o>> {
    let [a, b, c] = triangle.corners;
    if !both_sides && triangle.face.dot(direction) >= 0.0 {
        return None;
    }
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(&ac);
    let determinant = ab.dot(&p);
    if determinant == 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(&p) / determinant;
    let q = from_a.cross(&ab);
    let v = direction.dot(&q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| Met {
        t: ac.dot(&q) / determinant,
        uv: [u, v],
        triangle,
    })
}
