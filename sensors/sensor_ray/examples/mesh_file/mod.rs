//! Meshes from files for the benches. Little-endian: `u32` vertices, `u32` triangles, then `f32` ×
//! 3 per vertex, then `u32` × 3 per triangle.

use nalgebra::Isometry3;
use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets, StaticInstance};

/// A world of the one mesh.
pub fn read(path: &str) -> SceneAssets {
    let bytes = std::fs::read(path).expect("the mesh file can be read");
    let word =
        |at: usize| u32::from_le_bytes(bytes[4 * at..4 * at + 4].try_into().expect("four bytes"));
    let (n_vertices, n_triangles) = (word(0) as usize, word(1) as usize);
    let vertex =
        |i: u32| std::array::from_fn(|axis| f32::from_bits(word(2 + 3 * i as usize + axis)));
    let surface = Surface::new(Class::BUILDINGS, Material::Matte, [128; 3]);
    let mut builder = MeshBuilder::new("mesh");
    for triangle in 0..n_triangles {
        builder.triangle(
            surface,
            [0, 1, 2].map(|corner| vertex(word(2 + 3 * n_vertices + 3 * triangle + corner))),
        );
    }
    let mut assets = SceneAssets::default();
    let mesh = assets.add_mesh(builder.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(1),
    });
    assets
}
