//! What stands along the kerbs: lamps, trees, street furniture, power lines.

use nalgebra::{Isometry3, Vector3};
use schema_types::Class;

use crate::geometry::P2;
use crate::greenery::{street_tree, tree};
use crate::meshes::power_line::wires;
use crate::meshes::{Lamp, SharedMeshes};
use crate::network::{KERB_HEIGHT_M, Road};
use crate::random::Random;
use crate::scenery::{Builder, LampGroup, MapLayer, SceneryLamp, Standing};

/// Stream of random numbers.
const ROADSIDE: u64 = 0x72;
/// Distance between power poles.
const SPAN_M: f64 = 38.0;

/// Adds everything along one road.
pub fn roadside(builder: &mut Builder<'_>, meshes: &SharedMeshes, idx: usize) {
    let road = &builder.network.roads[idx];
    if road.tunnel {
        return;
    }
    let mut random = Random::new(builder.seed, ROADSIDE, idx as u64);
    if road.profile.one_way && road.profile.verge {
        masts(builder, meshes, road);
    } else if road.profile.verge && !road.profile.main && road.profile.n_lanes == 1 {
        power_line(builder, meshes, road);
        avenue(builder, meshes, road, &mut random);
    } else {
        street(builder, meshes, idx, &mut random);
    }
    road_decals(builder, meshes, road, &mut random);
}

/// Whether nothing passes over this station and the road lies on the ground.
fn is_open(builder: &Builder<'_>, road: &Road, s_m: f64) -> bool {
    let p = road.path.at(s_m).0;
    !road.is_on_bridge(s_m)
        && !builder
            .network
            .is_near_bridge(p, road.profile.back_m() + 1.0)
        || builder
            .network
            .roads
            .iter()
            .all(|other| other.bridge.is_none() || other.id == road.id && !road.is_on_bridge(s_m))
}

fn street(builder: &mut Builder<'_>, meshes: &SharedMeshes, idx: usize, random: &mut Random) {
    let road = &builder.network.roads[idx];
    let length = road.path.length_m();
    for side in [1.0, -1.0] {
        let trees = random.chance(0.8);
        let mut s = 7.0 + if side > 0.0 { 4.0 } else { 0.0 };
        let mut k = 0;
        while s < length - 7.0 {
            let at = |aside: f64| road.path.beside(s, side * (road.profile.kerb_m() + aside));
            let to_road = road.path.at(s).1 - side * std::f64::consts::FRAC_PI_2;
            let near_sign = (s - 14.0).abs() < 1.5 || (s - (length - 14.0)).abs() < 1.5;
            let z = road.elevation.at(s) + KERB_HEIGHT_M;
            let open = is_open(builder, road, s);
            match k % 3 {
                0 if open && (!road.profile.verge || road.profile.main) => {
                    lamp(builder, &meshes.lamp, at(0.55), z, to_road)
                }
                _ if near_sign || !open => {}
                1 | 2 if trees && !road.profile.verge => {
                    street_tree(builder, meshes, idx, at(0.9), random)
                }
                _ => {}
            }
            if !near_sign && !road.profile.verge && open {
                small_thing(
                    builder,
                    meshes,
                    road,
                    (s + 3.2).min(length - 6.0),
                    side,
                    to_road,
                    random,
                );
            }
            s += 8.5;
            k += 1;
        }
        for end in [5.6, 7.2] {
            for s in [end, length - end] {
                if road.profile.main && !road.profile.verge && length > 20.0 {
                    let p = road.path.beside(s, side * (road.profile.kerb_m() + 0.4));
                    builder.stand(
                        meshes.bollard,
                        Standing {
                            layer: MapLayer::Props,
                            class: Class::STATIC,
                            name: "bollard",
                        },
                        p,
                        KERB_HEIGHT_M,
                        0.0,
                    );
                }
            }
        }
    }
}

fn small_thing(
    builder: &mut Builder<'_>,
    meshes: &SharedMeshes,
    road: &Road,
    s: f64,
    side: f64,
    to_road: f64,
    random: &mut Random,
) {
    let at = |aside: f64| road.path.beside(s, side * (road.profile.kerb_m() + aside));
    let back = road.profile.pavement_m;
    let along = to_road + std::f64::consts::FRAC_PI_2;
    let draw = random.unit();
    let (mesh, class, name, aside, yaw) = match draw {
        ..0.09 => (meshes.bench, Class::STATIC, "bench", 1.0, to_road),
        ..0.20 => (meshes.bin, Class::DYNAMIC, "bin", 0.6, 0.0),
        ..0.25 => (meshes.hydrant, Class::STATIC, "hydrant", 0.55, to_road),
        ..0.31 => (meshes.planter, Class::VEGETATION, "planter", 0.8, along),
        ..0.35 => (meshes.rack, Class::STATIC, "bicycle_rack", 0.9, along),
        ..0.38 => (
            meshes.letter_box,
            Class::STATIC,
            "letter_box",
            back - 0.6,
            to_road,
        ),
        ..0.42 => (
            meshes.cabinet,
            Class::STATIC,
            "cabinet",
            back - 0.45,
            to_road,
        ),
        ..0.46 if road.profile.main => (meshes.shelter, Class::STATIC, "bus_stop", 1.9, to_road),
        _ => return,
    };
    let p = at(aside);
    if builder.is_free(p, 1.0) {
        builder.stand(
            mesh,
            Standing {
                layer: MapLayer::Props,
                class,
                name,
            },
            p,
            KERB_HEIGHT_M,
            yaw,
        );
    }
}

/// Tall lamps along motorways and ramps, on the right.
fn masts(builder: &mut Builder<'_>, meshes: &SharedMeshes, road: &Road) {
    let n = (road.path.length_m() / 45.0) as usize;
    for k in 0..n {
        let s = (k as f64 + 0.5) * road.path.length_m() / n as f64;
        if !is_open(builder, road, s) {
            continue;
        }
        let p = road.path.beside(s, -(road.profile.kerb_m() + 1.0));
        lamp(
            builder,
            &meshes.mast,
            p,
            road.elevation.at(s) + KERB_HEIGHT_M,
            road.path.at(s).1 + std::f64::consts::FRAC_PI_2,
        );
    }
}

/// Poles with wires on the left of a country road.
fn power_line(builder: &mut Builder<'_>, meshes: &SharedMeshes, road: &Road) {
    let length = road.path.length_m();
    let n = ((length - 30.0) / SPAN_M) as usize;
    let spot = |k: usize| {
        let s = 15.0 + (length - 30.0) * k as f64 / n.max(1) as f64;
        (
            road.path.beside(s, road.profile.back_m() + 2.2),
            road.path.at(s).1,
        )
    };
    if n < 2 {
        return;
    }
    let object = builder.object_in(Some(MapLayer::Props), Class::POLES, "power_line");
    let spots: Vec<(P2, f64)> = (0..=n)
        .map(spot)
        .filter(|(p, _)| !builder.is_on_driveway(*p))
        .collect();
    if !spots.iter().all(|(p, _)| builder.is_free(*p, 2.0)) {
        return;
    }
    for (p, heading) in &spots {
        let pole = builder.stand(
            meshes.power_pole,
            Standing {
                layer: MapLayer::Props,
                class: Class::POLES,
                name: "power_pole",
            },
            *p,
            0.0,
            *heading,
        );
        builder.pole_solid(pole, *p, 0.14, 8.0);
    }
    for pair in spots.windows(2) {
        wires(&mut builder.chunks, object, pair[0], pair[1]);
    }
}

/// Trees along country roads.
fn avenue(builder: &mut Builder<'_>, meshes: &SharedMeshes, road: &Road, random: &mut Random) {
    let length = road.path.length_m();
    let mut s = 12.0;
    while s < length - 12.0 {
        let side = if random.chance(0.6) { -1.0 } else { 1.0 };
        let p = road
            .path
            .beside(s, side * (road.profile.back_m() + random.between(3.6, 6.0)));
        let alone = builder
            .network
            .roads
            .iter()
            .all(|other| other.path.nearest(p).1 > other.profile.back_m() + 1.5);
        if alone && !builder.is_on_driveway(p) && builder.is_free(p, 2.0) && random.chance(0.75) {
            tree(builder, meshes, p, random);
        }
        s += random.between(9.0, 26.0);
    }
}

/// Manhole covers in the road, where no paint is.
fn road_decals(builder: &mut Builder<'_>, meshes: &SharedMeshes, road: &Road, random: &mut Random) {
    if road.profile.verge {
        return;
    }
    let mut s = random.between(9.0, 20.0);
    while s < road.path.length_m() - 9.0 {
        let side = if random.chance(0.5) { 1.0 } else { -1.0 };
        let p = road.path.beside(s, side * 0.5 * road.profile.lane_m);
        let object = builder.object_in(Some(MapLayer::Decals), Class::ROADS, "manhole");
        if road.elevation.is_level() {
            builder.stand_as(
                object,
                meshes.manhole,
                p,
                road.elevation.at(s),
                random.between(0.0, 3.0),
            );
        }
        s += random.between(24.0, 55.0);
    }
}

/// Adds a street lamp that can be switched.
fn lamp(builder: &mut Builder<'_>, lamp: &Lamp, p: P2, z_m: f64, yaw_rad: f64) {
    let object = builder.object_in(Some(MapLayer::StreetLights), Class::POLES, "street_lamp");
    builder.stand_as(object, lamp.mesh, p, z_m, yaw_rad);
    let light = Isometry3::new(Vector3::new(p.x, p.y, z_m), Vector3::z() * yaw_rad)
        * nalgebra::Point3::from(lamp.light_m);
    builder.lamps.push(SceneryLamp {
        object,
        position_m: light.coords.into(),
        rgb: [255, 226, 178],
        intensity_lm: lamp.intensity_lm,
        group: LampGroup::Street,
    });
    builder.pole_at(object, p, z_m, 0.1, lamp.height_m);
}
