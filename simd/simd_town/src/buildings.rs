//! Houses with their entrances, gardens and driveways.

mod driveway;
mod entrance;
mod garden;
mod house;
mod lot;

use schema_types::Class;

use crate::geometry::{P2, contains};
use crate::ground::Ring;
use crate::meshes::SharedMeshes;
use crate::plan::Houses;
use crate::random::Random;
use crate::scenery::{Builder, MapLayer, SceneryLamp};
pub use house::build;
pub use lot::Lot;

/// Stream of random numbers of the houses.
const LOTS: u64 = 0x71;

/// Builds the houses of a block with their gardens and driveways. Returns the plots that are taken,
/// and the random stream, from which the block's trees are drawn next.
pub fn houses(
    builder: &mut Builder<'_>,
    meshes: &SharedMeshes,
    ring: &Ring,
    idx: usize,
) -> (Vec<Lot>, Random) {
    let mut random = Random::new(builder.seed, LOTS, idx as u64);
    let houses = match builder.plan.houses {
        Houses::Towers { .. } if ring.outside => Houses::Towers { within_m: 0.0 },
        Houses::Cottages if ring.outside => Houses::Farms,
        _ if !ring.outside
            && builder
                .plan
                .cottages_m
                .iter()
                .any(|&p| contains(&ring.kerb_m, p)) =>
        {
            Houses::Cottages
        }
        other => other,
    };
    let mut lots = lot::lots(ring, houses, &mut random);
    lots.retain(|lot| {
        let f = &lot.footprint_m;
        (0..4).all(|i| {
            builder.is_free(f[i], 3.0) && builder.is_free(0.5 * (f[i] + f[(i + 1) % 4]), 3.0)
        })
    });
    let mut built = Vec::new();
    for lot in &lots {
        let object = builder.object_in(Some(MapLayer::Buildings), Class::BUILDINGS, "building");
        let height_m = build(
            &mut builder.chunks,
            &mut builder.solid,
            lot,
            houses,
            object,
            &mut random,
        );
        let middle = lot.footprint_m.iter().sum::<P2>() / 4.0;
        let ground_m = builder.chunks.terrain.at(middle);
        builder.lamps.push(SceneryLamp::windows(
            object,
            [middle.x, middle.y, ground_m + 0.5 * height_m],
        ));
        built.push(object);
    }
    if matches!(houses, Houses::Cottages | Houses::Farms) {
        for (lot, house) in lots.iter().zip(built) {
            garden::build(builder, lot, house, houses, &mut random);
        }
        let front_m = if houses == Houses::Farms { 5.4 } else { 3.1 };
        let drives = driveway::driveways(builder, meshes, ring, idx, &lots, front_m);
        lots.extend(drives);
    }
    (lots, random)
}
