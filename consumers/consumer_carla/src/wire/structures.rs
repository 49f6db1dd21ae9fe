//! CARLA's structures as msgpack values.

use schema_frames::{BodyBox, PosedBox};

use crate::list;
use crate::wire::axes::{self, Transform};
use crate::wire::msgpack::Value;

fn vector([x, y, z]: [f64; 3]) -> Value {
    list![x as f32, y as f32, z as f32]
}

/// `[[x, y, z], [pitch, yaw, roll]]`.
pub fn transform(transform: &Transform) -> Value {
    list![vector(transform.location_m), vector(transform.rotation_deg)]
}

/// A box in its actor's space, as CARLA writes it.
pub fn bounding_box(body: &BodyBox, actor: u32) -> Value {
    let [x, y, z] = axes::mirror(body.centre_m).map(|metres| metres + 0.0);
    let [half_x, half_y, half_z] = body.half_m;
    list![
        list![x, y, z],
        list![half_x, half_y, half_z],
        list![0.0f32, 0.0f32, 0.0f32],
        actor
    ]
}

/// A box in world space.
pub fn posed_box(posed: &PosedBox) -> Value {
    let [pitch, yaw, roll] = axes::transform(&posed.pose.into()).rotation_deg;
    list![
        vector(axes::mirror(posed.pose.translation_m)),
        vector(posed.half_m),
        vector([pitch, yaw, roll]),
        0u32
    ]
}

/// An empty box, for an actor that does not exist.
pub fn no_box(actor: u32) -> Value {
    bounding_box(
        &BodyBox {
            centre_m: [0.0; 3],
            half_m: [0.0; 3],
        },
        actor,
    )
}

/// The actor structure that stands for scenery in events.
pub fn scenery(type_id: &str, class: u8) -> Value {
    list![
        0u32,
        0u32,
        list![0u32, type_id, Value::Array(Vec::new())],
        no_box(0),
        Value::Bin(vec![class]),
        Value::Bin(Vec::new())
    ]
}

/// The bits of lamps that exist; `VehicleLightState.All` sets every bit.
pub const LAMPS: u32 = 0x7ff;
