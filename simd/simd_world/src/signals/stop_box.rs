//! Boxes on lanes that tell which vehicles are before a light or a sign.

use nalgebra::{Isometry3, Vector3};
use schema_roads::{LanePosition, RoadMap};
use serde::{Deserialize, Serialize};

/// Half length of the box before a stop line, and how far upstream its middle lies, metres.
const STOP_BOX_HALF_M: f64 = 1.5;
pub(crate) const STOP_BOX_UPSTREAM_M: f64 = 3.0;
/// Half width of a box as a share of its lane's width.
pub(crate) const STOP_BOX_HALF_WIDTH_RATIO: f64 = 0.25;

/// A box on a lane; a vehicle in it is before the light or sign.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct StopBox {
    #[serde(with = "crate::serde_forms::isometry")]
    pub world_from_box: Isometry3<f64>,
    /// Along and across the lane, metres.
    pub half_m: [f64; 2],
}

impl StopBox {
    /// Whether a vehicle's body overlaps the box: a separating-axis test of two upright boxes in
    /// the plane. The vehicle must be at most 2 m higher or lower and point in the lane's
    /// direction.
    pub fn overlaps(&self, world_from_vehicle: &Isometry3<f64>, half_m: [f64; 3]) -> bool {
        let box_from_vehicle = self.world_from_box.inv_mul(world_from_vehicle);
        let along = box_from_vehicle * Vector3::x();
        let aside = box_from_vehicle * Vector3::y();
        let offset = box_from_vehicle.translation.vector;
        if offset.z.abs() > 2.0 || along.x < 0.0 {
            return false;
        }
        let reach = |axis: [f64; 2], half: [f64; 2], x: Vector3<f64>, y: Vector3<f64>| {
            half[0] * (axis[0] * x.x + axis[1] * x.y).abs()
                + half[1] * (axis[0] * y.x + axis[1] * y.y).abs()
        };
        [
            [1.0, 0.0],
            [0.0, 1.0],
            [along.x, along.y],
            [aside.x, aside.y],
        ]
        .iter()
        .all(|axis| {
            let apart = (axis[0] * offset.x + axis[1] * offset.y).abs();
            apart
                <= reach(*axis, self.half_m, Vector3::x(), Vector3::y())
                    + reach(*axis, [half_m[0], half_m[1]], along, aside)
        })
    }
}

/// The box on the lane of `stop`, its middle `upstream_m` before it, as wide as `half_width_ratio`
/// of the lane to either side.
pub(crate) fn stop_box(
    roads: &RoadMap,
    stop: LanePosition,
    upstream_m: f64,
    half_width_ratio: f64,
) -> Option<StopBox> {
    let middle = LanePosition {
        s_m: (stop.s_m - upstream_m).max(0.0),
        offset_m: 0.0,
        ..stop
    };
    let world_from_box = roads.pose(middle)?;
    Some(StopBox {
        world_from_box,
        half_m: [STOP_BOX_HALF_M, half_width_ratio * roads.width_m(middle)],
    })
}
