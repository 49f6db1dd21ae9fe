//! Reads CARLA's structures from the fields of what clients send.

use schema_frames::VehicleControl;
use schema_frames::limits::{check_actor_texts, cut};

pub use consumer_rpc::fields::{Fields, Wrong};

use crate::wire::axes::{self, Transform};
use crate::wire::description::{Attribute, Description};
use crate::wire::msgpack::Value;

/// CARLA's structures, as readers of fields.
pub trait Structures {
    /// A transform.
    ///
    /// # Errors
    /// [`Wrong`].
    fn transform(&mut self) -> Result<Transform, Wrong>;
    /// A vehicle control, converted to Gantry's axes.
    ///
    /// # Errors
    /// [`Wrong`].
    fn vehicle_control(&mut self) -> Result<VehicleControl, Wrong>;
    /// Type id, and attributes as pairs of name and value.
    ///
    /// # Errors
    /// [`Wrong`].
    fn description(&mut self) -> Result<Description, Wrong>;
}

impl Structures for Fields<'_> {
    fn transform(&mut self) -> Result<Transform, Wrong> {
        let mut transform = self.fields("a transform")?;
        Ok(Transform {
            location_m: transform.vector()?,
            rotation_deg: transform.vector()?,
        })
    }

    fn vehicle_control(&mut self) -> Result<VehicleControl, Wrong> {
        let mut control = self.fields("a vehicle control")?;
        let (throttle_ratio, steer, brake_ratio) = (control.f32()?, control.f32()?, control.f32()?);
        let read = VehicleControl {
            throttle_ratio,
            steer_ratio: axes::steer(steer),
            brake_ratio,
            hand_brake: control.bool()?,
            reverse: control.bool()?,
            manual_gear_shift: control.bool()?,
            gear: control.i32()?.clamp(-1, 20) as i8,
        };
        Ok(read.clamped())
    }

    fn description(&mut self) -> Result<Description, Wrong> {
        let mut description = self.fields("an actor description")?;
        description.u32()?;
        let type_id = description.text()?.to_owned();
        let mut attributes = Vec::new();
        for item in description.list()? {
            let Value::Array(parts) = item else {
                let kind = item.kind();
                return Err(Wrong::Value(format!(
                    "an attribute is {kind}, but must be a list"
                )));
            };
            let mut attribute = Fields::new("an attribute", parts);
            let (name, kind, value) = (attribute.text()?, attribute.u8()?, attribute.text()?);
            attributes.push(Attribute {
                name: name.to_owned(),
                kind,
                value: value.to_owned(),
            });
        }
        // The simulator checks what it is given; the gateway remembers all of it.
        let texts = attributes.iter().map(|it| (&*it.name, &*it.value));
        check_actor_texts("", texts)
            .map_err(|error| Wrong::Value(cut(format!("cannot spawn {type_id:?}: {error}"))))?;
        attributes.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(Description {
            type_id,
            attributes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::list;

    #[test]
    fn steering_is_mirrored_and_what_is_not_finite_is_refused() {
        let control = |throttle: f32| list![list![throttle, 0.25f32, 0u32, false, true, false, -1]];
        let Value::Array(items) = control(0.5) else {
            unreachable!()
        };
        let read = Fields::new("test", &items).vehicle_control().unwrap();
        assert_eq!(
            (
                read.throttle_ratio,
                read.steer_ratio,
                read.reverse,
                read.gear
            ),
            (0.5, -0.25, true, -1)
        );
        let Value::Array(items) = control(f32::NAN) else {
            unreachable!()
        };
        let error = Fields::new("test", &items)
            .vehicle_control()
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("field 1 of a vehicle control") && error.contains("finite"),
            "{error}"
        );
    }
}
