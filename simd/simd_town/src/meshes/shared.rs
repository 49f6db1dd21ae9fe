//! Meshes that stand in many places of a town.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Vector3};
use sensor_core::{Mesh, MeshId, SceneAssets};

use crate::network::SignalKind;
use crate::plan::{Houses, Plan};
use crate::{furniture, greenery, props};
use simd_body::{BodyStyle, VehicleShape, vehicle_meshes};

/// A lamp post and where its light is.
#[derive(Clone, Copy)]
pub struct Lamp {
    pub mesh: MeshId,
    /// Middle of the light in the mesh.
    pub light_m: [f64; 3],
    pub intensity_lm: f32,
    pub height_m: f64,
}

/// Meshes that stand in many places.
pub struct Kit {
    pub trees: Vec<MeshId>,
    pub conifers: Vec<MeshId>,
    pub palm: MeshId,
    pub bush: MeshId,
    pub lamp: Lamp,
    pub mast: Lamp,
    pub bench: MeshId,
    pub bin: MeshId,
    pub bollard: MeshId,
    pub shelter: MeshId,
    pub hydrant: MeshId,
    pub planter: MeshId,
    pub rack: MeshId,
    pub letter_box: MeshId,
    pub cabinet: MeshId,
    pub manhole: MeshId,
    pub power_pole: MeshId,
    pub poles: [MeshId; 2],
    pub signs: Vec<(SignalKind, MeshId)>,
    pub cars: Vec<(MeshId, VehicleShape)>,
}

impl Kit {
    pub fn new(plan: &Plan, assets: &mut SceneAssets) -> Kit {
        let limits: BTreeSet<u32> = plan
            .streets
            .iter()
            .map(|street| street.profile.speed_kmh)
            .collect();
        let signs = [SignalKind::Stop, SignalKind::Yield]
            .into_iter()
            .chain(limits.into_iter().map(SignalKind::Limit));
        let old_town = matches!(plan.houses, Houses::Cottages | Houses::Terraces);
        let lamp = if old_town {
            Lamp {
                mesh: assets.add_mesh(props::lantern()),
                light_m: [0.0, 0.0, 4.3],
                intensity_lm: 3000.0,
                height_m: 4.5,
            }
        } else {
            Lamp {
                mesh: assets.add_mesh(furniture::street_lamp()),
                light_m: [1.75, 0.0, 7.95],
                intensity_lm: 6500.0,
                height_m: 7.0,
            }
        };
        Kit {
            trees: (0..greenery::N_KINDS)
                .map(|kind| assets.add_mesh(greenery::tree(kind)))
                .collect(),
            conifers: (0..greenery::N_CONIFERS)
                .map(|kind| assets.add_mesh(greenery::conifer(kind)))
                .collect(),
            palm: assets.add_mesh(greenery::palm()),
            bush: assets.add_mesh(greenery::bush()),
            lamp,
            mast: Lamp {
                mesh: assets.add_mesh(props::mast()),
                light_m: [2.2, 0.0, 11.2],
                intensity_lm: 14000.0,
                height_m: 11.0,
            },
            bench: assets.add_mesh(furniture::bench()),
            bin: assets.add_mesh(furniture::bin()),
            bollard: assets.add_mesh(furniture::bollard()),
            shelter: assets.add_mesh(furniture::shelter()),
            hydrant: assets.add_mesh(props::hydrant()),
            planter: assets.add_mesh(props::planter()),
            rack: assets.add_mesh(props::rack()),
            letter_box: assets.add_mesh(props::letter_box()),
            cabinet: assets.add_mesh(props::cabinet()),
            manhole: assets.add_mesh(props::manhole()),
            power_pole: assets.add_mesh(props::power_pole()),
            poles: [0.0, 5.0].map(|arm_m| assets.add_mesh(furniture::light_pole(arm_m))),
            signs: signs
                .map(|kind| (kind, assets.add_mesh(furniture::sign(kind))))
                .collect(),
            cars: PARKED
                .iter()
                .map(|&(shape, rgb)| (assets.add_mesh(parked_car(&shape, rgb)), shape))
                .collect(),
        }
    }
}

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
        // Nobody sits in it: its lamps are lenses, and do not come on with the street's.
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
    crate::chunk::bound(&mut car);
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
