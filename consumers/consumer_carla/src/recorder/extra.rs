//! What a recording holds besides motion when it is started with `additional_data`: boxes, trigger
//! volumes, times of lights, the machine's clock.

use std::collections::BTreeMap;

use schema_frames::{ActorRecord, BodyBox};

use crate::list;
use crate::state::known_world::Known;
use crate::wire::axes;
use crate::wire::fields::{Fields, Wrong};
use crate::wire::msgpack::Value;

/// Centre and half extents of a box in its actor's space, metres.
pub type ActorBox = [[f64; 3]; 2];

/// This part of one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Extra {
    /// Boxes of vehicles and walkers that appeared.
    pub boxes: BTreeMap<u32, ActorBox>,
    /// Trigger volumes of lights and signs that appeared.
    pub triggers: BTreeMap<u32, ActorBox>,
    /// Green, yellow and red times of lights that appeared or whose times were set, seconds.
    pub light_times: BTreeMap<u32, [f32; 3]>,
    /// Seconds of the machine's clock since the recording began; `None` without additional data.
    pub platform_secs: Option<f64>,
}

fn actor_box(body: &BodyBox) -> ActorBox {
    [
        axes::mirror(body.centre_m).map(|metres| f64::from(metres) + 0.0),
        body.half_m.map(f64::from),
    ]
}

impl Extra {
    /// Notes the boxes of an actor that appeared.
    pub fn note(&mut self, known: &Known, record: &ActorRecord) {
        let Some(info) = known.actors.get(&record.id) else {
            return;
        };
        if record.vehicle().is_some() || record.walker().is_some() {
            self.boxes.insert(record.id, actor_box(&info.body_box));
        }
        if let Some(trigger) = &info.trigger_box {
            self.triggers
                .insert(record.id, actor_box(&axes::sign_box(trigger)));
        }
    }

    /// The fields that follow those of the motion in a frame.
    pub fn values(&self) -> [Value; 4] {
        let boxes = |boxes: &BTreeMap<u32, ActorBox>| {
            Value::Array(
                boxes
                    .iter()
                    .map(|(id, [o, h])| list![*id, o[0], o[1], o[2], h[0], h[1], h[2]])
                    .collect(),
            )
        };
        let times = self
            .light_times
            .iter()
            .map(|(id, [green, yellow, red])| list![*id, *green, *yellow, *red]);
        let platform = self
            .platform_secs
            .map_or(list![false], |secs| list![true, secs]);
        [
            boxes(&self.boxes),
            boxes(&self.triggers),
            Value::Array(times.collect()),
            platform,
        ]
    }

    /// Reads those fields.
    pub(super) fn read(fields: &mut Fields<'_>) -> Result<Extra, Wrong> {
        let boxes = read_boxes(fields, "a box")?;
        let triggers = read_boxes(fields, "a trigger volume")?;
        let mut light_times = BTreeMap::new();
        for mut light in fields.each("times of a light")? {
            light_times.insert(light.u32()?, [light.f32()?, light.f32()?, light.f32()?]);
        }
        Ok(Extra {
            boxes,
            triggers,
            light_times,
            platform_secs: fields.optional_f64()?,
        })
    }
}

fn read_boxes(
    fields: &mut Fields<'_>,
    what: &'static str,
) -> Result<BTreeMap<u32, ActorBox>, Wrong> {
    let mut boxes = BTreeMap::new();
    for mut one in fields.each(what)? {
        let id = one.u32()?;
        let mut three = || Ok::<_, Wrong>([one.f64()?, one.f64()?, one.f64()?]);
        boxes.insert(id, [three()?, three()?]);
    }
    Ok(boxes)
}
