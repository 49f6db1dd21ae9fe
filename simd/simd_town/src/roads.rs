//! Roads as cameras see them and wheels feel them: asphalt, paint, wear, bridges, tunnels, rails,
//! sign bridges.

mod bridge;
mod guard_rail;
mod paint;
mod sign_bridge;
mod surface;
mod tunnel;
mod wear;

use schema_types::Class;

use crate::scenery::Builder;
pub use paint::{BAYS_M, n_bays};

/// Builds all roads and junctions.
pub fn build(builder: &mut Builder<'_>) {
    let network = builder.network;
    // Streets come first, so that their object numbers equal the ids of their roads.
    for road in &network.roads {
        let object = builder.object(Class::ROADS, "street");
        surface::road(
            &mut builder.chunks,
            &mut builder.floor,
            network,
            road,
            object,
        );
        wear::road(&mut builder.chunks, builder.seed, road);
    }
    for road in &network.roads {
        if road.bridge.is_some() {
            let object = builder.object(Class::BRIDGE, "bridge");
            bridge::build(
                &mut builder.chunks,
                &mut builder.solid,
                network,
                road,
                object,
            );
        }
        if road.tunnel {
            tunnel::build(builder, road);
        }
        if road.profile.has_rails() {
            let object = builder.object(Class::GUARD_RAIL, "guard_rail");
            guard_rail::rails(&mut builder.chunks, &mut builder.solid, road, object);
        }
        if road.profile.motorway {
            sign_bridge::build(builder, road);
        }
    }
    for idx in 0..network.junctions.len() {
        let object = builder.object(Class::ROADS, "junction");
        surface::junction(
            &mut builder.chunks,
            &mut builder.floor,
            network,
            idx,
            object,
        );
    }
}
