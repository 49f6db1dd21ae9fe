//! Numbers as JSON: tensors, scalars and controls. A number that is not finite is `null`.

use consumer_kit::items::{Figures, number};
use schema_frames::{Scalar, VehicleControlRecord};
use serde_json::{Map, Value, json};

use super::shot::Shot;
use schema_recording::messages::{Content, Entry};

/// Longest tensor whose numbers are written out.
const MAX_NUMBERS: u32 = 1024;

impl Shot<'_> {
    pub(super) fn tensor(&self) -> Entry {
        let (header, body) = (self.parts.header, self.parts.body);
        let mut message = json!({ "shape": header.shape() });
        if let Some(element) = header.element_type() {
            let figures = Figures::of(element, body);
            message["dtype"] = element.name().into();
            message["n"] = figures.n.into();
            message["n_finite"] = figures.n_finite.into();
            message["min"] = figures.min.into();
            message["max"] = figures.max.into();
            message["mean"] = figures.mean.into();
            message["histogram"] = figures.histogram.into();
            if header.n_items <= MAX_NUMBERS {
                let numbers = body.chunks_exact(element.element_bytes());
                message["numbers"] = numbers.map(|bytes| number(element, bytes)).collect();
            }
        }
        self.value(Content::Tensor, &message)
    }

    pub(super) fn scalars(&self) -> Entry {
        let scalars = self.parts.records::<Scalar>();
        let values: Map<String, Value> = scalars
            .iter()
            .map(|scalar| (scalar.name(), scalar.value.into()))
            .collect();
        let message = json!({ "sim_secs": self.sim_secs(), "values": values });
        self.value(Content::Scalars, &message)
    }

    pub(super) fn controls(&self) -> Entry {
        let vehicle = |record: &VehicleControlRecord| {
            json!({
                "actor_id": record.actor_id,
                "throttle_ratio": record.throttle_ratio,
                "steer_ratio": record.steer_ratio,
                "brake_ratio": record.brake_ratio,
                "hand_brake": record.flags & 1 != 0,
                "reverse": record.flags & 2 != 0,
                "manual_gear_shift": record.flags & 4 != 0,
                "gear": record.gear,
            })
        };
        let records = self.parts.records::<VehicleControlRecord>();
        let vehicles: Vec<Value> = records.iter().map(vehicle).collect();
        let message = json!({ "sim_secs": self.sim_secs(), "vehicles": vehicles });
        self.value(Content::Control, &message)
    }

    fn sim_secs(&self) -> f64 {
        self.sim_nanos as f64 * 1e-9
    }

    fn value(&self, content: Content, message: &Value) -> Entry {
        self.raw(content, message.to_string().into_bytes())
    }
}
