//! Speed limits as signs post them: a vehicle's limit is that of the last sign it passed, as on
//! CARLA's server.

use nalgebra::Isometry3;
use schema_roads::{RoadMap, SignalKind};

use super::box_grid::BoxGrid;
use super::stop_box::{StopBox, stop_box};
use super::trigger_boxes::LIMIT_HALF_WIDTH_RATIO;

/// Limit of a vehicle that has passed no sign yet, m/s: 30 km/h, as CARLA's.
pub(crate) const FIRST_LIMIT_MPS: f32 = 30.0 / 3.6;

/// The speed-limit signs of a map and the places on lanes at which they begin to hold.
#[derive(Clone, Default)]
pub(crate) struct PostedLimits {
    /// Box on a lane, and the limit from there on, m/s.
    boxes: Vec<(StopBox, f32)>,
    grid: BoxGrid,
}

impl PostedLimits {
    /// The signs of a map. Values are km/h, whatever unit is stated, because CARLA takes them so;
    /// a sign without a value posts nothing.
    pub fn of(roads: &RoadMap) -> PostedLimits {
        let boxes: Vec<(StopBox, f32)> = roads
            .signals()
            .iter()
            .filter(|signal| signal.kind == SignalKind::SpeedLimit)
            .filter_map(|signal| {
                let kmh = signal
                    .value
                    .filter(|kmh| *kmh > 0.0)
                    .or_else(|| signal.subtype.parse().ok().filter(|kmh| *kmh > 0.0))?;
                Some((signal, (kmh / 3.6) as f32))
            })
            .flat_map(|(signal, limit_mps)| {
                let boxes = signal
                    .stops
                    .iter()
                    .filter_map(|stop| stop_box(roads, stop.stop, 0.0, LIMIT_HALF_WIDTH_RATIO));
                boxes.map(move |stop_box| (stop_box, limit_mps))
            })
            .collect();
        let middles = boxes
            .iter()
            .map(|(stop_box, _)| stop_box.world_from_box.translation.vector);
        PostedLimits {
            grid: BoxGrid::new(middles),
            boxes,
        }
    }

    /// Whether no sign posts anything.
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    /// The limit of the sign that a vehicle is passing, m/s; of several, the nearest.
    pub fn passed(&self, world_from_vehicle: &Isometry3<f64>, half_m: [f64; 3]) -> Option<f32> {
        let at_m = world_from_vehicle.translation.vector;
        let distance = |number: &usize| {
            (self.boxes[*number].0.world_from_box.translation.vector - at_m).norm_squared()
        };
        self.grid
            .near(&at_m)
            .into_iter()
            .filter(|number| self.boxes[*number].0.overlaps(world_from_vehicle, half_m))
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .map(|number| self.boxes[number].1)
    }
}
