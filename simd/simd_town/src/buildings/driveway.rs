//! Driveways beside houses, with a car on most of them.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::lot::{Lot, fits, overlap};
use crate::geometry::{P2, heading};
use crate::ground::Ring;
use crate::meshes::SharedMeshes;
use crate::network::KERB_HEIGHT_M;
use crate::random::Random;
use crate::scenery::{Builder, Layer, MapLayer, Standing};

/// Stream of random numbers.
const DRIVEWAYS: u64 = 0x77;
/// Half width of a driveway, its length, and the distance of its middle from the house.
const HALF_M: f64 = 1.4;
const LENGTH_M: f64 = 6.6;
const BESIDE_M: f64 = 2.8;
/// Distance between a driveway and another house, for the garden between them.
const APART_M: f64 = 1.2;
/// Distance between a driveway and a pole or a tree of the roadside.
const CLEAR_M: f64 = 0.5;
/// Greatest rise of the ground over a car's length on which a level car looks right, metres.
const MAX_RISE_M: f64 = 0.22;

/// Lays driveways where there is room and gives the plots they take; `front_m` is between houses
/// and pavement.
pub fn driveways(
    builder: &mut Builder<'_>,
    meshes: &SharedMeshes,
    ring: &Ring,
    idx: usize,
    lots: &[Lot],
    front_m: f64,
) -> Vec<Lot> {
    let mut random = Random::new(builder.seed, DRIVEWAYS, idx as u64);
    let mut driveways: Vec<Lot> = Vec::new();
    for lot in lots {
        let f = lot.footprint_m;
        let (along, out) = ((f[1] - f[0]).normalize(), (f[0] - f[3]).normalize());
        let width = (f[1] - f[0]).norm();
        let wanted = random.chance(0.6);
        let side = if random.chance(0.5) {
            -BESIDE_M
        } else {
            width + BESIDE_M
        };
        let plot = |grown: f64| {
            let corner = |u: f64, v: f64| f[0] + along * (side + u) + out * v;
            let (half, back) = (HALF_M + grown, front_m - LENGTH_M - grown);
            Lot {
                footprint_m: [
                    corner(-half, front_m),
                    corner(half, front_m),
                    corner(half, back),
                    corner(-half, back),
                ],
            }
        };
        let is_free = |lots: &[Lot], plot: &Lot| !lots.iter().any(|other| overlap(plot, other));
        let others: Vec<Lot> = lots
            .iter()
            .filter(|other| other.footprint_m != f)
            .cloned()
            .collect();
        if !wanted
            || !fits(&plot(0.0), ring)
            || !is_free(&others, &plot(APART_M))
            || !is_free(&driveways, &plot(APART_M))
        {
            continue;
        }
        let driveway_plot = plot(0.0);
        if driveway_plot
            .footprint_m
            .iter()
            .all(|p| builder.is_free(*p, 2.0))
        {
            driveway(builder, meshes, &driveway_plot, along, out, &mut random);
            builder.driveway_plots_m.push(plot(CLEAR_M).footprint_m);
            driveways.push(driveway_plot);
        }
    }
    driveways
}

fn driveway(
    builder: &mut Builder<'_>,
    meshes: &SharedMeshes,
    plot: &Lot,
    along: P2,
    out: P2,
    random: &mut Random,
) {
    let f = plot.footprint_m;
    let object = builder.object_in(Some(MapLayer::Ground), Class::GROUND, "drive");
    let slab = Surface::new(
        Class::GROUND,
        Material::Concrete,
        random.pick(&[[140, 132, 122], [112, 110, 108], [158, 140, 122]]),
    )
    .of(object);
    // The slab is laid in pieces, which follow the ground.
    for k in 0..4 {
        let (s, t) = (f64::from(k) / 4.0, f64::from(k + 1) / 4.0);
        let ends = |s: f64| [f[0] + (f[3] - f[0]) * s, f[1] + (f[2] - f[1]) * s];
        let ([a, b], [d, c]) = (ends(s), ends(t));
        let corners = [a, b, c, d].map(|p| {
            [
                p.x,
                p.y,
                builder.chunks.terrain.at(p) + KERB_HEIGHT_M + 0.02,
            ]
        });
        builder.chunks.sheet(Layer::Ground, 0..=1, slab, &corners);
    }
    let (mesh, shape) = random.pick(&meshes.cars);
    let nose_in = random.chance(0.7);
    let p = 0.25 * f.iter().sum::<P2>() - out * random.between(0.1, 0.7);
    let half = out * shape.half_m[0];
    let rise = builder.chunks.terrain.at(p + half) - builder.chunks.terrain.at(p - half);
    if !random.chance(0.8) || rise.abs() > MAX_RISE_M {
        return;
    }
    let yaw = heading(if nose_in { -out } else { out }) + random.between(-0.03, 0.03);
    let car = builder.stand(
        mesh,
        Standing {
            layer: MapLayer::ParkedVehicles,
            class: Class::CAR,
            name: "parked_car",
        },
        p,
        KERB_HEIGHT_M + 0.02,
        yaw,
    );
    let aside = along * shape.half_m[1];
    let z = builder.chunks.terrain.at(p) + KERB_HEIGHT_M;
    builder.solid.prism(
        car,
        &[
            p - half + aside,
            p - half - aside,
            p + half - aside,
            p + half + aside,
        ],
        (z, z + 2.0 * shape.half_m[2]),
    );
}
