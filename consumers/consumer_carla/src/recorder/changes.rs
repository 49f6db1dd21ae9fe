//! What a recording has of things that change seldom, at the ticks at which they did: weather,
//! doors, street lights; and, with additional
//! data, vehicles' physics control and walkers' bones.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use consumer_kit::WorldAt;
use schema_frames::document::Weather;
use schema_frames::scenery::LampChange;
use schema_frames::{
    BoneReading, Command, CommandReply, HeldBone, PhysicsAction, PhysicsAnswer, SkeletonAction,
    VehiclePhysics,
};
use schema_types::Pose;

use super::file::each;
use super::report::{ROOM, centimetres, turn};
use crate::axes::{self, Transform};
use crate::commander::Commander;
use crate::fields::{Fields, Wrong};
use crate::list;
use crate::msgpack::Value;
use crate::rpc::physics::{read_physics, write_physics};
use crate::rpc::weather::{read_weather, weather_values};

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

/// Bones by name, each in the frame of its parent.
pub type Bones = Vec<(String, Transform)>;

/// One tick's share.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// The weather, if it is the first tick or changed.
    pub weather: Option<Weather>,
    /// Doors that are open or being opened, bit 0 front left to 3 rear right, of vehicles where
    /// that changed.
    pub doors: BTreeMap<u32, u8>,
    /// Street lights that scripts set.
    pub street_lights: BTreeMap<u32, StreetLight>,
    /// Physics control of vehicles that came or whose was set.
    pub physics: BTreeMap<u32, VehiclePhysics>,
    /// Bones of walkers.
    pub bones: BTreeMap<u32, Bones>,
}

impl Changes {
    /// The fields at the end of a frame.
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

    /// Reads them.
    pub(super) fn read(fields: &mut Fields<'_>) -> Result<Changes, Wrong> {
        let mut changes = Changes::default();
        let mut weather = fields.fields("the weather")?;
        if !weather.rest().is_empty() {
            changes.weather = Some(read_weather(&mut weather)?);
        }
        for mut vehicle in each(fields, "doors")? {
            changes.doors.insert(vehicle.u32()?, vehicle.u8()? & 15);
        }
        for mut light in each(fields, "a street light")? {
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
        for mut vehicle in each(fields, "a vehicle's physics")? {
            let id = vehicle.u32()?;
            changes.physics.insert(id, read_physics(&mut vehicle)?);
        }
        for mut walker in each(fields, "a walker's bones")? {
            let id = walker.u32()?;
            let mut bones = Bones::new();
            for mut bone in each(&mut walker, "a bone")? {
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

    /// CARLA's lines about it.
    pub(super) fn tell(&self, out: &mut String) {
        if let Some(weather) = &self.weather {
            let named = WEATHER
                .iter()
                .zip(weather_values(weather))
                .map(|(name, value)| format!("{name}: {value}"));
            writeln!(
                out,
                " Weathers: 1\n  {}",
                named.collect::<Vec<_>>().join(" ")
            )
            .expect(ROOM);
        }
        if !self.doors.is_empty() {
            writeln!(out, " Vehicle door animations: {}", self.doors.len()).expect(ROOM);
        }
        for (id, doors) in &self.doors {
            let open = DOORS
                .iter()
                .enumerate()
                .filter(|(bit, _)| doors >> bit & 1 != 0)
                .map(|(_, name)| format!(" {name} "));
            writeln!(
                out,
                "  Id: {id}\n  Doors opened: {}",
                open.collect::<String>()
            )
            .expect(ROOM);
        }
        if !self.street_lights.is_empty() {
            writeln!(out, " Scene light changes: {}", self.street_lights.len()).expect(ROOM);
        }
        for (id, light) in &self.street_lights {
            let (on, [r, g, b]) = (if light.on { "True" } else { "False" }, light.rgb);
            writeln!(
                out,
                "  Id: {id} enabled: {on} intensity: {} RGB_color: ({r}, {g}, {b})",
                light.intensity_lm
            )
            .expect(ROOM);
        }
        if !self.physics.is_empty() {
            writeln!(out, " Physics Control events: {}", self.physics.len()).expect(ROOM);
        }
        self.physics
            .iter()
            .for_each(|(id, physics)| tell_physics(out, *id, physics));
        if !self.bones.is_empty() {
            writeln!(out, " Walkers Bones: {}", self.bones.len()).expect(ROOM);
        }
        for (id, bones) in &self.bones {
            writeln!(out, "  Id: {id}").expect(ROOM);
            for (name, at) in bones {
                writeln!(
                    out,
                    "     Bone: \"{name}\" relative: Loc{} Rot{}",
                    centimetres(at.location_m),
                    turn(at.rotation_deg)
                )
                .expect(ROOM);
            }
        }
    }

    /// Brings it about at a replay; `now_of` says which actor one is today, if it takes part.
    pub(super) fn replay(&self, now_of: impl Fn(u32) -> Option<u32>, commander: &Commander) {
        if let Some(weather) = self.weather {
            commander.tell(Command::SetWeather { weather });
        }
        if !self.street_lights.is_empty() {
            let change = |(id, light): (&u32, &StreetLight)| LampChange {
                lamp: *id,
                on: Some(light.on),
                rgb: Some(light.rgb),
                intensity_lm: Some(light.intensity_lm),
                group: None,
            };
            commander.tell(Command::SetSceneryLamps {
                changes: self.street_lights.iter().map(change).collect(),
            });
        }
        for (id, doors) in &self.doors {
            let Some(actor_id) = now_of(*id) else {
                continue;
            };
            for (doors, open) in [(*doors, true), (!doors & 15, false)] {
                if doors != 0 {
                    commander.tell(Command::SetDoors {
                        actor_id,
                        doors,
                        open,
                    });
                }
            }
        }
        for (id, physics) in &self.physics {
            let Some(actor_id) = now_of(*id) else {
                continue;
            };
            let action = PhysicsAction::SetVehiclePhysics {
                physics: Box::new(physics.clone()),
            };
            commander.tell(Command::Physics { actor_id, action });
        }
    }
}

/// Shows a walker with these bones instead of its gait, until [`let_go`].
pub(super) fn hold(actor_id: u32, bones: &Bones, commander: &Commander) {
    let held = |(name, at): &(String, Transform)| HeldBone {
        name: name.clone(),
        bone_in_parent: axes::pose(at).into(),
    };
    let bones = bones.iter().map(held).collect();
    commander.tell(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Hold { bones },
    });
    commander.tell(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Blend { ratio: 1.0 },
    });
}

/// A walker shows its gait again.
pub(super) fn let_go(actor_id: u32, commander: &Commander) {
    commander.tell(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Blend { ratio: 0.0 },
    });
}

const WEATHER: [&str; 14] = [
    "Cloudiness",
    "Precipitation",
    "PrecipitationDeposits",
    "WindIntensity",
    "SunAzimuthAngle",
    "SunAltitudeAngle",
    "FogDensity",
    "FogDistance",
    "FogFalloff",
    "Wetness",
    "ScatteringIntensity",
    "MieScatteringScale",
    "RayleighScatteringScale",
    "DustStorm",
];

const DOORS: [&str; 4] = ["Front Left", "Front Right", "Rear Left", "Rear Right"];

/// CARLA's units: centimetres of wheels, degrees of steering, km/h of the steering curve.
fn tell_physics(out: &mut String, id: u32, physics: &VehiclePhysics) {
    let [x, y, z] = axes::mirror(physics.center_of_mass_m).map(|metres| metres + 0.0);
    let curve = |points: &[[f32; 2]], unit: f32| {
        points
            .iter()
            .map(|[x, y]| format!(" ({}, {y})", x * unit))
            .collect::<String>()
    };
    writeln!(out, "  Id: {id}").expect(ROOM);
    for (name, value) in [
        ("max_rpm", physics.max_rpm),
        ("MOI", physics.engine_inertia_kgm2),
        (
            "damping_rate_full_throttle",
            physics.damping_full_throttle_nms,
        ),
        (
            "damping_rate_zero_throttle_clutch_engaged",
            physics.damping_closed_engaged_nms,
        ),
        (
            "damping_rate_zero_throttle_clutch_disengaged",
            physics.damping_closed_open_nms,
        ),
    ] {
        writeln!(out, "   {name} = {value}").expect(ROOM);
    }
    writeln!(out, "   use_gear_auto_box = {}", physics.automatic_gearbox).expect(ROOM);
    for (name, value) in [
        ("gear_switch_time", physics.gear_switch_secs),
        ("clutch_strength", physics.clutch_strength_nms),
        ("final_ratio", physics.final_ratio),
        ("mass", physics.mass_kg),
        ("drag_coefficient", physics.drag_coefficient),
    ] {
        writeln!(out, "   {name} = {value}").expect(ROOM);
    }
    writeln!(out, "   center_of_mass = ({x}, {y}, {z})").expect(ROOM);
    writeln!(
        out,
        "   torque_curve ={}",
        curve(&physics.torque_curve, 1.0)
    )
    .expect(ROOM);
    writeln!(
        out,
        "   steering_curve ={}",
        curve(&physics.steering_curve, 3.6)
    )
    .expect(ROOM);
    writeln!(out, "   forward_gears:").expect(ROOM);
    for (number, gear) in physics.forward_gears.iter().enumerate() {
        let (ratio, down, up) = (gear.ratio, gear.down_ratio, gear.up_ratio);
        writeln!(
            out,
            "    gear {number}: ratio {ratio} down_ratio {down} up_ratio {up}"
        )
        .expect(ROOM);
    }
    writeln!(out, "   wheels:").expect(ROOM);
    for (number, wheel) in physics.wheels.iter().enumerate() {
        writeln!(
            out,
            "    wheel {number}: tire_friction {} damping_rate {} max_steer_angle {} radius {} max_brake_torque {} max_handbrake_torque {} position {}",
            wheel.friction,
            wheel.damping_nms,
            wheel.max_steer_rad.to_degrees(),
            wheel.radius_m * 100.0,
            wheel.max_brake_nm,
            wheel.max_hand_brake_nm,
            centimetres(axes::mirror(wheel.position_m).map(f64::from))
        )
        .expect(ROOM);
    }
}

/// What of a snapshot has to be asked for: physics control and bones.
#[derive(Debug, Default)]
pub struct Wanted {
    /// Vehicles whose physics control is to be recorded.
    pub vehicles: Vec<u32>,
    /// Walkers whose bones are.
    pub walkers: Vec<u32>,
}

impl Wanted {
    /// Asks for all of it at once. Who has just gone is left out.
    pub fn ask(&self, commander: &Commander, changes: &mut Changes) {
        if self.vehicles.is_empty() && self.walkers.is_empty() {
            return;
        }
        let physics = |actor_id: &u32| Command::Physics {
            actor_id: *actor_id,
            action: PhysicsAction::GetVehiclePhysics,
        };
        let bones = |actor_id: &u32| Command::Skeleton {
            actor_id: *actor_id,
            action: SkeletonAction::Read,
        };
        let commands = self
            .vehicles
            .iter()
            .map(physics)
            .chain(self.walkers.iter().map(bones))
            .collect();
        let replies = match commander.ask(commands) {
            Ok(answer) => answer.replies,
            Err(error) => {
                return tracing::warn!(
                    error,
                    "a tick is recorded without physics control and bones"
                );
            }
        };
        for (actor_id, reply) in self.vehicles.iter().chain(&self.walkers).zip(replies) {
            match reply {
                CommandReply::Physics {
                    answer: PhysicsAnswer::VehiclePhysics(physics),
                } => {
                    changes.physics.insert(*actor_id, *physics);
                }
                CommandReply::Bones { bones } => {
                    let bone = |bone: BoneReading| {
                        (bone.name, axes::transform(&bone.bone_in_parent.into()))
                    };
                    changes
                        .bones
                        .insert(*actor_id, bones.into_iter().map(bone).collect());
                }
                _ => {}
            }
        }
    }
}

/// Doors that are open or being opened, by how far each is: four bits a door, as snapshots have
/// them.
pub fn opened(before: u16, now: u16, was: u8) -> u8 {
    (0..4).fold(0, |doors, door| {
        let (before, now) = (before >> (4 * door) & 15, now >> (4 * door) & 15);
        let is_open = match now {
            0 => false,
            15 => true,
            _ if now == before => was >> door & 1 != 0,
            _ => now > before,
        };
        doors | u8::from(is_open) << door
    })
}

/// Keeps what was recorded last, so that only changes are.
#[derive(Debug, Default)]
pub struct Watch {
    weather: Option<Weather>,
    doors: BTreeMap<u32, (u16, u8)>,
}

impl Watch {
    /// What of a snapshot is new.
    pub fn note(&mut self, snapshot: &WorldAt, weather: Option<Weather>, changes: &mut Changes) {
        if weather.is_some() && self.weather != weather {
            (self.weather, changes.weather) = (weather, weather);
        }
        self.doors.retain(|id, _| snapshot.actor(*id).is_some());
        for record in &snapshot.records {
            let Some(part) = record.vehicle() else {
                continue;
            };
            let now = (part.control_flags >> 16) as u16;
            let (before, was) = self.doors.get(&record.id).copied().unwrap_or_default();
            let doors = opened(before, now, was);
            if doors != was {
                changes.doors.insert(record.id, doors);
            }
            if now != 0 || before != 0 {
                self.doors.insert(record.id, (now, doors));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doors_are_open_from_the_moment_they_are_being_opened_until_they_are_being_shut() {
        // Front left opens, stands, shuts; rear right comes along later.
        let angles = [
            0x0000u16, 0x0005, 0x000f, 0x000f, 0x300f, 0xf00a, 0xf00a, 0xf000,
        ];
        let (mut was, mut before, mut seen) = (0, 0, Vec::new());
        for now in angles {
            was = opened(before, now, was);
            before = now;
            seen.push(was);
        }
        assert_eq!(seen, [0, 1, 1, 1, 0b1001, 0b1000, 0b1000, 0b1000]);
    }
}
