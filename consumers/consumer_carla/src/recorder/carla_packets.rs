//! Contents of the packets of CARLA's recordings: little-endian numbers without padding, in
//! centimetres and degrees, which become metres here.
//!
//! A packet is a count and as many records, all of whose bytes must be used: that tells apart the
//! numberings and number widths of CARLA's versions.

use crate::list;
use crate::recorder::changes::{Bones, StreetLight};
use crate::recorder::extra::ActorBox;
use crate::recorder::frame::{Born, Collision, Light, Motion, Pedals};
use crate::recorder::motion::is_somewhere;
use crate::wire::axes::Transform;
use crate::wire::description::{Attribute, Description};
use crate::wire::msgpack::Value;

/// The bytes of a packet that are left.
#[derive(Clone, Copy, Debug)]
pub struct Bytes<'b> {
    left: &'b [u8],
    /// Whether vectors consist of doubles, as in CARLA 0.10, instead of floats.
    wide: bool,
}

/// The records of a packet, each read by `one`; `None` if they are not exactly its bytes.
pub fn records<T>(
    packet: &[u8],
    wide: bool,
    mut one: impl FnMut(&mut Bytes<'_>) -> Option<T>,
) -> Option<Vec<T>> {
    let mut bytes = Bytes { left: packet, wide };
    let n_records = bytes.u16()?;
    let mut records = Vec::new();
    for _ in 0..n_records {
        records.push(one(&mut bytes)?);
    }
    bytes.left.is_empty().then_some(records)
}

impl Bytes<'_> {
    /// Bytes that are no records, without vectors.
    pub fn of(packet: &[u8]) -> Bytes<'_> {
        Bytes {
            left: packet,
            wide: false,
        }
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, left) = self.left.split_first_chunk::<N>()?;
        self.left = left;
        Some(*taken)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.take().map(u8::from_le_bytes)
    }

    fn flag(&mut self) -> Option<bool> {
        self.u8().map(|byte| byte != 0)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Option<i32> {
        self.take().map(i32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    pub fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    fn floats<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut floats = [0.0; N];
        for float in &mut floats {
            *float = self.f32()?;
        }
        Some(floats)
    }

    fn vector(&mut self) -> Option<[f64; 3]> {
        if self.wide {
            return Some([self.f64()?, self.f64()?, self.f64()?]);
        }
        self.floats().map(|vector| vector.map(f64::from))
    }

    fn centimetres(&mut self) -> Option<[f64; 3]> {
        self.vector().map(|vector| vector.map(|cm| cm / 100.0))
    }

    /// A place and Unreal's angles about x, y and z.
    fn transform(&mut self) -> Option<Transform> {
        let location_m = self.centimetres()?;
        let [roll, pitch, yaw] = self.vector()?;
        Some(Transform {
            location_m,
            rotation_deg: [pitch, yaw, roll],
        })
    }

    fn text(&mut self) -> Option<String> {
        let n_bytes = usize::from(self.u16()?);
        let (text, left) = self.left.split_at_checked(n_bytes)?;
        self.left = left;
        Some(String::from_utf8_lossy(text).into_owned())
    }
}

pub fn born(bytes: &mut Bytes<'_>) -> Option<Born> {
    let (id, family, at) = (bytes.u32()?, bytes.u8()?, bytes.transform()?);
    let _number_of_blueprint = bytes.u32()?;
    let type_id = bytes.text()?;
    let mut attributes = Vec::new();
    for _ in 0..bytes.u16()? {
        attributes.push(Attribute {
            kind: bytes.u8()?,
            name: bytes.text()?,
            value: bytes.text()?,
        });
    }
    Some(Born {
        id,
        parent: 0,
        family,
        description: Description {
            type_id,
            attributes,
        },
        at,
        on_parent: false,
    })
}

/// An id alone, or two of them.
pub fn pair(bytes: &mut Bytes<'_>) -> Option<(u32, u32)> {
    Some((bytes.u32()?, bytes.u32()?))
}

pub fn collision(bytes: &mut Bytes<'_>) -> Option<Collision> {
    let (number, actors) = (bytes.u32()?, pair(bytes)?);
    // Whether they are heroes; their attributes say so, too.
    bytes.take::<2>()?;
    Some(Collision { number, actors })
}

pub fn pose(bytes: &mut Bytes<'_>) -> Option<(u32, Transform)> {
    Some((bytes.u32()?, bytes.transform()?))
}

pub fn light(bytes: &mut Bytes<'_>) -> Option<(u32, Light)> {
    let (id, frozen, elapsed_secs) = (bytes.u32()?, bytes.flag()?, bytes.f32()?);
    let light = Light {
        state: bytes.u8()?,
        frozen,
        elapsed_secs,
    };
    Some((id, light))
}

pub fn pedals(bytes: &mut Bytes<'_>) -> Option<(u32, Pedals)> {
    let (id, [steer, throttle, brake]) = (bytes.u32()?, bytes.floats()?);
    let pedals = Pedals {
        steer,
        throttle,
        brake,
        hand_brake: bytes.flag()?,
        gear: bytes.i32()?,
    };
    Some((id, pedals))
}

pub fn gait(bytes: &mut Bytes<'_>) -> Option<(u32, f32)> {
    let (id, cmps) = (bytes.u32()?, bytes.f32()?);
    cmps.is_finite().then_some((id, cmps / 100.0))
}

pub fn street_light(bytes: &mut Bytes<'_>) -> Option<(u32, StreetLight)> {
    let (id, intensity_lm, [red, green, blue, _]) =
        (bytes.u32()?, bytes.f32()?, bytes.floats::<4>()?);
    let (on, _kind) = (bytes.flag()?, bytes.u8()?);
    let light = StreetLight {
        on,
        intensity_lm,
        // A float that is no number becomes 0.
        rgb: [red, green, blue].map(|share| (share * 255.0).round() as u8),
    };
    intensity_lm.is_finite().then_some((id, light))
}

pub fn motion(bytes: &mut Bytes<'_>) -> Option<(u32, Motion)> {
    Some((bytes.u32()?, [bytes.vector()?, bytes.vector()?]))
}

pub fn actor_box(bytes: &mut Bytes<'_>) -> Option<(u32, ActorBox)> {
    Some((bytes.u32()?, [bytes.centimetres()?, bytes.centimetres()?]))
}

pub fn light_times(bytes: &mut Bytes<'_>) -> Option<(u32, [f32; 3])> {
    Some((bytes.u32()?, bytes.floats()?))
}

/// A vehicle, the doors that move, as bits, and whether they open.
pub fn doors(bytes: &mut Bytes<'_>) -> Option<(u32, u8, bool)> {
    let (id, door, opens) = (bytes.u32()?, bytes.u8()?, bytes.flag()?);
    let doors = match door {
        0..=3 => 1 << door,
        // Bonnet and boot, which the vehicles here cannot open.
        4 | 5 => 0,
        6 => 15,
        _ => return None,
    };
    Some((id, doors, opens))
}

/// The weather's parameters in CARLA's order.
pub fn weather(bytes: &mut Bytes<'_>) -> Option<Vec<Value>> {
    let parameters: [f32; 14] = bytes.floats()?;
    Some(parameters.map(Value::F32).to_vec())
}

pub fn bones(bytes: &mut Bytes<'_>) -> Option<(u32, Bones)> {
    let id = bytes.u32()?;
    let mut bones = Bones::new();
    for _ in 0..bytes.u16()? {
        let (name, at) = (bytes.text()?, bytes.transform()?);
        if !is_somewhere(&at) {
            return None;
        }
        bones.push((name, at));
    }
    Some((id, bones))
}

/// Time for changing gear, which the files lack, seconds.
const GEAR_SWITCH_SECS: f32 = 0.5;

/// A vehicle and its physics control in the order in which clients send it. `with_stiffness` is
/// false for CARLA's versions whose wheels have no stiffness.
pub fn physics(bytes: &mut Bytes<'_>, with_stiffness: bool) -> Option<(u32, Value)> {
    let id = bytes.u32()?;
    let [max_rpm, inertia, full, engaged, disengaged] = bytes.floats()?;
    let automatic = bytes.flag()?;
    let [clutch, final_ratio, mass, drag] = bytes.floats()?;
    let middle: [f32; 3] = bytes.floats()?;
    let torque = each::<2>(bytes)?;
    let gears = each::<3>(bytes)?;
    let steering = each::<2>(bytes)?;
    let wheels = wheels(bytes, with_stiffness)?;
    let control = list![
        torque,
        max_rpm,
        inertia,
        full,
        engaged,
        disengaged,
        automatic,
        GEAR_SWITCH_SECS,
        clutch,
        final_ratio,
        gears,
        mass,
        drag,
        middle.map(Value::F32).to_vec(),
        steering,
        wheels,
        false
    ];
    Some((id, control))
}

/// A count of 32 bits and as many lists of floats.
fn each<const N: usize>(bytes: &mut Bytes<'_>) -> Option<Vec<Value>> {
    let mut lists = Vec::new();
    for _ in 0..bytes.u32()? {
        lists.push(Value::Array(bytes.floats::<N>()?.map(Value::F32).to_vec()));
    }
    Some(lists)
}

fn wheels(bytes: &mut Bytes<'_>, with_stiffness: bool) -> Option<Vec<Value>> {
    /// Load limit, lateral and longitudinal stiffness of CARLA's wheels by default.
    const STIFFNESS: [f32; 3] = [2.0, 17.0, 1000.0];
    let mut wheels = Vec::new();
    for _ in 0..bytes.u32()? {
        let [friction, damping, angle, radius, brake, hand_brake] = bytes.floats()?;
        let stiffness = if with_stiffness {
            bytes.floats()?
        } else {
            STIFFNESS
        };
        let place: [f32; 3] = bytes.floats()?;
        wheels.push(list![
            friction,
            damping,
            angle,
            radius,
            brake,
            hand_brake,
            stiffness[0],
            stiffness[1],
            stiffness[2],
            place.map(Value::F32).to_vec()
        ]);
    }
    Some(wheels)
}
