//! Traffic lights and signs of a map.

mod box_grid;
mod lamp_heads;
mod posted_limits;
mod stop_box;
mod traffic_lights;
mod trigger_boxes;

pub(crate) use lamp_heads::lamp_head_boxes;
pub(crate) use posted_limits::{FIRST_LIMIT_MPS, PostedLimits};
pub(crate) use traffic_lights::TrafficLights;
pub(crate) use trigger_boxes::trigger_box;
