//! Meshes that a town holds once and places many times.

use std::collections::BTreeSet;

use sensor_core::{MeshId, SceneAssets};
use simd_body::VehicleShape;

use super::{furniture, parked_cars, power_line, signals, street_lamps, trees};
use crate::network::SignalKind;
use crate::plan::{Houses, Plan};

/// A lamp post and where its light is.
#[derive(Clone, Copy)]
pub struct Lamp {
    pub mesh: MeshId,
    /// Middle of the light in the mesh.
    pub light_m: [f64; 3],
    pub intensity_lm: f32,
    pub height_m: f64,
}

/// Meshes that stand in many places, by their use.
pub struct SharedMeshes {
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

impl SharedMeshes {
    pub fn new(plan: &Plan, assets: &mut SceneAssets) -> SharedMeshes {
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
                mesh: assets.add_mesh(street_lamps::lantern()),
                light_m: [0.0, 0.0, 4.3],
                intensity_lm: 3000.0,
                height_m: 4.5,
            }
        } else {
            Lamp {
                mesh: assets.add_mesh(street_lamps::street_lamp()),
                light_m: [1.75, 0.0, 7.95],
                intensity_lm: 6500.0,
                height_m: 7.0,
            }
        };
        SharedMeshes {
            trees: (0..trees::N_KINDS)
                .map(|kind| assets.add_mesh(trees::tree(kind)))
                .collect(),
            conifers: (0..trees::N_CONIFERS)
                .map(|kind| assets.add_mesh(trees::conifer(kind)))
                .collect(),
            palm: assets.add_mesh(trees::palm()),
            bush: assets.add_mesh(trees::bush()),
            lamp,
            mast: Lamp {
                mesh: assets.add_mesh(street_lamps::mast()),
                light_m: [2.2, 0.0, 11.2],
                intensity_lm: 14000.0,
                height_m: 11.0,
            },
            bench: assets.add_mesh(furniture::bench()),
            bin: assets.add_mesh(furniture::bin()),
            bollard: assets.add_mesh(furniture::bollard()),
            shelter: assets.add_mesh(furniture::shelter()),
            hydrant: assets.add_mesh(furniture::hydrant()),
            planter: assets.add_mesh(furniture::planter()),
            rack: assets.add_mesh(furniture::rack()),
            letter_box: assets.add_mesh(furniture::letter_box()),
            cabinet: assets.add_mesh(furniture::cabinet()),
            manhole: assets.add_mesh(furniture::manhole()),
            power_pole: assets.add_mesh(power_line::power_pole()),
            poles: [0.0, 5.0].map(|arm_m| assets.add_mesh(signals::light_pole(arm_m))),
            signs: signs
                .map(|kind| (kind, assets.add_mesh(signals::sign(kind))))
                .collect(),
            cars: parked_cars::all()
                .map(|(mesh, shape)| (assets.add_mesh(mesh), shape))
                .collect(),
        }
    }
}
