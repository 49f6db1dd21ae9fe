//! Imported maps: what their worlds contain, that they are reproducible, and that hostile maps cost
//! no more than honest ones.

use schema_roads::RoadMap;
use schema_types::Class;
use simd_town::Town;
use simd_town::imported::{ImportOptions, import};

use crate::clear_lanes;

const SMALL: &str = include_str!("../small.xodr");

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

/// Two roads that cross on a junction; the one from south to north arches over the other by
/// `hump_m`. A light and a sign stand in a lane and at the rim of one.
fn crossing(hump_m: f64) -> String {
    let lanes = |left: &str, right: &str| {
        let lane = |id: i32, link: &str| {
            format!(
                r#"<lane id="{id}" type="driving" level="false"><link>{link}</link><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>"#
            )
        };
        format!(
            r#"<lanes><laneSection s="0"><left>{}</left><center><lane id="0" type="none" level="false"/></center><right>{}</right></laneSection></lanes>"#,
            lane(1, left),
            lane(-1, right)
        )
    };
    let mut roads = String::new();
    let mut road = |id: u32,
                    at: [f64; 3],
                    length: f64,
                    junction: i32,
                    link: &str,
                    profile: &str,
                    signals: &str| {
        let [x, y, hdg] = at;
        let ends = r#"<predecessor id="ID"/><successor id="ID"/>"#;
        let of = |id: i32| {
            if junction > 0 {
                ends.replace("ID", &id.to_string())
            } else {
                String::new()
            }
        };
        roads += &format!(
            r#"<road name="" length="{length}" id="{id}" junction="{junction}"><link>{link}</link><planView><geometry s="0" x="{x}" y="{y}" hdg="{hdg}" length="{length}"><line/></geometry></planView><elevationProfile>{profile}</elevationProfile>{}<signals>{signals}</signals></road>"#,
            lanes(&of(1), &of(-1))
        );
    };
    let half = std::f64::consts::FRAC_PI_2;
    let flat = r#"<elevation s="0" a="0" b="0" c="0" d="0"/>"#;
    // Up to the hump over 10 m and down again, level at both ends and on top.
    let (c, d) = (3.0 * hump_m / 100.0, 2.0 * hump_m / 1000.0);
    let arch = format!(
        r#"<elevation s="0" a="0" b="0" c="{c}" d="{}"/><elevation s="10" a="{hump_m}" b="0" c="{}" d="{d}"/>"#,
        -d, -c
    );
    let signals = r#"<signal s="30" t="-1.5" id="21" name="" dynamic="yes" orientation="+" zOffset="0" type="1000001" subtype="-1" value="-1"/><signal s="20" t="-3.55" id="22" name="" dynamic="no" orientation="+" zOffset="0" type="274" subtype="50" value="50"/>"#;
    let to = |id: u32, contact: &str| {
        format!(r#"<successor elementType="road" elementId="{id}" contactPoint="{contact}"/>"#)
    };
    let from = |id: u32, contact: &str| {
        format!(r#"<predecessor elementType="road" elementId="{id}" contactPoint="{contact}"/>"#)
    };
    let into = r#"<successor elementType="junction" elementId="9"/>"#;
    let out = r#"<predecessor elementType="junction" elementId="9"/>"#;
    road(1, [-60.0, 0.0, 0.0], 50.0, -1, into, flat, signals);
    road(2, [10.0, 0.0, 0.0], 50.0, -1, out, flat, "");
    road(3, [0.0, -60.0, half], 50.0, -1, into, flat, "");
    road(4, [0.0, 10.0, half], 50.0, -1, out, flat, "");
    road(
        5,
        [-10.0, 0.0, 0.0],
        20.0,
        9,
        &(from(1, "end") + &to(2, "start")),
        flat,
        "",
    );
    road(
        6,
        [0.0, -10.0, half],
        20.0,
        9,
        &(from(3, "end") + &to(4, "start")),
        &arch,
        "",
    );
    let connection = |id: u32, from: u32, by: u32| {
        format!(
            r#"<connection id="{id}" incomingRoad="{from}" connectingRoad="{by}" contactPoint="start"><laneLink from="-1" to="-1"/></connection>"#
        )
    };
    format!(
        r#"<OpenDRIVE><header revMajor="1" revMinor="4" name="" version="1" north="0" south="0" east="0" west="0"/>{roads}<junction id="9" name="">{}{}</junction></OpenDRIVE>"#,
        connection(0, 1, 5),
        connection(1, 3, 6)
    )
}

/// Height of the highest road at a place.
fn road_height(town: &Town, x: f64, y: f64) -> f64 {
    let road = town
        .collision
        .iter()
        .find(|mesh| mesh.name == "road")
        .unwrap();
    let corner = |c: u32| {
        let p = road.vertices_m[c as usize].map(f64::from);
        [
            p[0] + town.origin_m[0],
            p[1] + town.origin_m[1],
            p[2] + town.origin_m[2],
        ]
    };
    let heights = road.triangles.iter().filter_map(|triangle| {
        let [a, b, c] = triangle.map(corner);
        let cross =
            |p: [f64; 3], q: [f64; 3]| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
        let w = [cross(b, c), cross(c, a), cross(a, b)];
        let sum: f64 = w.iter().sum();
        let is_in = sum.abs() > 1e-9 && w.iter().all(|w| w / sum >= -1e-6);
        is_in.then(|| (w[0] * a[2] + w[1] * b[2] + w[2] * c[2]) / sum)
    });
    heights.fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn lanes_that_cross_in_a_junction_have_one_surface() {
    let town = world(&crossing(0.4), &ImportOptions::default());
    for aside in [-2.6, -1.75, -0.9, 0.9, 1.75, 2.6] {
        for by_east in [true, false] {
            let at = |i: i32| {
                let along = -14.0 + 0.1 * f64::from(i);
                let [x, y] = if by_east {
                    [along, aside]
                } else {
                    [aside, along]
                };
                road_height(&town, x, y)
            };
            for i in 1..=280 {
                let step_m = (at(i) - at(i - 1)).abs();
                assert!(
                    step_m < 0.045,
                    "a step of {step_m:.3} m, {:.1} m from the middle of the junction, {aside} m aside",
                    -14.0 + 0.1 * f64::from(i)
                );
            }
        }
    }
    // The roads outside are where they were.
    for [x, y] in [[-12.0, 1.75], [12.0, -1.75], [1.75, -12.0], [-1.75, 12.0]] {
        assert!(road_height(&town, x, y).abs() < 1e-3);
    }
    // Level lanes are left alone.
    let level = world(&crossing(0.0), &ImportOptions::default());
    let n = |town: &Town| town.collision[0].triangles.len();
    assert!(n(&level) < n(&town));
}

/// Such a section has one row of points, and nothing lies between rows.
#[test]
fn a_section_of_half_a_millimetre_in_a_junction_changes_nothing() {
    let plain = crossing(0.4);
    let last = r#"<laneSection s="19.9995"><left><lane id="1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left><center><lane id="0" type="none" level="false"/></center><right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes>"#;
    let split = plain.replace("</lanes>", last);
    let [plain, split] = [plain, split].map(|text| world(&text, &ImportOptions::default()));
    for [x, y] in [[0.9, 1.75], [-1.75, 4.0], [-9.0, -1.75]] {
        let difference = road_height(&plain, x, y) - road_height(&split, x, y);
        assert!(difference.abs() < 0.02, "{difference} at {x}, {y}");
    }
}

#[test]
fn posts_of_signals_stand_beside_the_lanes() {
    let text = crossing(0.0);
    let town = world(&text, &ImportOptions::default());
    let roads = RoadMap::parse(&text).unwrap();
    let has = |name: &str| town.objects.iter().any(|it| it.name.starts_with(name));
    assert!(has("traffic light pole") && has("sign"));
    assert_eq!(
        clear_lanes::solids_in_lanes(&town, &roads),
        Vec::<String>::new()
    );
    let solid = town
        .collision
        .iter()
        .find(|mesh| mesh.name == "buildings and poles")
        .unwrap();
    for name in ["traffic light pole", "sign"] {
        let id = town
            .objects
            .iter()
            .find(|it| it.name.starts_with(name))
            .unwrap()
            .id;
        assert!(solid.objects.contains(&id), "{name} is solid");
    }
}
