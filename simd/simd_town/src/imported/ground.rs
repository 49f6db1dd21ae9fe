//! The mesh and the solid triangles of the ground.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::builder::ImportBuilder;
use crate::geometry::P2;
use crate::scenery::{ALL, Key, Layer};

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
