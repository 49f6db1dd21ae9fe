//! Outfits, and coarse levels of doors.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use sensor_core::Material;
use simd_body::{BodyStyle, Outfit, VehicleShape, door_meshes, outfitted_meshes, vehicle_meshes};

const SALOON: VehicleShape = VehicleShape {
    style: BodyStyle::Saloon,
    half_m: [2.5, 1.05, 0.82],
    wheel_radius_m: 0.34,
    wheelbase_m: 2.95,
};
const VAN: VehicleShape = VehicleShape {
    style: BodyStyle::Van,
    half_m: [3.18, 1.18, 1.22],
    wheel_radius_m: 0.35,
    wheelbase_m: 3.9,
};
const LORRY: VehicleShape = VehicleShape {
    style: BodyStyle::Lorry,
    half_m: [4.23, 1.3, 1.91],
    wheel_radius_m: 0.5,
    wheelbase_m: 4.9,
};

#[test]
fn outfits_stay_within_the_box_and_flash_where_they_should() {
    for (shape, outfit, flashes) in [
        (SALOON, Outfit::Police, true),
        (SALOON, Outfit::Taxi, false),
        (VAN, Outfit::Ambulance, true),
        (LORRY, Outfit::FireEngine, true),
        (LORRY, Outfit::Drinks, false),
    ] {
        let (plain, body) = (
            vehicle_meshes(&shape).body,
            outfitted_meshes(&shape, outfit).body,
        );
        let top = |mesh: &sensor_core::Mesh, level: usize| {
            let lod = mesh.lods[level];
            let used =
                &mesh.indices[lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize];
            used.iter()
                .map(|i| mesh.vertices[*i as usize].position_m[2])
                .fold(0.0f32, f32::max)
        };
        for level in 0..4 {
            assert!(
                (top(&body, level) - 2.0 * shape.half_m[2] as f32).abs() < 0.0101,
                "{outfit:?} {level}: {}",
                top(&body, level)
            );
        }
        assert!((top(&plain, 0) - top(&body, 0)).abs() < 0.0101);
        let bits: BTreeSet<u8> = body
            .vertices
            .iter()
            .filter(|v| v.material == Material::Lamp as u8)
            .map(|v| v.lamp)
            .collect();
        assert_eq!(
            bits.contains(&8) && bits.contains(&9),
            flashes,
            "{outfit:?}: {bits:?}"
        );
        let n = |level: usize| body.lods[level].n_indices / 3;
        assert!(
            n(0) < 2600 && n(2) < 460,
            "{outfit:?}: {} and {} triangles",
            n(0),
            n(2)
        );
    }
}

/// Coarse levels of a door have few triangles and fill the same box.
#[test]
fn doors_have_levels_of_detail_that_fill_the_same_box() {
    for shape in [SALOON, VAN] {
        for door in door_meshes(&shape).expect("its doors open").doors {
            let extent = |level: usize| {
                let lod = door.mesh.lods[level];
                let used = &door.mesh.indices
                    [lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize];
                let corners = used
                    .iter()
                    .map(|i| Vector3::from(door.mesh.vertices[*i as usize].position_m));
                corners.fold(
                    (Vector3::repeat(f32::MAX), Vector3::repeat(f32::MIN)),
                    |(low, high), p| (low.inf(&p), high.sup(&p)),
                )
            };
            let n = |level: usize| door.mesh.lods[level].n_indices / 3;
            assert_eq!(door.mesh.lods.len(), 3);
            assert!(
                n(1) < n(0) && n(2) < n(1) && n(2) <= 8,
                "{:?}: {} {} {}",
                shape.style,
                n(0),
                n(1),
                n(2)
            );
            let (low, high) = extent(0);
            for level in 1..3 {
                let (a, b) = extent(level);
                assert!(
                    (a - low).amax() < 0.05 && (b - high).amax() < 0.05,
                    "{:?} {level}: {a} {low} {b} {high}",
                    shape.style
                );
            }
        }
    }
}
