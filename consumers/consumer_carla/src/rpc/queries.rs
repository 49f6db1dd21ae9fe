//! Calls that query the world's geometry with rays against the triangles that sensors see.

use schema_frames::{Command, CommandReply, RayHit, RaySegment};

use crate::gateway::Gateway;
use crate::list;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes;
use crate::wire::msgpack::Value;
use crate::wire::requests::{Answer, Failure, Outcome};

pub(crate) const CALLS: Calls = &[("project_point", project_point), ("cast_ray", cast_ray)];

/// Longest ray, metres; scripts ask for 1e6 and mean "far".
const MAX_LENGTH_M: f64 = 9_999.0;

/// CARLA's labelled point.
fn labelled(hit: &RayHit) -> Value {
    let [x, y, z] = axes::mirror(hit.point_m);
    list![list![x as f32, y as f32, z as f32], hit.class]
}

/// The first hit from a point along a direction within a distance; `[false, anything]` if there is
/// none.
fn project_point(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (from, direction, distance_m) = (call.vector()?, call.vector()?, call.f64()?);
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length < 1e-6 || distance_m <= 0.0 {
        return Ok(Answer::Value(list![
            false,
            list![list![0.0f32, 0.0f32, 0.0f32], 0u32]
        ]));
    }
    let reach_m = distance_m.min(MAX_LENGTH_M);
    let to = std::array::from_fn(|axis| from[axis] + direction[axis] / length * reach_m);
    let hits = cast(gateway, from, to, false)?;
    let found = hits.first();
    let point = found.map_or_else(|| list![list![0.0f32, 0.0f32, 0.0f32], 0u32], labelled);
    Ok(Answer::Value(list![found.is_some(), point]))
}

/// Every surface between two points.
fn cast_ray(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let (from, to) = (call.vector()?, call.vector()?);
    let hits = cast(gateway, from, to, true)?;
    Ok(Answer::Value(Value::Array(
        hits.iter().map(labelled).collect(),
    )))
}

fn cast(
    gateway: &Gateway,
    from: [f64; 3],
    to: [f64; 3],
    all: bool,
) -> Result<Vec<RayHit>, Failure> {
    let rays = vec![RaySegment {
        from_m: axes::mirror(from),
        to_m: axes::mirror(to),
    }];
    match gateway.commander.ask_one(Command::CastRays { rays, all })? {
        (CommandReply::Hits { rays }, _) => Ok(rays.into_iter().next().unwrap_or_default()),
        (other, _) => Err(Failure::Refused(format!("{other:?} is no answer to a ray"))),
    }
}
