//! Gantry's own format of recordings: a sequence of msgpack lists, the head and then one list per
//! frame. `docs/reference/carla-recorder.md` has the table.

use std::io::Read;

use crate::list;
use crate::recorder::changes::Changes;
use crate::recorder::extra::Extra;
use crate::recorder::frame::{Born, Collision, Frame, Head, Light, Motion, Origin, Pedals, family};
use crate::recorder::read_error::ReadError;
use crate::wire::axes::Transform;
use crate::wire::fields::{Fields, Structures as _, Wrong};
use crate::wire::msgpack::{self, DecodeError, Limits, Value};

/// First field of the head.
pub const MAGIC: &str = "GANTRY-CARLA-RECORDING";
/// Version of the format; CARLA's texts call it "Version".
pub const VERSION: u32 = 4;
/// Oldest version that can be read; it lacks the fields of [`Extra`] and [`Changes`].
const OLDEST: u32 = 2;
/// First version with the fields of [`Changes`].
const WITH_CHANGES: u32 = 4;

/// Reads the frames of such a file.
#[derive(Debug)]
pub(super) struct OwnFile {
    version: u32,
    n_collisions: u32,
}

impl Head {
    /// Appends the bytes of a head in Gantry's format.
    pub fn write(&self, out: &mut Vec<u8>) {
        msgpack::write(
            out,
            &list![MAGIC, self.version, self.map.as_str(), self.date.as_str()],
        );
    }
}

impl OwnFile {
    /// Reads the head.
    pub fn begin(source: &mut impl Read) -> Result<(OwnFile, Head), ReadError> {
        let Ok(Value::Array(head)) = msgpack::read(
            source,
            Limits {
                bytes: 1 << 16,
                values: 16,
                depth: 2,
            },
        ) else {
            return Err(ReadError::Foreign);
        };
        let mut fields = Fields::new("its head", &head);
        if fields.text() != Ok(MAGIC) {
            return Err(ReadError::Foreign);
        }
        let version = fields.u32()?;
        if !(OLDEST..=VERSION).contains(&version) {
            return Err(ReadError::Version {
                version,
                oldest: OLDEST,
                newest: VERSION,
            });
        }
        let head = Head {
            origin: Origin::Gantry,
            version,
            map: fields.text()?.to_owned(),
            date: fields.text()?.to_owned(),
        };
        let n_collisions = 0;
        Ok((
            OwnFile {
                version,
                n_collisions,
            },
            head,
        ))
    }

    /// Reads the next frame; `None` where the file ends. The flag says whether it ends within one.
    pub fn next(&mut self, source: &mut impl Read) -> Result<(Option<Frame>, bool), ReadError> {
        match msgpack::read(source, Limits::default()) {
            Ok(Value::Array(items)) => {
                let mut frame = Frame::read(&mut Fields::new("a frame", &items), self.version)?;
                for collision in &mut frame.collisions {
                    collision.number = self.n_collisions;
                    self.n_collisions += 1;
                }
                Ok((Some(frame), false))
            }
            Ok(other) => Err(ReadError::NoList { kind: other.kind() }),
            Err(DecodeError::Closed) => Ok((None, false)),
            Err(DecodeError::Io(_)) => Ok((None, true)),
            Err(error) => Err(ReadError::Bytes(error)),
        }
    }
}

fn floats(transform: &Transform) -> [Value; 6] {
    let ([x, y, z], [pitch, yaw, roll]) = (transform.location_m, transform.rotation_deg);
    [x, y, z, pitch, yaw, roll].map(Value::F64)
}

impl Frame {
    /// Appends its bytes in Gantry's format.
    pub fn write(&self, out: &mut Vec<u8>) {
        let born = |born: &Born| {
            let attributes: Vec<Value> = born
                .description
                .attributes
                .iter()
                .map(|a| list![a.name.as_str(), a.kind, a.value.as_str()])
                .collect();
            let description = list![0u32, born.description.type_id.as_str(), attributes];
            list![born.id, born.parent, description, floats(&born.at).to_vec()]
        };
        let pose = |(id, at): (&u32, &Transform)| {
            Value::Array([&[Value::from(*id)][..], &floats(at)].concat())
        };
        let pedals = |(id, p): (&u32, &Pedals)| {
            list![*id, p.steer, p.throttle, p.brake, p.hand_brake, p.gear]
        };
        let motion = |(id, [v, w]): (&u32, &Motion)| list![*id, v[0], v[1], v[2], w[0], w[1], w[2]];
        let frame = list![
            self.tick,
            self.elapsed_secs,
            self.delta_secs,
            self.born.iter().map(born).collect::<Vec<_>>(),
            self.gone
                .iter()
                .map(|id| Value::from(*id))
                .collect::<Vec<_>>(),
            self.poses.iter().map(pose).collect::<Vec<_>>(),
            self.pedals.iter().map(pedals).collect::<Vec<_>>(),
            self.lights
                .iter()
                .map(|(id, light)| list![*id, light.state, light.frozen, light.elapsed_secs])
                .collect::<Vec<_>>(),
            self.collisions
                .iter()
                .map(|collision| list![collision.actors.0, collision.actors.1])
                .collect::<Vec<_>>(),
            self.gaits
                .iter()
                .map(|(id, mps)| list![*id, *mps])
                .collect::<Vec<_>>(),
            self.lamps
                .iter()
                .map(|(id, bits)| list![*id, *bits])
                .collect::<Vec<_>>(),
            self.motions.iter().map(motion).collect::<Vec<_>>(),
        ];
        let Value::Array(mut fields) = frame else {
            return;
        };
        fields.extend(self.extra.values());
        fields.extend(self.changes.values());
        msgpack::write(out, &Value::Array(fields));
    }

    fn read(fields: &mut Fields<'_>, version: u32) -> Result<Frame, Wrong> {
        let mut frame = Frame {
            tick: fields.uint(u64::MAX)?,
            elapsed_secs: fields.f64()?,
            delta_secs: fields.f64()?,
            ..Frame::default()
        };
        for mut born in fields.each("an actor")? {
            let (id, parent, description) = (born.u32()?, born.u32()?, born.description()?);
            let at = place(&mut born.fields("a place")?)?;
            frame.born.push(Born {
                id,
                parent,
                family: family(&description.type_id),
                description,
                at,
                on_parent: false,
            });
        }
        let gone = fields.list()?;
        let mut ids = Fields::new("the actors that went", gone);
        for _ in gone {
            frame.gone.push(ids.u32()?);
        }
        for mut pose in fields.each("a pose")? {
            frame.poses.insert(pose.u32()?, place(&mut pose)?);
        }
        for mut given in fields.each("a control")? {
            let id = given.u32()?;
            let (steer, throttle, brake) = (given.f32()?, given.f32()?, given.f32()?);
            frame.pedals.insert(
                id,
                Pedals {
                    steer,
                    throttle,
                    brake,
                    hand_brake: given.bool()?,
                    gear: given.i32()?,
                },
            );
        }
        for mut light in fields.each("a light")? {
            let id = light.u32()?;
            frame.lights.insert(
                id,
                Light {
                    state: light.u8()?,
                    frozen: light.bool()?,
                    elapsed_secs: light.f32()?,
                },
            );
        }
        for mut pair in fields.each("a collision")? {
            frame.collisions.push(Collision {
                number: 0,
                actors: (pair.u32()?, pair.u32()?),
            });
        }
        for mut walker in fields.each("a gait")? {
            frame.gaits.insert(walker.u32()?, walker.f32()?);
        }
        for mut vehicle in fields.each("lamps")? {
            frame.lamps.insert(vehicle.u32()?, vehicle.u32()?);
        }
        for mut motion in fields.each("a motion")? {
            let id = motion.u32()?;
            let mut three = || Ok::<_, Wrong>([motion.f64()?, motion.f64()?, motion.f64()?]);
            frame.motions.insert(id, [three()?, three()?]);
        }
        if version > OLDEST {
            frame.extra = Extra::read(fields)?;
        }
        if version >= WITH_CHANGES {
            frame.changes = Changes::read(fields)?;
        }
        Ok(frame)
    }
}

fn place(fields: &mut Fields<'_>) -> Result<Transform, Wrong> {
    let location_m = [fields.f64()?, fields.f64()?, fields.f64()?];
    Ok(Transform {
        location_m,
        rotation_deg: [fields.f64()?, fields.f64()?, fields.f64()?],
    })
}
