//! The walkable mesh and what can be asked of it.

/// What a face lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Ground {
    /// Pavement.
    Sidewalk,
    /// Crosswalk.
    Crosswalk,
    /// Carriageway beside a pavement.
    Road,
}

/// A convex face; corners counter-clockwise seen from above.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkFace {
    /// 3 to 6 indices into [`WalkMesh::vertices_m`].
    pub corners: Vec<u32>,
    /// For each corner, the face beyond the edge from it to the next corner.
    pub neighbours: Vec<Option<u32>>,
    /// What it lies on.
    pub ground: Ground,
}

/// A walkable mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WalkMesh {
    /// Corners in the world, metres. Heights are those of the roads' surfaces, accurate to the
    /// height of a kerb.
    pub vertices_m: Vec<[f64; 3]>,
    /// Faces, in a fixed order.
    pub faces: Vec<WalkFace>,
}

impl WalkMesh {
    /// Corners of a face.
    pub fn corners_m(&self, face: usize) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.faces[face]
            .corners
            .iter()
            .map(|corner| self.vertices_m[*corner as usize])
    }

    /// Area of a face seen from above, m².
    pub fn area_m2(&self, face: usize) -> f64 {
        let corners: Vec<[f64; 3]> = self.corners_m(face).collect();
        (1..corners.len() - 1)
            .map(|i| 0.5 * turn(corners[0], corners[i], corners[i + 1]))
            .sum()
    }

    /// Mean of a face's corners.
    pub fn middle_m(&self, face: usize) -> [f64; 3] {
        let n = self.faces[face].corners.len() as f64;
        self.corners_m(face).fold([0.0; 3], |sum, corner| {
            std::array::from_fn(|i| sum[i] + corner[i] / n)
        })
    }

    /// The face that a point lies in, seen from above, among those whose height is within
    /// `reach_m`.
    pub fn face_at(&self, point: [f64; 3], reach_m: f64) -> Option<usize> {
        (0..self.faces.len()).find(|face| {
            self.contains(*face, point) && (self.middle_m(*face)[2] - point[2]).abs() < reach_m
        })
    }

    /// Whether a point lies in a face, seen from above.
    pub fn contains(&self, face: usize, point: [f64; 3]) -> bool {
        let corners: Vec<[f64; 3]> = self.corners_m(face).collect();
        (0..corners.len())
            .all(|i| turn(corners[i], corners[(i + 1) % corners.len()], point) >= -1e-9)
    }
}

/// Twice the area of a triangle seen from above, positive if it runs counter-clockwise.
pub(crate) fn turn(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}
