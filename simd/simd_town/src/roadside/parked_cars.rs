//! Cars in the parking bays.

use schema_types::Class;

use crate::geometry::{left, unit};
use crate::meshes::SharedMeshes;
use crate::plan::Edge;
use crate::random::Random;
use crate::roads::{BAYS_M, n_bays};
use crate::scenery::{Builder, MapLayer, Standing};

/// Stream of random numbers.
const PARKING: u64 = 0x73;

/// Cars in the parking bays.
pub fn parked(builder: &mut Builder<'_>, meshes: &SharedMeshes, idx: usize) {
    let road = &builder.network.roads[idx];
    if road.profile.edge != Edge::Parking {
        return;
    }
    let mut random = Random::new(builder.seed, PARKING, idx as u64);
    for side in [1.0, -1.0] {
        for k in 0..n_bays(road) {
            if !random.chance(0.62) {
                continue;
            }
            let (mesh, shape) = random.pick(&meshes.cars);
            let s = BAYS_M.0 + (k as f64 + 0.5) * BAYS_M.1 + random.between(-0.25, 0.25);
            // Bays in bends stay empty, because a passing lorry needs the room.
            if (road.path.at(s - 9.0).1 - road.path.at(s + 9.0).1).abs() > 0.02 {
                continue;
            }
            let p = road.path.beside(
                s,
                side * (road.profile.driving_m()
                    + 0.5 * road.profile.edge_m
                    + random.between(0.06, 0.14)),
            );
            let yaw = road.path.at(s).1
                + if side > 0.0 {
                    std::f64::consts::PI
                } else {
                    0.0
                }
                + random.between(-0.02, 0.02);
            let object = builder.stand(
                mesh,
                Standing {
                    layer: MapLayer::ParkedVehicles,
                    class: Class::CAR,
                    name: "parked_car",
                },
                p,
                0.0,
                yaw,
            );
            let z = builder.chunks.terrain.at(p);
            let (u, v) = (
                unit(yaw) * shape.half_m[0],
                left(unit(yaw)) * shape.half_m[1],
            );
            let footprint = [p - u - v, p + u - v, p + u + v, p - u + v];
            builder
                .solid
                .prism(object, &footprint, (z + 0.15, z + 2.0 * shape.half_m[2]));
        }
    }
}
