//! Calls about the bones of walkers.

use schema_frames::document::PoseText;
use schema_frames::{BoneReading, Command, CommandReply, HeldBone, SkeletonAction};

use crate::axes;
use crate::fields::Fields;
use crate::gateway::{Answer, Failure, Gateway, Outcome};
use crate::list;
use crate::msgpack::Value;
use crate::rpc::{Call, Calls};
use crate::shapes;

pub(crate) const CALLS: Calls = &[
    ("get_bones_transform", |gateway, call| {
        let actor = gateway.known_actor(call)?;
        let bones = gateway.bones(actor)?.iter().map(bone).collect::<Vec<_>>();
        Ok(Answer::Value(list![Value::Array(bones)]))
    }),
    ("set_bones_transform", |gateway, call| {
        let actor = gateway.known_actor(call)?;
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
        gateway.tell_skeleton(actor, SkeletonAction::Hold { bones })
    }),
    ("blend_pose", |gateway, call| {
        let actor = gateway.known_actor(call)?;
        let ratio = f64::from(call.f32()?.clamp(0.0, 1.0));
        gateway.tell_skeleton(actor, SkeletonAction::Blend { ratio })
    }),
    ("get_pose_from_animation", |gateway, call| {
        let actor = gateway.known_actor(call)?;
        gateway.tell_skeleton(actor, SkeletonAction::Capture)
    }),
    ("get_actor_bone_names", |gateway, call| {
        gateway.bone_list(call, |bone| bone.name.as_str().into())
    }),
    ("get_actor_bone_world_transforms", |gateway, call| {
        gateway.bone_list(call, |bone| transform(bone.bone_in_world))
    }),
    ("get_actor_bone_relative_transforms", |gateway, call| {
        gateway.bone_list(call, |bone| transform(bone.bone_in_parent))
    }),
];

fn transform(pose: PoseText) -> Value {
    shapes::transform(&axes::transform(&pose.into()))
}

fn bone(bone: &BoneReading) -> Value {
    list![
        bone.name.as_str(),
        transform(bone.bone_in_world),
        transform(bone.bone_in_body),
        transform(bone.bone_in_parent)
    ]
}

impl Gateway {
    /// Bones of a walker; none of anything else.
    fn bones(&self, actor_id: u32) -> Result<Vec<BoneReading>, Failure> {
        let is_walker = self
            .world
            .known()
            .actors
            .get(&actor_id)
            .is_some_and(|actor| actor.type_id.starts_with("walker."));
        if !is_walker {
            return Ok(Vec::new());
        }
        match self.commander.ask_one(Command::Skeleton {
            actor_id,
            action: SkeletonAction::Read,
        })? {
            (CommandReply::Bones { bones }, _) => Ok(bones),
            _ => Ok(Vec::new()),
        }
    }

    fn bone_list(&self, call: &mut Call<'_>, item: impl Fn(&BoneReading) -> Value) -> Outcome {
        let actor = self.known_actor(call)?;
        Ok(Answer::Value(Value::Array(
            self.bones(actor)?.iter().map(item).collect(),
        )))
    }

    fn tell_skeleton(&self, actor_id: u32, action: SkeletonAction) -> Outcome {
        self.commander.tell(Command::Skeleton { actor_id, action });
        Ok(Answer::Void)
    }
}
