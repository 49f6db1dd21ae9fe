//! Large walls of a mesh.

use sensor_core::{Lod, Mesh};

/// Smaller polygons hide too little, square metres.
const MIN_AREA_M2: f32 = 3.0;
/// Vertical part of the normal of a wall at most: nothing stands below the ground or a flat roof.
const MAX_SLOPE: f32 = 0.7;
/// Corners of a polygon at most.
const MAX_CORNERS: usize = 8;
/// Cosine of the angle between triangles of one polygon, at least.
const FLAT_COSINE: f32 = 0.999_99;

/// A flat polygon in the mesh's space, counter-clockwise seen from where it is visible.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Occluder {
    /// Its corners, metres.
    pub corners_m: Vec<[f32; 3]>,
}

/// The large walls of a level of detail. Triangles of a fan, as meshes are built, make one.
pub(crate) fn occluders_of(mesh: &Mesh, lod: &Lod) -> Vec<Occluder> {
    let range = lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize;
    let corner = |idx: u32| mesh.vertices[idx as usize].position_m;
    let (mut found, mut triangles) = (Vec::new(), mesh.indices[range].chunks_exact(3).peekable());
    while let Some(first) = triangles.next() {
        let mut corners_m: Vec<[f32; 3]> = first.iter().map(|idx| corner(*idx)).collect();
        let mut twice_area = cross(&corners_m, [0, 1, 2]);
        let mut last = first[2];
        while let Some(next) = triangles.peek()
            && next[0] == first[0]
            && next[1] == last
            && corners_m.len() < MAX_CORNERS
        {
            corners_m.push(corner(next[2]));
            let n = corners_m.len();
            let more = cross(&corners_m, [0, n - 2, n - 1]);
            if dot(twice_area, more) < FLAT_COSINE * norm(twice_area) * norm(more) {
                corners_m.pop();
                break;
            }
            twice_area = [0, 1, 2].map(|axis| twice_area[axis] + more[axis]);
            last = next[2];
            triangles.next();
        }
        let area = norm(twice_area);
        if 0.5 * area >= MIN_AREA_M2 && twice_area[2].abs() < MAX_SLOPE * area {
            found.push(Occluder { corners_m });
        }
    }
    found
}

/// Cross product of two sides of a triangle.
fn cross(corners: &[[f32; 3]], [a, b, c]: [usize; 3]) -> [f32; 3] {
    let side = |to: usize| [0, 1, 2].map(|axis| corners[to][axis] - corners[a][axis]);
    let (u, v) = (side(b), side(c));
    [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: [f32; 3]) -> f32 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_types::Class;
    use sensor_core::mesh::Surface;
    use sensor_core::{Material, MeshBuilder};

    #[test]
    fn upright_quads_are_one_wall_and_small_or_flat_ones_none() {
        let surface = Surface::new(Class::WALLS, Material::Matte, [90; 3]);
        let mut builder = MeshBuilder::new("two quads");
        let quad = |side: f32, up: [f32; 3]| {
            let top = up.map(|x| side * x);
            [
                [0.0, 0.0, 0.0],
                [side, 0.0, 0.0],
                [side + top[0], top[1], top[2]],
                top,
            ]
        };
        let (upright, flat) = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]);
        builder.quad(surface, quad(1.0, upright), [[0.0; 2]; 4]);
        builder.quad(surface, quad(5.0, upright), [[0.0; 2]; 4]);
        builder.quad(surface, quad(5.0, flat), [[0.0; 2]; 4]);
        let mesh = builder.finish();
        let found = occluders_of(&mesh, &mesh.lods[0]);
        let corners_m = quad(5.0, upright).to_vec();
        assert_eq!(found, [Occluder { corners_m }]);
    }
}
