//! Parked cars: body and wheels in one mesh, without lights.

use nalgebra::{Isometry3, Vector3};
use sensor_core::Mesh;
use simd_body::{BodyStyle, VehicleShape, vehicle_meshes};

use crate::scenery::bound;

const fn shape(
    style: BodyStyle,
    half_m: [f64; 3],
    wheel_radius_m: f64,
    wheelbase_m: f64,
) -> VehicleShape {
    VehicleShape {
        style,
        half_m,
        wheel_radius_m,
        wheelbase_m,
    }
}
const PARKED_SALOON: VehicleShape = shape(BodyStyle::Saloon, [2.35, 1.0, 0.73], 0.325, 2.78);
const PARKED_HATCH: VehicleShape = shape(BodyStyle::Hatch, [1.98, 0.98, 0.755], 0.31, 2.50);
const PARKED_SUV: VehicleShape = shape(BodyStyle::Suv, [2.25, 1.02, 0.845], 0.36, 2.72);
const PARKED_VAN: VehicleShape = shape(BodyStyle::Van, [2.55, 1.05, 1.0], 0.34, 3.2);
const PARKED: [(VehicleShape, [u8; 3]); 10] = [
    (PARKED_SALOON, [198, 200, 204]),
    (PARKED_SALOON, [28, 30, 34]),
    (PARKED_SALOON, [30, 52, 96]),
    (PARKED_HATCH, [168, 28, 30]),
    (PARKED_HATCH, [236, 236, 234]),
    (PARKED_HATCH, [92, 128, 150]),
    (PARKED_SUV, [60, 64, 68]),
    (PARKED_SUV, [222, 222, 218]),
    (PARKED_SUV, [70, 84, 66]),
    (PARKED_VAN, [232, 232, 230]),
];

/// Every kind of parked car.
pub fn all() -> impl Iterator<Item = (Mesh, VehicleShape)> {
    PARKED
        .iter()
        .map(|&(shape, rgb)| (parked_car(&shape, rgb), shape))
}

/// Body and wheels of a parked car in one mesh, tinted.
fn parked_car(shape: &VehicleShape, rgb: [u8; 3]) -> Mesh {
    let parts = vehicle_meshes(shape);
    let mut car = Mesh {
        name: format!("parked {:?}", shape.style).to_lowercase(),
        ..Mesh::default()
    };
    for (level, until_m) in [10.0, 20.0, 60.0, 200.0].into_iter().enumerate() {
        let first_idx = car.indices.len() as u32;
        append(&mut car, &parts.body, level, &Isometry3::identity());
        for site in &parts.wheels {
            let turn = Vector3::z() * if site.left { std::f64::consts::PI } else { 0.0 };
            append(
                &mut car,
                &parts.wheel,
                level,
                &Isometry3::new(Vector3::from(site.centre_m), turn),
            );
        }
        let n_indices = car.indices.len() as u32 - first_idx;
        car.lods.push(sensor_core::Lod {
            first_idx,
            n_indices,
            until_m,
        });
    }
    for vertex in &mut car.vertices {
        // Nobody sits in a parked car: its lamps become plain lenses, which do not come on with the
        // street lamps.
        if vertex.material == sensor_core::Material::Lamp as u8 {
            (vertex.material, vertex.lamp) = (sensor_core::Material::Glass as u8, 0);
            vertex.color = std::array::from_fn(|i| {
                if i < 3 {
                    (u16::from(vertex.color[i]) * 3 / 5) as u8
                } else {
                    255
                }
            });
        }
        if vertex.material == sensor_core::Material::CarPaint as u8 {
            vertex.color = std::array::from_fn(|i| {
                if i < 3 {
                    (u16::from(vertex.color[i]) * u16::from(rgb[i]) / 255) as u8
                } else {
                    255
                }
            });
        }
    }
    bound(&mut car);
    car
}

fn append(to: &mut Mesh, from: &Mesh, level: usize, pose: &Isometry3<f64>) {
    let lod = from.lods[level];
    let range = lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize;
    let pose: Isometry3<f32> = nalgebra::convert(*pose);
    for &i in &from.indices[range] {
        let mut vertex = from.vertices[i as usize];
        vertex.position_m = (pose * nalgebra::Point3::from(vertex.position_m))
            .coords
            .into();
        let normal =
            Vector3::new(vertex.normal[0], vertex.normal[1], vertex.normal[2]).map(f32::from);
        let turned = pose.rotation * normal;
        vertex.normal = [
            turned.x.round() as i8,
            turned.y.round() as i8,
            turned.z.round() as i8,
            0,
        ];
        to.indices.push(to.vertices.len() as u32);
        to.vertices.push(vertex);
    }
}
