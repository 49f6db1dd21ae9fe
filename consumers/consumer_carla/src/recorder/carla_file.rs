//! CARLA's own recordings (`.log`): a head, then packets, each with its number and size; the
//! packets between a start and an end make a frame. `docs/reference/carla-recorder.md` says what becomes of
//! each.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read};

use nalgebra::Point3;
use schema_frames::VehiclePhysics;

use crate::recorder::carla_packets::{self as packets, Bytes, records};
use crate::recorder::changes::Bones;
use crate::recorder::frame::{Frame, Head, Origin};
use crate::recorder::read_error::ReadError;
use crate::recorder::text::date;
use crate::wire::axes;
use crate::wire::fields::Fields;
use crate::wire::msgpack::Value;
use crate::wire::vehicle_physics::read_physics;
use crate::wire::weather::read_weather;

/// The bytes that CARLA's recordings begin with: version and name, each after its length.
pub const BEGIN: &[u8] = b"\x0e\x00CARLA_RECORDER";
/// The version that CARLA 0.9 writes.
const VERSION: u16 = 1;
/// Most bytes that a frame's packets may have together; what they mean takes up to twelve times as
/// much memory.
const MAX_FRAME_BYTES: u64 = 16 << 20;
/// Most vehicles whose doors a recording may move.
const MAX_DOORED: usize = 65_536;

/// Numbers of CARLA's packets.
mod id {
    pub const FRAME_START: u8 = 0;
    pub const FRAME_END: u8 = 1;
    pub const EVENT_ADD: u8 = 2;
    pub const EVENT_DEL: u8 = 3;
    pub const EVENT_PARENT: u8 = 4;
    pub const COLLISION: u8 = 5;
    pub const POSITION: u8 = 6;
    pub const STATE: u8 = 7;
    pub const ANIM_VEHICLE: u8 = 8;
    pub const ANIM_WALKER: u8 = 9;
    pub const VEHICLE_LIGHT: u8 = 10;
    pub const SCENE_LIGHT: u8 = 11;
    pub const KINEMATICS: u8 = 12;
    pub const BOUNDING_BOX: u8 = 13;
    pub const PLATFORM_TIME: u8 = 14;
    pub const PHYSICS_CONTROL: u8 = 15;
    pub const TRAFFIC_LIGHT_TIME: u8 = 16;
    pub const TRIGGER_VOLUME: u8 = 17;
    /// The tick's number; the weather in versions that have no such packet.
    pub const FRAME_COUNTER: u8 = 18;
    pub const WALKER_BONES: u8 = 19;
    /// Doors, wheels and riders, which versions number in different orders.
    pub const DOORS_AND_WHEELS: std::ops::RangeInclusive<u8> = 21..=23;
    pub const WEATHER: u8 = 24;
}

/// Reads the frames of such a file.
#[derive(Debug, Default)]
pub(super) struct CarlaFile {
    /// Whether vectors consist of doubles; `None` until a packet has shown it.
    wide: Option<bool>,
    /// Doors of vehicles that are open, as bits.
    doors: BTreeMap<u32, u8>,
    /// Numbers of packets that were left out because their bytes have another form.
    left_out: BTreeSet<u8>,
}

/// Reads exactly as many bytes as fit; `None` if the file ends before.
fn exactly<const N: usize>(source: &mut impl Read) -> io::Result<Option<[u8; N]>> {
    let mut bytes = [0; N];
    match source.read_exact(&mut bytes) {
        Ok(()) => Ok(Some(bytes)),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(error),
    }
}

/// Reads this many bytes without reserving memory for more than there are.
fn bytes(source: &mut impl Read, n_bytes: u64) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    source.take(n_bytes).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 == n_bytes).then_some(bytes))
}

fn text(source: &mut impl Read) -> io::Result<Option<String>> {
    let Some(length) = exactly(source)? else {
        return Ok(None);
    };
    let text = bytes(source, u16::from_le_bytes(length).into())?;
    Ok(text.map(|text| String::from_utf8_lossy(&text).into_owned()))
}

impl CarlaFile {
    /// Reads the head.
    pub fn begin(source: &mut impl Read) -> Result<(CarlaFile, Head), ReadError> {
        let version = u16::from_le_bytes(exactly(source)?.ok_or(ReadError::Foreign)?);
        let _magic = text(source)?.ok_or(ReadError::Foreign)?;
        if version != VERSION {
            return Err(ReadError::CarlaVersion {
                version,
                known: VERSION,
            });
        }
        let unix_secs = i64::from_le_bytes(exactly(source)?.ok_or(ReadError::Empty)?);
        let map = text(source)?.ok_or(ReadError::Empty)?;
        let (day, time) = date(unix_secs);
        let [year, month, day] = day;
        let head = Head {
            origin: Origin::Carla,
            version: version.into(),
            map,
            date: format!("{month:02}/{day:02}/{:02} {time}", year.rem_euclid(100)),
        };
        Ok((CarlaFile::default(), head))
    }

    /// Reads the next frame; `None` where the file ends. The flag says whether it ends within one.
    pub fn next(&mut self, source: &mut impl Read) -> Result<(Option<Frame>, bool), ReadError> {
        let mut building: Option<Building> = None;
        let mut n_bytes = 0;
        loop {
            let Some([number]) = exactly(source)? else {
                return Ok((None, building.is_some()));
            };
            let Some(size) = exactly(source)? else {
                return Ok((None, true));
            };
            let size = u64::from(u32::from_le_bytes(size));
            let is_read = match number {
                id::FRAME_START | id::FRAME_END => true,
                _ => building.is_some() && is_known(number),
            };
            if !is_read {
                if io::copy(&mut source.take(size), &mut io::sink())? < size {
                    return Ok((None, true));
                }
                continue;
            }
            n_bytes += size;
            if n_bytes > MAX_FRAME_BYTES {
                let number = building.map_or(0, |building| building.frame.number);
                return Err(ReadError::LargeFrame {
                    number,
                    max: MAX_FRAME_BYTES,
                });
            }
            let Some(packet) = bytes(source, size)? else {
                return Ok((None, true));
            };
            match (number, building.as_mut()) {
                (id::FRAME_START, None) => building = Some(Building::begin(&packet)?),
                (id::FRAME_START, Some(begun)) => {
                    return Err(ReadError::Unfinished {
                        number: begun.frame.number,
                    });
                }
                (id::FRAME_END, _) => {
                    if let Some(building) = building.take() {
                        return Ok((Some(building.end()), false));
                    }
                }
                (_, Some(begun)) => self.packet(number, &packet, begun)?,
                (_, None) => {}
            }
        }
    }

    /// Adds a packet to its frame.
    fn packet(&mut self, number: u8, packet: &[u8], to: &mut Building) -> Result<(), ReadError> {
        let frame = &mut to.frame;
        let understood = match number {
            id::EVENT_ADD => self
                .vectors(packet, packets::born)
                .map(|all| frame.born.extend(all)),
            id::EVENT_DEL => {
                records(packet, false, |bytes| bytes.u32()).map(|all| frame.gone.extend(all))
            }
            id::EVENT_PARENT => {
                records(packet, false, packets::pair).map(|all| frame.attached.extend(all))
            }
            id::COLLISION => {
                records(packet, false, packets::collision).map(|all| frame.collisions.extend(all))
            }
            id::POSITION => self
                .vectors(packet, packets::pose)
                .map(|all| frame.poses.extend(all)),
            id::STATE => records(packet, false, packets::light).map(|all| frame.lights.extend(all)),
            id::ANIM_VEHICLE => {
                records(packet, false, packets::pedals).map(|all| frame.pedals.extend(all))
            }
            id::ANIM_WALKER => {
                records(packet, false, packets::gait).map(|all| frame.gaits.extend(all))
            }
            id::VEHICLE_LIGHT => {
                records(packet, false, packets::pair).map(|all| frame.lamps.extend(all))
            }
            id::SCENE_LIGHT => records(packet, false, packets::street_light)
                .map(|all| frame.changes.street_lights.extend(all)),
            id::KINEMATICS => self
                .vectors(packet, packets::motion)
                .map(|all| frame.motions.extend(all)),
            id::BOUNDING_BOX => self
                .vectors(packet, packets::actor_box)
                .map(|all| frame.extra.boxes.extend(all)),
            id::TRIGGER_VOLUME => self
                .vectors(packet, packets::actor_box)
                .map(|all| frame.extra.triggers.extend(all)),
            id::PLATFORM_TIME => Bytes::of(packet)
                .f64()
                .map(|secs| frame.extra.platform_secs = Some(secs)),
            id::PHYSICS_CONTROL => physics(packet).map(|all| to.physics.extend(all)),
            id::TRAFFIC_LIGHT_TIME => records(packet, false, packets::light_times)
                .map(|all| frame.extra.light_times.extend(all)),
            id::WALKER_BONES => self
                .vectors(packet, packets::bones)
                .map(|all: Vec<(u32, Bones)>| frame.changes.bones.extend(all)),
            id::FRAME_COUNTER if packet.len() == size_of::<u64>() => Some(()),
            id::FRAME_COUNTER | id::WEATHER => weather(packet, frame),
            _ => {
                // Wheels and riders are left to the vehicles themselves.
                if let Some(all) = records(packet, false, packets::doors) {
                    self.move_doors(all, frame)?;
                }
                Some(())
            }
        };
        if understood.is_none() {
            if matches!(number, id::EVENT_ADD..=id::EVENT_PARENT | id::POSITION) {
                return Err(ReadError::Packet {
                    packet: number,
                    number: frame.number,
                });
            }
            if self.left_out.insert(number) {
                tracing::warn!(
                    packet = number,
                    frame = frame.number,
                    "packets of this number are left out: their bytes have a form of another version"
                );
            }
        }
        Ok(())
    }

    /// Records with vectors, of the width that the file has shown or now shows.
    fn vectors<T>(
        &mut self,
        packet: &[u8],
        one: impl Fn(&mut Bytes<'_>) -> Option<T>,
    ) -> Option<Vec<T>> {
        if let Some(wide) = self.wide {
            return records(packet, wide, one);
        }
        let (wide, all) = [false, true]
            .into_iter()
            .find_map(|wide| Some((wide, records(packet, wide, &one)?)))?;
        self.wide = Some(wide).filter(|_| !all.is_empty());
        Some(all)
    }

    fn move_doors(
        &mut self,
        all: Vec<(u32, u8, bool)>,
        frame: &mut Frame,
    ) -> Result<(), ReadError> {
        for (id, moved, opens) in all {
            let open = self.doors.entry(id).or_default();
            *open = if opens { *open | moved } else { *open & !moved };
            frame.changes.doors.insert(id, *open);
        }
        if self.doors.len() > MAX_DOORED {
            return Err(ReadError::ManyActors { max: MAX_DOORED });
        }
        Ok(())
    }
}

fn is_known(number: u8) -> bool {
    matches!(number, id::EVENT_ADD..=id::WALKER_BONES | id::WEATHER)
        || id::DOORS_AND_WHEELS.contains(&number)
}

/// Physics control of vehicles, with the stiffness of tyres or without.
fn physics(packet: &[u8]) -> Option<Vec<(u32, VehiclePhysics)>> {
    let all = [true, false].into_iter().find_map(|with_stiffness| {
        records(packet, false, |bytes| {
            packets::physics(bytes, with_stiffness)
        })
    })?;
    let read = |(id, value): (u32, Value)| {
        let value = [value];
        let control = read_physics(&mut Fields::new("a packet", &value)).ok()?;
        Some((id, control))
    };
    all.into_iter().map(read).collect()
}

fn weather(packet: &[u8], frame: &mut Frame) -> Option<()> {
    let last = records(packet, false, packets::weather)?.pop();
    if let Some(parameters) = last {
        let weather = read_weather(&mut Fields::new("a packet", &parameters)).ok()?;
        frame.changes.weather = Some(weather);
    }
    Some(())
}

/// A frame whose packets are being read.
#[derive(Debug)]
struct Building {
    frame: Frame,
    /// Physics control with the wheels' places in the world.
    physics: Vec<(u32, VehiclePhysics)>,
}

impl Building {
    fn begin(packet: &[u8]) -> Result<Building, ReadError> {
        let mut bytes = Bytes::of(packet);
        let mut start = || Some((bytes.u64()?, bytes.f64()?, bytes.f64()?));
        let (number, delta_secs, elapsed_secs) = start().ok_or(ReadError::Packet {
            packet: id::FRAME_START,
            number: 0,
        })?;
        Ok(Building {
            frame: Frame {
                number,
                delta_secs,
                elapsed_secs,
                ..Frame::default()
            },
            physics: Vec::new(),
        })
    }

    /// Joins what several packets say about the same actor.
    fn end(self) -> Frame {
        let Building { mut frame, physics } = self;
        let mut parents: BTreeMap<u32, u32> = frame.attached.iter().copied().collect();
        for born in &mut frame.born {
            if let Some(parent) = parents.remove(&born.id) {
                (born.parent, born.on_parent) = (parent, true);
            }
        }
        frame.attached = parents.into_iter().collect();
        for (id, mut control) in physics {
            let Some(at) = frame.place(id) else { continue };
            let vehicle_from_world = axes::pose(at).isometry().inverse();
            for wheel in &mut control.wheels {
                let place = vehicle_from_world * Point3::from(wheel.position_m.map(f64::from));
                wheel.position_m = <[f64; 3]>::from(place.coords).map(|metres| metres as f32);
            }
            frame.changes.physics.insert(id, control);
        }
        frame
    }
}
