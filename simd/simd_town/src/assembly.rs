//! Puts a town together: roads, blocks, roadsides, in the order in which objects get their ids.

use schema_types::Class;

use crate::buildings::houses;
use crate::geometry::contains;
use crate::ground::{self, Ring, rings};
use crate::meshes::SharedMeshes;
use crate::network::Network;
use crate::plan::{Houses, Plan};
use crate::scenery::{Builder, MapLayer, Scenery};
use crate::{greenery, roads, roadside};

/// Builds the scenery of a network.
pub fn build(plan: &Plan, network: &Network, seed: u64) -> Scenery {
    let rings = rings(network, plan);
    let terrain = ground::terrain(network, &rings, plan.hills_m);
    let mut builder = Builder::new(plan, network, seed, terrain);
    roads::build(&mut builder);
    let meshes = SharedMeshes::new(plan, &mut builder.assets);
    blocks(&mut builder, &meshes, &rings);
    for road in 0..network.roads.len() {
        roadside::roadside(&mut builder, &meshes, road);
        roadside::parked(&mut builder, &meshes, road);
    }
    for signal in &network.signals {
        roadside::signal(&mut builder, &meshes, signal);
    }
    builder.finish()
}

fn blocks(builder: &mut Builder<'_>, meshes: &SharedMeshes, rings: &[Ring]) {
    for (i, ring) in rings.iter().enumerate() {
        let object = builder.object(Class::SIDEWALKS, "pavement");
        ground::pavement(&mut builder.chunks, &mut builder.floor, ring, object);
        let park = !ring.outside
            && builder
                .plan
                .parks_m
                .iter()
                .any(|&p| contains(&ring.kerb_m, p));
        let open =
            ring.fronted.iter().filter(|&&fronted| !fronted).count() * 2 > ring.fronted.len();
        let green = park
            || open
            || ring.outside
            || builder.plan.green_courts
            || matches!(builder.plan.houses, Houses::Cottages | Houses::Farms);
        let (layer, class) = if green {
            (None, Class::TERRAIN)
        } else {
            (Some(MapLayer::Ground), Class::GROUND)
        };
        let object = builder.object_in(layer, class, "block");
        ground::block(&mut builder.chunks, &mut builder.floor, ring, green, object);
        for pond in &ring.ponds {
            let object = builder.object(Class::WATER, "pond");
            ground::pond(&mut builder.chunks, pond, object);
        }
        if ring.outside {
            greenery::forest(builder, &ring.back_m);
        }
        if park {
            greenery::park(builder, meshes, ring);
        } else {
            let (lots, mut random) = houses(builder, meshes, ring, i);
            greenery::green_gaps(builder, meshes, ring, &lots, &mut random);
        }
    }
}
