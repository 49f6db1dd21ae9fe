//! Asphalt of roads and junctions.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::paint;
use crate::ground::{Border, Fill};
use crate::network::kerb::border;
use crate::network::{Network, Road};
use crate::scenery::{ALL, Chunks, Floor, Layer};

fn asphalt(object: ObjectId) -> Surface {
    Surface::new(Class::ROADS, Material::Asphalt, [80, 80, 81]).of(object)
}

/// Asphalt and paint of a road.
pub fn road(
    chunks: &mut Chunks,
    floor: &mut Floor,
    network: &Network,
    road: &Road,
    object: ObjectId,
) {
    let kerb = road.profile.kerb_m();
    for pair in road.stations.windows(2) {
        let at = |s: f64, t: f64| road.point(s, t, 0.0);
        let corners = [
            at(pair[0], -kerb),
            at(pair[1], -kerb),
            at(pair[1], kerb),
            at(pair[0], kerb),
        ];
        chunks.sheet(Layer::Ground, ALL, asphalt(object), &corners);
        floor.road.polygon(object, &corners);
    }
    paint::road(chunks, network, road, object);
}

/// Asphalt and paint of a junction: the area between the roads' ends.
pub fn junction(
    chunks: &mut Chunks,
    floor: &mut Floor,
    network: &Network,
    idx: usize,
    object: ObjectId,
) {
    let junction = &network.junctions[idx];
    let border = border(network, idx);
    let heights = vec![junction.height_m; border.len()];
    let fill = Fill::of(
        &Border {
            points_m: &border,
            heights_m: &heights,
            outside: false,
        },
        false,
        0.0,
        &[],
    );
    for triangle in &fill.triangles {
        let corners = triangle.map(|i| [fill.points_m[i].x, fill.points_m[i].y, junction.height_m]);
        chunks.sheet(Layer::Ground, ALL, asphalt(object), &corners);
        floor.road.polygon(object, &corners);
    }
    paint::junction(chunks, network, idx, object);
}
