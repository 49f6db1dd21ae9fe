//! Imported maps: what their worlds contain, that they are reproducible, and that hostile maps cost
//! no more than honest ones.

use schema_roads::RoadMap;
use schema_types::Class;
use simd_town::Town;
use simd_town::imported::{ImportOptions, import};

const SMALL: &str = include_str!("small.xodr");

fn world(text: &str, options: &ImportOptions) -> Town {
    import("small", text, &RoadMap::parse(text).unwrap(), 3, options).unwrap()
}

#[test]
fn a_small_map_becomes_a_whole_world() {
    let roads = RoadMap::parse(SMALL).unwrap();
    assert!(roads.warnings().is_empty(), "{:?}", roads.warnings());
    let town = world(SMALL, &ImportOptions::default());
    let has = |class: Class, name: &str| {
        town.objects
            .iter()
            .any(|o| o.class == class && o.name.starts_with(name))
    };
    assert!(
        has(Class::ROADS, "road 1")
            && has(Class::ROADS, "junction 5")
            && has(Class::TERRAIN, "ground")
    );
    assert!(
        has(Class::BUILDINGS, "building")
            && has(Class::VEGETATION, "tree")
            && has(Class::WALLS, "barrier")
    );
    assert!(
        has(Class::TRAFFIC_SIGNS, "sign")
            && has(Class::POLES, "street lamp")
            && has(Class::ROAD_LINES, "road marks")
    );
    assert_eq!(
        town.lights
            .iter()
            .map(|light| light.signal_id.as_str())
            .collect::<Vec<_>>(),
        ["9", "11"]
    );
    // The one over the lane hangs from a mast beside the road.
    assert_eq!(
        town.lights
            .iter()
            .map(|light| light.heads.len())
            .collect::<Vec<_>>(),
        [1, 2]
    );
    assert!(town.spawn_points.len() >= 8, "{}", town.spawn_points.len());
    assert!(!town.lamps.is_empty());
    for mesh in town
        .collision
        .iter()
        .filter(|mesh| !mesh.triangles.is_empty())
    {
        assert_eq!(mesh.objects.len(), mesh.triangles.len(), "{}", mesh.name);
        assert!(mesh.vertices_m.iter().flatten().all(|x| x.is_finite()));
    }
    // Speed limits in miles per hour keep their number.
    assert!(
        town.assets
            .meshes
            .iter()
            .any(|mesh| mesh.name.contains("limit(30)"))
    );
}

#[test]
fn options_and_seeds_change_what_they_should_and_nothing_else() {
    let (a, b) = (
        world(SMALL, &ImportOptions::default()),
        world(SMALL, &ImportOptions::default()),
    );
    assert_eq!(a.objects, b.objects);
    assert!(
        a.collision
            .iter()
            .zip(&b.collision)
            .all(|(a, b)| a.vertices_m == b.vertices_m && a.triangles == b.triangles)
    );
    let bare = world(
        SMALL,
        &ImportOptions {
            roadside: false,
            wall_height_m: 1.5,
            ..ImportOptions::default()
        },
    );
    assert!(
        bare.objects
            .iter()
            .any(|o| o.class == Class::WALLS && o.name.starts_with("wall"))
    );
    assert!(
        bare.objects
            .iter()
            .filter(|o| o.class == Class::BUILDINGS)
            .count()
            < a.objects
                .iter()
                .filter(|o| o.class == Class::BUILDINGS)
                .count()
    );
    let hidden = world(
        SMALL,
        &ImportOptions {
            visible: false,
            ..ImportOptions::default()
        },
    );
    assert!(hidden.assets.statics.is_empty() && !hidden.collision[0].triangles.is_empty());
}

/// Values are replaced by hostile numbers, elements repeated, bytes changed. The import must return
/// a world or an error, within the limits of size.
#[test]
fn worlds_of_mutated_maps_stay_within_their_bounds() {
    const NUMBERS: [&str; 14] = [
        "0",
        "-1",
        "1e9",
        "-1e9",
        "1e308",
        "NaN",
        "1e-12",
        "999999",
        "4294967295",
        "0.5",
        "-0.0000001",
        "127",
        "-128",
        "50000",
    ];
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut random = |n: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % n as u64) as usize
    };
    let (mut worlds, mut refused) = (0, 0);
    for _ in 0..80 {
        let mut text = SMALL.as_bytes().to_vec();
        for _ in 0..1 + random(4) {
            let quotes: Vec<usize> = text
                .iter()
                .enumerate()
                .filter(|(_, b)| **b == b'"')
                .map(|(i, _)| i)
                .collect();
            match random(10) {
                0 => text[random(SMALL.len() / 2)] = b'0' + random(10) as u8,
                _ => {
                    let pair = (1 + random(quotes.len() / 2 - 1)) * 2;
                    text.splice(
                        quotes[pair] + 1..quotes[pair + 1],
                        NUMBERS[random(NUMBERS.len())].bytes(),
                    );
                }
            }
        }
        let text = String::from_utf8_lossy(&text).into_owned();
        let Ok(roads) = RoadMap::parse(&text) else {
            continue;
        };
        match import("mutant", &text, &roads, 1, &ImportOptions::default()) {
            Ok(town) => {
                worlds += 1;
                let triangles: usize = town.collision.iter().map(|mesh| mesh.triangles.len()).sum();
                assert!(
                    triangles < 5_000_000
                        && town.objects.len() < 200_000
                        && town.spawn_points.len() <= 5_000,
                    "{triangles}"
                );
                assert!(
                    town.collision.iter().all(|mesh| mesh
                        .vertices_m
                        .iter()
                        .flatten()
                        .all(|x| x.is_finite()))
                );
            }
            Err(error) => {
                refused += 1;
                assert!(error.to_string().contains("too large"), "{error}");
            }
        }
    }
    assert!(worlds > 30, "{worlds} worlds, {refused} refused");
}
