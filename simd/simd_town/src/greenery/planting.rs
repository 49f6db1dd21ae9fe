//! Trees, bushes and parks.

use schema_types::Class;
use sensor_core::MeshId;

use crate::buildings::Lot;
use crate::geometry::{P2, contains, heading, left, unit};
use crate::ground::Ring;
use crate::meshes::SharedMeshes;
use crate::network::KERB_HEIGHT_M;
use crate::plan::Houses;
use crate::random::Random;
use crate::scenery::{Builder, MapLayer, Standing};

/// Streams of random numbers.
const PARK: u64 = 0x74;
const AVENUE: u64 = 0x76;
/// Palms grow along streets nearer to the equator than this.
const WARM_DEG: f64 = 36.0;

/// Plants trees where houses leave room: in corners and yards, along verges, and in a belt round
/// the town.
pub fn green_gaps(
    builder: &mut Builder<'_>,
    meshes: &SharedMeshes,
    ring: &Ring,
    lots: &[Lot],
    random: &mut Random,
) {
    let n = ring.back_m.len();
    let around: f64 = (0..n)
        .map(|i| (ring.back_m[(i + 1) % n] - ring.back_m[i]).norm())
        .sum();
    let country = matches!(builder.plan.houses, Houses::Cottages | Houses::Farms);
    let courts = builder.plan.green_courts;
    let apart_m = match (ring.outside, country || courts) {
        (true, _) => 9.0,
        (false, true) => 14.0,
        (false, false) => 42.0,
    };
    let wanted = (around / apart_m) as usize;
    let wanted = wanted.clamp(5, 330);
    let deepest = if ring.outside {
        95.0
    } else if courts {
        60.0
    } else if country {
        30.0
    } else {
        9.0
    };
    let clear = |p: P2| {
        let near = |lot: &Lot| {
            let middle = lot.footprint_m.iter().sum::<P2>() / 4.0;
            (middle - p).norm() < 22.0
                && (0..12).any(|k| contains(&lot.footprint_m, p + unit(f64::from(k) * 0.53) * 2.4))
        };
        !lots.iter().any(near)
    };
    let mut spots: Vec<P2> = Vec::new();
    for _ in 0..wanted * 8 {
        let i = random.below(n);
        let (a, b) = (ring.back_m[i], ring.back_m[(i + 1) % n]);
        let deep = random.between(2.3, deepest);
        let share = random.unit();
        if spots.len() >= wanted || (b - a).norm() < 1e-3 {
            continue;
        }
        let p = a + (b - a) * share + left((b - a).normalize()) * deep;
        let free = spots.iter().all(|q| (p - q).norm() > 4.5)
            && ring.back_m.iter().all(|q| (p - q).norm() > 2.0)
            && (contains(&ring.back_m, p) != ring.outside)
            && clear(p)
            && builder.is_free(p, 2.5);
        if free {
            spots.push(p);
        }
    }
    for p in spots {
        tree(builder, meshes, p, random);
    }
}

/// Plants a park: trees with lawns between them, and a hedge with benches in front of it.
pub fn park(builder: &mut Builder<'_>, meshes: &SharedMeshes, ring: &Ring) {
    let mut random = Random::new(builder.seed, PARK, 0);
    let n = ring.back_m.len();
    let middle = ring.back_m.iter().sum::<P2>() / n as f64;
    let mut spots: Vec<P2> = Vec::new();
    for _ in 0..900 {
        let p = middle + P2::new(random.between(-60.0, 60.0), random.between(-90.0, 90.0));
        let deep =
            contains(&ring.back_m, p) && contains(&ring.back_m, p + (p - middle).normalize() * 2.5);
        if spots.len() < 70
            && deep
            && builder.is_free(p, 1.0)
            && spots.iter().all(|q| (p - q).norm() > 5.5)
        {
            spots.push(p);
        }
    }
    for p in spots {
        tree(builder, meshes, p, &mut random);
    }
    for i in 0..n {
        let (a, b) = (ring.back_m[i], ring.back_m[(i + 1) % n]);
        let length = (b - a).norm();
        for k in 0..(length / 1.1) as usize {
            let p = a + (b - a) * ((k as f64 + 0.5) * 1.1 / length);
            let inward = left((b - a).normalize());
            if k % 12 > 1 {
                let yaw = random.between(0.0, std::f64::consts::TAU);
                builder.stand(
                    meshes.bush,
                    Standing {
                        layer: MapLayer::Foliage,
                        class: Class::VEGETATION,
                        name: "hedge",
                    },
                    p + inward * 0.7,
                    KERB_HEIGHT_M,
                    yaw,
                );
            }
            if k % 12 == 6 {
                builder.stand(
                    meshes.bench,
                    Standing {
                        layer: MapLayer::Props,
                        class: Class::STATIC,
                        name: "bench",
                    },
                    p + inward * 2.2,
                    KERB_HEIGHT_M,
                    heading(inward),
                );
            }
        }
    }
}

/// Plants a tree of a kind that suits the town.
pub fn tree(builder: &mut Builder<'_>, meshes: &SharedMeshes, p: P2, random: &mut Random) {
    let conifers = matches!(builder.plan.houses, Houses::Farms) || p.norm() > 330.0;
    let mesh = if conifers && random.chance(0.4) {
        random.pick(&meshes.conifers)
    } else {
        random.pick(&meshes.trees)
    };
    let yaw = random.between(0.0, std::f64::consts::TAU);
    plant(builder, mesh, p, yaw);
}

/// Plants a street tree: most trees of a street are of one kind.
pub fn street_tree(
    builder: &mut Builder<'_>,
    meshes: &SharedMeshes,
    road: usize,
    p: P2,
    random: &mut Random,
) {
    let mut kinds = Random::new(builder.seed, AVENUE, road as u64);
    let is_warm = builder.plan.lat_lon_deg.0.abs() < WARM_DEG;
    let usual = if is_warm && kinds.chance(0.45) {
        meshes.palm
    } else {
        kinds.pick(&meshes.trees)
    };
    let mesh = if random.chance(0.85) {
        usual
    } else {
        random.pick(&meshes.trees)
    };
    let yaw = random.between(0.0, std::f64::consts::TAU);
    plant(builder, mesh, p, yaw);
}

fn plant(builder: &mut Builder<'_>, mesh: MeshId, p: P2, yaw_rad: f64) {
    let object = builder.stand(
        mesh,
        Standing {
            layer: MapLayer::Foliage,
            class: Class::VEGETATION,
            name: "tree",
        },
        p,
        KERB_HEIGHT_M,
        yaw_rad,
    );
    builder.pole_solid(object, p, 0.17, 4.0);
}
