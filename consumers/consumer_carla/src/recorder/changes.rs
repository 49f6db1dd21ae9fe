//! The part of a recorded tick that is written on change only: weather, doors, street lights; with
//! additional data also vehicles' physics control, and walkers' bones.

use std::collections::BTreeMap;

use schema_frames::VehiclePhysics;
use schema_frames::document::Weather;
use schema_types::Pose;

use crate::list;
use crate::wire::axes::Transform;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;
use crate::wire::vehicle_physics::{read_physics, write_physics};
use crate::wire::weather::{read_weather, weather_values};

/// A street light as it was set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreetLight {
    /// Whether it shines.
    pub on: bool,
    /// Luminous flux, lumen.
    pub intensity_lm: f32,
    /// Colour, sRGB.
    pub rgb: [u8; 3],
}

/// Bones by name, each relative to its parent bone.
pub type Bones = Vec<(String, Transform)>;

/// This part of one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// The weather, in the first tick and when it has changed.
    pub weather: Option<Weather>,
    /// Vehicles whose doors have changed, and their doors that are open or opening: bit 0 is front
    /// left, bit 3 rear right.
    pub doors: BTreeMap<u32, u8>,
    /// Street lights that a script has set.
    pub street_lights: BTreeMap<u32, StreetLight>,
    /// Physics control of vehicles that appeared or whose physics control was set.
    pub physics: BTreeMap<u32, VehiclePhysics>,
    /// Bones of walkers.
    pub bones: BTreeMap<u32, Bones>,
}

impl Changes {
    /// The last fields of a frame.
    pub fn values(&self) -> [Value; 5] {
        let weather = self.weather.map_or_else(Vec::new, |weather| {
            weather_values(&weather).map(Value::from).to_vec()
        });
        let doors = self.doors.iter().map(|(id, doors)| list![*id, *doors]);
        let light = |(id, light): (&u32, &StreetLight)| {
            let [r, g, b] = light.rgb;
            list![*id, light.on, light.intensity_lm, r, g, b]
        };
        let physics = self
            .physics
            .iter()
            .map(|(id, physics)| list![*id, write_physics(physics, &Pose::IDENTITY)]);
        let bone = |(name, at): &(String, Transform)| {
            let ([x, y, z], [pitch, yaw, roll]) = (at.location_m, at.rotation_deg);
            list![
                name.as_str(),
                x as f32,
                y as f32,
                z as f32,
                pitch as f32,
                yaw as f32,
                roll as f32
            ]
        };
        let bones = self
            .bones
            .iter()
            .map(|(id, bones)| list![*id, bones.iter().map(bone).collect::<Vec<_>>()]);
        [
            Value::Array(weather),
            Value::Array(doors.collect()),
            Value::Array(self.street_lights.iter().map(light).collect()),
            Value::Array(physics.collect()),
            Value::Array(bones.collect()),
        ]
    }

    /// Reads those fields.
    pub(super) fn read(fields: &mut Fields<'_>) -> Result<Changes, Wrong> {
        let mut changes = Changes::default();
        let mut weather = fields.fields("the weather")?;
        if !weather.rest().is_empty() {
            changes.weather = Some(read_weather(&mut weather)?);
        }
        for mut vehicle in fields.each("doors")? {
            changes.doors.insert(vehicle.u32()?, vehicle.u8()? & 15);
        }
        for mut light in fields.each("a street light")? {
            let (id, on, intensity_lm) = (light.u32()?, light.bool()?, light.f32()?);
            changes.street_lights.insert(
                id,
                StreetLight {
                    on,
                    intensity_lm,
                    rgb: [light.u8()?, light.u8()?, light.u8()?],
                },
            );
        }
        for mut vehicle in fields.each("a vehicle's physics")? {
            let id = vehicle.u32()?;
            changes.physics.insert(id, read_physics(&mut vehicle)?);
        }
        for mut walker in fields.each("a walker's bones")? {
            let id = walker.u32()?;
            let mut bones = Bones::new();
            for mut bone in walker.each("a bone")? {
                let name = bone.text()?.to_owned();
                let mut three = || Ok::<_, Wrong>([bone.f64()?, bone.f64()?, bone.f64()?]);
                bones.push((
                    name,
                    Transform {
                        location_m: three()?,
                        rotation_deg: three()?,
                    },
                ));
            }
            changes.bones.insert(id, bones);
        }
        Ok(changes)
    }
}
