//! Calls about the map's scenery: layers, environment objects, level boxes, street lights.

use schema_frames::scenery::{LampChange, SceneryLampInfo, SceneryObjectInfo};
use schema_frames::{Command, CommandReply, PosedBox};

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes;
use crate::wire::fields::Fields;
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::structures;

pub(crate) const CALLS: Calls = &[
    ("set_ignored_vehicles", |gateway, call| {
        let sensor_id = call.known_actor(gateway)?;
        let ids = call.list()?;
        let mut fields = Fields::new("the ids of vehicles", ids);
        let actor_ids = (0..ids.len())
            .map(|_| fields.u32())
            .collect::<Result<Vec<u32>, _>>()?;
        gateway.commander.ask_one(Command::HideActors {
            sensor_id,
            actor_ids,
        })?;
        Ok(Answer::Void)
    }),
    ("load_map_layer", |gateway, call| {
        switch_layers(gateway, call, true)
    }),
    ("unload_map_layer", |gateway, call| {
        switch_layers(gateway, call, false)
    }),
    ("get_names_of_all_objects", |gateway, _| {
        let names = scenery(gateway)?
            .0
            .into_iter()
            .map(|object| Value::from(object.name.as_str()))
            .collect();
        Ok(Answer::Value(Value::Array(names)))
    }),
    ("get_all_level_BBs", level_boxes),
    ("get_environment_objects", environment_objects),
    ("enable_environment_objects", enable_objects),
    ("query_lights_state", |gateway, _| {
        let lamps = scenery(gateway)?.1;
        Ok(Answer::Value(Value::Array(
            lamps.iter().map(lamp_state).collect(),
        )))
    }),
    ("update_lights_state", update_lamps),
    ("update_day_night_cycle", |gateway, call| {
        call.text()?;
        let on = call.bool()?;
        gateway.commander.tell(Command::SetLampCycle { on });
        Ok(Answer::Void)
    }),
];

/// CARLA's tag for "any kind".
const ANY: u8 = 255;

fn world_box(object: &SceneryObjectInfo) -> Value {
    structures::posed_box(&PosedBox {
        pose: object.box_pose,
        half_m: object.box_half_m,
    })
}

/// `[id, location, intensity, group, color, is_on]`.
fn lamp_state(lamp: &SceneryLampInfo) -> Value {
    let [x, y, z] = axes::mirror(lamp.position_m).map(|metres| metres as f32);
    let [r, g, b] = lamp.rgb;
    list![
        lamp.lamp,
        list![x, y, z],
        lamp.intensity_lm,
        lamp.group,
        list![r, g, b],
        lamp.on
    ]
}

/// The map's complete scenery.
fn scenery(gateway: &Gateway) -> Result<(Vec<SceneryObjectInfo>, Vec<SceneryLampInfo>), Failure> {
    match gateway.commander.ask_one(Command::Scenery)? {
        (CommandReply::Scenery { objects, lamps }, _) => Ok((objects, lamps)),
        (other, _) => Err(Failure::Refused(format!(
            "{other:?} is no answer to a question for scenery"
        ))),
    }
}

fn tagged(gateway: &Gateway, tag: u8) -> Result<Vec<SceneryObjectInfo>, Failure> {
    let (mut objects, _) = scenery(gateway)?;
    objects.retain(|object| tag == ANY || object.class == tag);
    Ok(objects)
}

fn switch_layers(gateway: &Gateway, call: &mut Call<'_>, shown: bool) -> Outcome {
    let layers = call.u16()?;
    gateway
        .commander
        .ask_one(Command::ShowLayers { layers, shown })?;
    Ok(Answer::Void)
}

fn level_boxes(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let shown = tagged(gateway, call.u8()?)?
        .into_iter()
        .filter(|object| object.shown);
    Ok(Answer::Value(Value::Array(
        shown.map(|object| world_box(&object)).collect(),
    )))
}

fn environment_objects(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let object = |object: &SceneryObjectInfo| {
        let transform = structures::transform(&axes::transform(&object.pose.into()));
        list![
            transform,
            world_box(object),
            u64::from(object.id),
            object.name.as_str(),
            object.class
        ]
    };
    Ok(Answer::Value(Value::Array(
        tagged(gateway, call.u8()?)?.iter().map(object).collect(),
    )))
}

fn enable_objects(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let mut ids = call.fields("the ids")?;
    let mut object_ids = Vec::new();
    while !ids.rest().is_empty() {
        object_ids.push(ids.u32()?);
    }
    let shown = call.bool()?;
    gateway
        .commander
        .ask_one(Command::ShowObjects { object_ids, shown })?;
    Ok(Answer::Void)
}

fn update_lamps(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    call.text()?;
    let mut lamps = call.fields("the lights")?;
    let mut changes = Vec::new();
    while !lamps.rest().is_empty() {
        let mut lamp = lamps.fields("a light")?;
        let number = lamp.u32()?;
        lamp.vector()?;
        let (intensity_lm, group) = (lamp.f32()?, lamp.u8()?);
        let mut color = lamp.fields("a colour")?;
        let rgb = [color.u8()?, color.u8()?, color.u8()?];
        changes.push(LampChange {
            lamp: number,
            on: Some(lamp.bool()?),
            rgb: Some(rgb),
            intensity_lm: Some(intensity_lm),
            group: Some(group),
        });
    }
    let set = |changes: &[LampChange]| {
        gateway.commander.ask_one(Command::SetSceneryLamps {
            changes: changes.to_vec(),
        })
    };
    if let Err(error) = set(&changes) {
        // A client's list of lamps outlives the map that it was made for. CARLA's server passes over
        // lamps that it does not have.
        let (n_changes, lamps) = (changes.len(), scenery(gateway)?.1);
        changes.retain(|change| (change.lamp as usize) < lamps.len());
        if changes.len() == n_changes {
            return Err(error.into());
        }
        set(&changes)?;
    }
    gateway.recorder.note_street_lights(&changes);
    Ok(Answer::Void)
}
