//! What must stand in every town.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};
use sensor_core::Material;
use simd_town::Town;

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

/// Street lamps, windows and tunnel lamps come on at night by themselves; parked cars do not.
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
            // The box is 5 cm smaller on every side, so that the ground does not count as an
            // obstacle.
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
