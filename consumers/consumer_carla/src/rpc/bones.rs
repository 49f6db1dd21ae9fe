//! Calls about the bones of walkers.

use schema_frames::document::PoseText;
use schema_frames::{BoneReading, Command, CommandReply, HeldBone, SkeletonAction};

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes;
use crate::wire::fields::{Fields, Structures as _};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::structures;

pub(crate) const CALLS: Calls = &[
    ("get_bones_transform", |gateway, call| {
        let actor = call.known_actor(gateway)?;
        let bones = bones(gateway, actor)?.iter().map(bone).collect::<Vec<_>>();
        Ok(Answer::Value(list![Value::Array(bones)]))
    }),
    ("set_bones_transform", |gateway, call| {
        let actor = call.known_actor(gateway)?;
        let mut bones = Vec::new();
        let mut control = call.fields("a walker's bones")?;
        let mut items = Fields::new("a list of bones", control.list()?);
        while !items.rest().is_empty() {
            let mut fields = items.fields("a bone")?;
            let name = fields.text()?.to_owned();
            bones.push(HeldBone {
                name,
                bone_in_parent: axes::pose(&fields.transform()?).into(),
            });
        }
        tell_skeleton(gateway, actor, SkeletonAction::Hold { bones })
    }),
    ("blend_pose", |gateway, call| {
        let actor = call.known_actor(gateway)?;
        let ratio = f64::from(call.f32()?.clamp(0.0, 1.0));
        tell_skeleton(gateway, actor, SkeletonAction::Blend { ratio })
    }),
    ("get_pose_from_animation", |gateway, call| {
        let actor = call.known_actor(gateway)?;
        tell_skeleton(gateway, actor, SkeletonAction::Capture)
    }),
    ("get_actor_bone_names", |gateway, call| {
        bone_list(gateway, call, |bone| bone.name.as_str().into())
    }),
    ("get_actor_bone_world_transforms", |gateway, call| {
        bone_list(gateway, call, |bone| transform(bone.bone_in_world))
    }),
    ("get_actor_bone_relative_transforms", |gateway, call| {
        bone_list(gateway, call, |bone| transform(bone.bone_in_parent))
    }),
];

fn transform(pose: PoseText) -> Value {
    structures::transform(&axes::transform(&pose.into()))
}

fn bone(bone: &BoneReading) -> Value {
    list![
        bone.name.as_str(),
        transform(bone.bone_in_world),
        transform(bone.bone_in_body),
        transform(bone.bone_in_parent)
    ]
}

/// The bones of a walker; an empty list for other actors.
fn bones(gateway: &Gateway, actor_id: u32) -> Result<Vec<BoneReading>, Failure> {
    let is_walker = gateway
        .world
        .known()
        .actors
        .get(&actor_id)
        .is_some_and(|actor| actor.type_id.starts_with("walker."));
    if !is_walker {
        return Ok(Vec::new());
    }
    match gateway.commander.ask_one(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Read,
    })? {
        (CommandReply::Bones { bones }, _) => Ok(bones),
        _ => Ok(Vec::new()),
    }
}

fn bone_list(
    gateway: &Gateway,
    call: &mut Call<'_>,
    item: impl Fn(&BoneReading) -> Value,
) -> Outcome {
    let actor = call.known_actor(gateway)?;
    Ok(Answer::Value(Value::Array(
        bones(gateway, actor)?.iter().map(item).collect(),
    )))
}

fn tell_skeleton(gateway: &Gateway, actor_id: u32, action: SkeletonAction) -> Outcome {
    gateway
        .commander
        .tell(Command::Skeleton { actor_id, action });
    Ok(Answer::Void)
}
