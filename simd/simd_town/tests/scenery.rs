//! What must stand in every town, and what sets vehicles of one body apart.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};
use sensor_core::Material;
use simd_town::{
    BodyStyle, Outfit, Town, VehicleShape, door_meshes, outfitted_meshes, vehicle_meshes,
};

/// Objects by what their names begin with.
fn counts(town: &Town) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for object in &town.objects {
        let kind = object
            .name
            .trim_end_matches(|c: char| c.is_ascii_digit())
            .trim_end_matches('_');
        *counts.entry(kind.to_owned()).or_insert(0) += 1;
    }
    counts
}

#[test]
fn every_town_has_streets_houses_trees_lamps_signs_lights_and_parked_cars() {
    for name in Town::NAMES {
        let town = Town::generate(name, 1).expect("a name of the list");
        let counts = counts(&town);
        let least = [
            ("street", 15),
            ("junction", 10),
            ("pavement", 5),
            ("building", 20),
            ("tree", 250),
            ("hedge", 30),
            ("street_lamp", 20),
            ("traffic_light_pole", 9),
            ("traffic_sign", 20),
            ("parked_car", 3),
            ("wood", 20),
        ];
        for (kind, least) in least {
            let n = counts.get(kind).copied().unwrap_or(0);
            assert!(
                n >= least,
                "{name} has {n} of {kind}, {least} at least are wanted"
            );
        }
        // Where houses stand close together, cars stand between them.
        let dense = !matches!(name, "Town06" | "Town07");
        assert!(
            !dense || counts["parked_car"] >= 15,
            "{name}: {}",
            counts["parked_car"]
        );
        let has_water = matches!(name, "Town01" | "Town04" | "Town06" | "Town07");
        assert_eq!(counts.contains_key("pond"), has_water, "{name}");
    }
}

/// What shines at night by itself is a street lamp, a window, a tunnel's lamp: no car that nobody
/// sits in.
#[test]
fn parked_cars_have_no_lamps_that_come_on_at_dusk() {
    let town = Town::generate("Town10HD", 1).expect("a name of the list");
    let cars: BTreeSet<u32> = town
        .objects
        .iter()
        .filter(|object| object.name.starts_with("parked_car"))
        .map(|object| object.id.0)
        .collect();
    let (mut n_cars, mut n_posts) = (0, 0);
    for each in &town.assets.statics {
        let has_lamp = town
            .assets
            .mesh(each.mesh)
            .vertices
            .iter()
            .any(|vertex| vertex.material == Material::Lamp as u8);
        let is_car = cars.contains(&each.object.0);
        assert!(
            !(is_car && has_lamp),
            "{} shines",
            town.assets.mesh(each.mesh).name
        );
        n_cars += usize::from(is_car);
        n_posts += usize::from(has_lamp);
    }
    assert!(
        n_cars > 50 && n_posts > 100,
        "{n_cars} cars, {n_posts} lamps"
    );
}

/// Parked cars stand on ground of their own: no house, hedge, tree or other car reaches into their
/// box.
#[test]
fn cars_on_drives_touch_nothing() {
    for name in ["Town01", "Town04", "Town07"] {
        let town = Town::generate(name, 2).expect("a name of the list");
        let solid = town
            .collision
            .iter()
            .find(|mesh| mesh.name == "buildings and poles")
            .expect("a town has houses");
        for car in town
            .objects
            .iter()
            .filter(|object| object.name.starts_with("parked_car"))
        {
            let box_from_world = car.box_pose.isometry().inverse();
            // A hand's breadth less aside; the ground itself is no obstacle.
            let half = Vector3::from(car.box_half_m) - Vector3::new(0.05, 0.05, 0.05);
            for (corners, object) in solid
                .triangles
                .iter()
                .zip(&solid.objects)
                .filter(|(_, object)| **object != car.id)
            {
                let at = corners.map(|i| {
                    box_from_world
                        * Point3::from(Vector3::from(solid.vertices_m[i as usize]).cast::<f64>())
                });
                let enters = (0..3).any(|k| enters(at[k], at[(k + 1) % 3], half));
                let other = || {
                    town.objects
                        .iter()
                        .find(|each| each.id == *object)
                        .map_or("nothing", |each| each.name.as_str())
                };
                assert!(
                    !enters,
                    "{name}: {} stands in {} at {:?}: {at:?}",
                    other(),
                    car.name,
                    car.box_pose.translation_m
                );
            }
        }
    }
}

/// Whether the straight line from `a` to `b` enters the box about the origin.
fn enters(a: Point3<f64>, b: Point3<f64>, half: Vector3<f64>) -> bool {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for i in 0..3 {
        let way = b[i] - a[i];
        if way.abs() < 1e-9 {
            if a[i].abs() >= half[i] {
                return false;
            }
            continue;
        }
        let (p, q) = ((-half[i] - a[i]) / way, (half[i] - a[i]) / way);
        (from, to) = (from.max(p.min(q)), to.min(p.max(q)));
    }
    from < to
}

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

/// From afar a door is a few triangles in the same place.
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
