//! The mesh and the solid triangles of the ground.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use nalgebra::Isometry3;

use super::builder::ImportBuilder;
use crate::geometry::P2;
use crate::scenery::{ALL, Key, Layer, place};

/// Side of the backdrop's pieces, of its cells, and how far it lies under the ground.
const PIECE_M: f64 = 2000.0;
const COARSE_M: f64 = 80.0;
const UNDER_M: f64 = 1.5;

/// Adds coarse ground under the ground of a large map, which is there where the ground itself is
/// not: far from all sensors.
pub(super) fn backdrop(builder: &mut ImportBuilder) {
    let object = builder.object(Class::TERRAIN, "far ground");
    let grass = Surface::new(Class::TERRAIN, Material::Grass, [98, 120, 66]).of(object);
    for (origin, quads) in builder.ground.coarse(PIECE_M, COARSE_M) {
        let mut mesh = MeshBuilder::new("far ground");
        for corners in quads {
            let local = corners.map(|c| {
                [
                    (c[0] - origin.x) as f32,
                    (c[1] - origin.y) as f32,
                    (c[2] - UNDER_M) as f32,
                ]
            });
            mesh.quad(grass, local, corners.map(|c| [c[0] as f32, c[1] as f32]));
        }
        let mesh = builder.assets.add_mesh(mesh.finish());
        place(
            &mut builder.assets,
            mesh,
            Isometry3::translation(origin.x, origin.y, 0.0),
            schema_types::ObjectId::BACKGROUND,
        );
    }
}

/// Adds the ground.
pub(super) fn build(builder: &mut ImportBuilder) {
    let object = builder.object(Class::TERRAIN, "ground");
    let grass = Surface::new(Class::TERRAIN, Material::Grass, [100, 124, 66]).of(object);
    let (mut triangles, mut quads) = (Vec::new(), Vec::new());
    builder.ground.cells(|corners| triangles.push(corners));
    builder.ground.apron(|corners| quads.push(corners));
    let uv = |c: &[f64; 3]| [c[0] as f32, c[1] as f32];
    for corners in triangles {
        let key = Key::at(Layer::Ground, P2::new(corners[0][0], corners[0][1]));
        builder
            .chunks
            .polygon(key, ALL, grass, &corners, &corners.each_ref().map(uv));
        builder.raised.polygon(object, &corners);
    }
    for corners in quads {
        let key = Key::at(Layer::Ground, P2::new(corners[0][0], corners[0][1]));
        builder
            .chunks
            .polygon(key, ALL, grass, &corners, &corners.each_ref().map(uv));
        builder.raised.polygon(object, &corners);
    }
}
