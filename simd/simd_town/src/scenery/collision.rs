//! Triangles that vehicles feel and run into.

use schema_types::ObjectId;

use crate::geometry::P2;

/// Triangles for collision, `f32` about [`Town::origin_m`](crate::Town::origin_m).
#[derive(Clone, Debug, Default)]
pub struct CollisionMesh {
    /// Name for messages.
    pub name: String,
    /// Corners.
    pub vertices_m: Vec<[f32; 3]>,
    /// Three corners per triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Scenery object of each triangle.
    pub objects: Vec<ObjectId>,
}

impl CollisionMesh {
    /// Adds a convex polygon of an object.
    pub(crate) fn polygon(&mut self, object: ObjectId, corners_m: &[[f64; 3]]) {
        let base = self.vertices_m.len() as u32;
        self.vertices_m
            .extend(corners_m.iter().map(|c| c.map(|x| x as f32)));
        self.triangles
            .extend((1..corners_m.len() as u32 - 1).map(|i| [base, base + i, base + i + 1]));
        self.objects.resize(self.triangles.len(), object);
    }

    /// Adds an upright prism with a lid.
    pub(crate) fn prism(&mut self, object: ObjectId, footprint: &[P2], (low, high): (f64, f64)) {
        for i in 0..footprint.len() {
            let (a, b) = (footprint[i], footprint[(i + 1) % footprint.len()]);
            self.polygon(
                object,
                &[
                    [a.x, a.y, low],
                    [b.x, b.y, low],
                    [b.x, b.y, high],
                    [a.x, a.y, high],
                ],
            );
        }
        let lid: Vec<[f64; 3]> = footprint.iter().map(|p| [p.x, p.y, high]).collect();
        self.polygon(object, &lid);
    }
}

/// The ground that vehicles drive on.
#[derive(Default)]
pub struct Floor {
    /// Road.
    pub road: CollisionMesh,
    /// Pavement, kerbs, yards.
    pub raised: CollisionMesh,
}
