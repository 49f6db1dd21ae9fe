//! Calls about the bones of walkers and vehicles.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use schema_frames::document::PoseText;
use schema_frames::{
    BoneReading, Command, CommandReply, HeldBone, PhysicsAction, PhysicsAnswer, SkeletonAction,
};
use schema_types::Pose;

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes;
use crate::wire::fields::{Fields, Structures as _};
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};
use crate::wire::structures;

/// Bones of a vehicle's wheels, in the order of its physics control.
const WHEELS: [&str; 4] = [
    "Wheel_Front_Left",
    "Wheel_Front_Right",
    "Wheel_Rear_Left",
    "Wheel_Rear_Right",
];

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
    ("get_vehicle_bone_world_transforms", |gateway, call| {
        bone_list(gateway, call, |bone| transform(bone.bone_in_world))
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

/// The bones of a walker or a vehicle; an empty list for other actors.
fn bones(gateway: &Gateway, actor_id: u32) -> Result<Vec<BoneReading>, Failure> {
    let kind = {
        let known = gateway.world.known();
        let listed = known.actors.get(&actor_id).map(|actor| &actor.type_id);
        let own = known.own.get(&actor_id).map(|own| &own.description.type_id);
        listed.or(own).cloned().unwrap_or_default()
    };
    if kind.starts_with("vehicle.") {
        return vehicle_bones(gateway, actor_id);
    }
    if !kind.starts_with("walker.") {
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

/// The base of a vehicle, and its wheels where they are now: steered, turned and sprung. Their
/// names are those of CARLA's vehicles.
fn vehicle_bones(gateway: &Gateway, actor_id: u32) -> Result<Vec<BoneReading>, Failure> {
    let ask = |action| {
        gateway
            .commander
            .ask_one(Command::Physics { actor_id, action })
    };
    let physics = match ask(PhysicsAction::GetVehiclePhysics)? {
        (
            CommandReply::Physics {
                answer: PhysicsAnswer::VehiclePhysics(physics),
            },
            _,
        ) => physics,
        _ => return Ok(Vec::new()),
    };
    let wheels = match ask(PhysicsAction::GetTelemetry)? {
        (
            CommandReply::Physics {
                answer: PhysicsAnswer::Telemetry(telemetry),
            },
            _,
        ) => telemetry.wheels,
        _ => return Ok(Vec::new()),
    };
    let snapshot = gateway.world.known().snapshot.clone();
    let Some(record) = snapshot.as_ref().and_then(|at| at.actor(actor_id)) else {
        return Ok(Vec::new());
    };
    let travel_m = record.vehicle().map(|part| part.wheel_travel_m);
    let world_from_base = record.world_from_actor.isometry();
    let reading = |name: &str, base_from_bone: Isometry3<f64>| BoneReading {
        name: name.to_owned(),
        bone_in_world: Pose::from(world_from_base * base_from_bone).into(),
        bone_in_body: Pose::from(base_from_bone).into(),
        bone_in_parent: Pose::from(base_from_bone).into(),
    };
    let names: &[&str] = match physics.wheels.len() {
        2 => &["Wheel_Front", "Wheel_Rear"],
        _ => &WHEELS,
    };
    let mut bones = vec![reading("Vehicle_Base", Isometry3::identity())];
    for (i, (wheel, now)) in physics.wheels.iter().zip(&wheels).enumerate() {
        let mut place = Translation3::from(wheel.position_m.map(f64::from));
        place.z += travel_m.map_or(0.0, |travel| {
            f64::from(travel.get(i).copied().unwrap_or(0.0))
        });
        let steered = UnitQuaternion::from_euler_angles(0.0, 0.0, f64::from(now.steer_rad));
        let turned = UnitQuaternion::from_euler_angles(0.0, f64::from(now.roll_rad), 0.0);
        let name = names
            .get(i)
            .map_or_else(|| format!("Wheel_{i}"), |name| (*name).to_owned());
        bones.push(reading(
            &name,
            Isometry3::from_parts(place, steered * turned),
        ));
    }
    Ok(bones)
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
