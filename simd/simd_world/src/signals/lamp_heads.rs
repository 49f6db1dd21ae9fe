//! The boxes of a traffic light's lamp heads.

use nalgebra::{Isometry3, Vector3};
use schema_frames::PosedBox;
use schema_frames::document::PoseText;
use schema_types::Pose;

use super::traffic_lights::TrafficLight;
use crate::map_data::MapData;

/// Boxes of a light's lamp heads in the world; empty if the map shows none.
pub(crate) fn lamp_head_boxes(light: &TrafficLight, map: &MapData) -> Vec<PosedBox> {
    let heads = map
        .lights
        .iter()
        .find(|site| *site.signal_id == *light.signal_id)
        .map_or(&[][..], |site| &site.heads);
    let corners = map
        .light_head
        .vertices
        .iter()
        .map(|vertex| Vector3::from(vertex.position_m.map(f64::from)));
    let range = corners.fold(None, |range: Option<(Vector3<f64>, Vector3<f64>)>, at| {
        Some(range.map_or((at, at), |(low, high)| (low.inf(&at), high.sup(&at))))
    });
    let Some((low, high)) = range else {
        return Vec::new();
    };
    let boxed = |head: &Isometry3<f64>| PosedBox {
        pose: PoseText::from(Pose::from(head * Isometry3::from(0.5 * (low + high)))),
        half_m: (0.5 * (high - low)).into(),
    };
    heads.iter().map(boxed).collect()
}
