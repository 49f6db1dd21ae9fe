//! What must hold for every kind of vehicle.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use simd_body::{BodyStyle, VehicleShape, vehicle_meshes};
use triangles::check_triangles;

#[path = "triangles.rs"]
mod triangles;

fn shapes() -> Vec<VehicleShape> {
    let shape = |style, half_m, wheel_radius_m, wheelbase_m| VehicleShape {
        style,
        half_m,
        wheel_radius_m,
        wheelbase_m,
    };
    vec![
        shape(BodyStyle::Saloon, [2.396, 1.082, 0.744], 0.34, 2.88),
        shape(BodyStyle::Saloon, [2.679, 1.017, 0.705], 0.33, 2.8),
        shape(BodyStyle::Hatch, [1.817, 0.923, 0.751], 0.3, 2.4),
        shape(BodyStyle::Hatch, [1.104, 0.740, 0.688], 0.26, 1.5),
        shape(BodyStyle::Suv, [2.783, 1.075, 1.023], 0.4, 3.07),
        shape(BodyStyle::Van, [2.958, 0.994, 1.280], 0.35, 3.66),
        shape(BodyStyle::Microbus, [2.221, 0.939, 0.994], 0.33, 2.4),
        shape(BodyStyle::Microbus, [2.240, 1.035, 1.019], 0.35, 2.4),
        shape(BodyStyle::Bus, [5.1, 1.97, 2.12], 0.48, 5.6),
        shape(BodyStyle::Lorry, [3.962, 1.432, 1.892], 0.48, 4.6),
        shape(BodyStyle::Motorcycle, [1.105, 0.434, 0.75], 0.3, 1.4),
        shape(BodyStyle::Bicycle, [0.821, 0.22, 0.85], 0.33, 1.0),
    ]
}

#[test]
fn vehicles_fill_their_boxes_to_a_centimetre() {
    for shape in shapes() {
        let meshes = vehicle_meshes(&shape);
        check_triangles(&meshes.body);
        check_triangles(&meshes.wheel);
        let lod = meshes.body.lods[0];
        let used = &meshes.body.indices[..lod.n_indices as usize];
        let bodies = used
            .iter()
            .map(|&i| Vector3::from(meshes.body.vertices[i as usize].position_m).cast::<f64>());
        let wheels = meshes.wheels.iter().flat_map(|site| {
            let centre = Vector3::from(site.centre_m);
            meshes
                .wheel
                .vertices
                .iter()
                .map(move |v| centre + Vector3::from(v.position_m).cast::<f64>())
        });
        let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
        for p in bodies.chain(wheels) {
            (low, high) = (low.inf(&p), high.sup(&p));
        }
        for (got, want) in [
            (high.x, shape.half_m[0]),
            (-low.x, shape.half_m[0]),
            (high.y, shape.half_m[1]),
            (-low.y, shape.half_m[1]),
            (high.z, 2.0 * shape.half_m[2]),
            (low.z, 0.0),
        ] {
            assert!(
                (got - want).abs() < 0.0101,
                "{:?}: {got} instead of {want}; {low} {high}",
                shape.style
            );
        }
        assert!(
            lod.n_indices < 3 * 2400 && meshes.body.lods[2].n_indices < 3 * 420,
            "{:?}",
            shape.style
        );
    }
}

#[test]
fn cars_carry_every_lamp() {
    for shape in &shapes()[..10] {
        let meshes = vehicle_meshes(shape);
        let bits: BTreeSet<u8> = meshes
            .body
            .vertices
            .iter()
            .filter(|v| v.material == sensor_core::Material::Lamp as u8)
            .map(|v| v.lamp)
            .collect();
        assert_eq!(bits, (0..=6).collect(), "{:?}", shape.style);
    }
}
