//! Trigger boxes of lights and signs for the actor list: the places on lanes at which a vehicle is
//! before them.

use nalgebra::Point3;
use schema_frames::document::BodyBox;
use schema_roads::{RoadMap, Signal, SignalKind};

use super::stop_box::{STOP_BOX_HALF_WIDTH_RATIO, STOP_BOX_UPSTREAM_M, StopBox, stop_box};

/// Half width of a speed limit's box as a share of its lane's width.
pub(super) const LIMIT_HALF_WIDTH_RATIO: f64 = 0.35;
/// Half height of a box, which stands on the lane, metres.
const HALF_HEIGHT_M: f64 = 1.0;

/// The box around all places on lanes at which vehicles are before a signal, in the signal's space;
/// `None` if the signal is for no lane.
pub(crate) fn trigger_box(roads: &RoadMap, signal: &Signal) -> Option<BodyBox> {
    let (upstream_m, half_width_ratio) = match signal.kind {
        SignalKind::SpeedLimit | SignalKind::Other => (0.0, LIMIT_HALF_WIDTH_RATIO),
        SignalKind::TrafficLight | SignalKind::Stop | SignalKind::Yield => {
            (STOP_BOX_UPSTREAM_M, STOP_BOX_HALF_WIDTH_RATIO)
        }
    };
    let boxes = signal
        .stops
        .iter()
        .filter_map(|stop| stop_box(roads, stop.stop, upstream_m, half_width_ratio));
    let corners = boxes
        .flat_map(|stop_box| corners(&stop_box))
        .map(|corner| signal.pose.inverse_transform_point(&corner));
    let (low, high) = corners.fold(None, |range: Option<(Point3<f64>, Point3<f64>)>, corner| {
        Some(range.map_or((corner, corner), |(low, high)| {
            (low.inf(&corner), high.sup(&corner))
        }))
    })?;
    let (centre, half) = (nalgebra::center(&low, &high), 0.5 * (high - low));
    Some(BodyBox {
        centre_m: centre.coords.cast::<f32>().into(),
        half_m: half.cast::<f32>().into(),
    })
}

fn corners(stop_box: &StopBox) -> impl Iterator<Item = Point3<f64>> + use<> {
    let ([along_m, across_m], world_from_box) = (stop_box.half_m, stop_box.world_from_box);
    (0..8).map(move |i| {
        let side = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
        world_from_box
            * Point3::new(
                along_m * side(1),
                across_m * side(2),
                HALF_HEIGHT_M * (1.0 + side(4)),
            )
    })
}
