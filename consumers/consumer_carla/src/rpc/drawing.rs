//! Debug drawing: shapes in the world appear in colour images; texts and shapes on the server's own
//! screen do not.

use schema_frames::{Command, DebugDraw, DebugShape, PosedBox};

use crate::gateway::Gateway;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes::{self, Transform};
use crate::wire::fields::{Fields, Wrong};
use crate::wire::requests::{Answer, Outcome};

pub(crate) const CALLS: Calls = &[
    ("draw_debug_shape", draw_debug_shape),
    ("clear_debug_shape", |gateway, _| {
        gateway.commander.tell(Command::ClearDebug);
        Ok(Answer::Void)
    }),
    // Texts are never drawn, so there is nothing to clear.
    ("clear_debug_string", |_, _| Ok(Answer::Void)),
];

/// Thicker strokes are drawn this thick, metres.
const MAX_WIDTH_M: f64 = 100.0;
/// A longer life than this counts as for ever, seconds.
const MAX_LIFE_SECS: f64 = 1e9;

/// Reads what to draw; `None` for texts and shapes on the server's screen.
fn read_primitive(fields: &mut Fields<'_>) -> Result<Option<DebugDraw>, Wrong> {
    let mut variant = fields.fields("a primitive")?;
    let (kind, mut given) = (variant.u8()?, variant.fields("a primitive's fields")?);
    let width = |given: &mut Fields<'_>| given.f64().map(|metres| metres.clamp(0.0, MAX_WIDTH_M));
    let place = |given: &mut Fields<'_>| given.vector().map(axes::mirror);
    Ok(match kind {
        0 => Some(DebugDraw::Point {
            at_m: place(&mut given)?,
            size_m: width(&mut given)?,
        }),
        1 => Some(DebugDraw::Line {
            from_m: place(&mut given)?,
            to_m: place(&mut given)?,
            width_m: width(&mut given)?,
        }),
        2 => {
            let mut line = given.fields("an arrow's line")?;
            let (from_m, to_m, width_m) = (place(&mut line)?, place(&mut line)?, width(&mut line)?);
            Some(DebugDraw::Arrow {
                from_m,
                to_m,
                width_m,
                head_m: width(&mut given)?,
            })
        }
        3 => {
            let mut boxed = given.fields("a bounding box")?;
            let (location_m, half_m) = (boxed.vector()?, boxed.vector()?);
            // The box is centred on its location in the world and turned by the separate rotation;
            // its own rotation is ignored, as in CARLA.
            let rotation_deg = given.vector()?;
            let pose = axes::pose(&Transform {
                location_m,
                rotation_deg,
            })
            .into();
            let half_m = half_m.map(f64::abs);
            Some(DebugDraw::Box {
                edges_of: PosedBox { pose, half_m },
                width_m: width(&mut given)?,
            })
        }
        4..=8 => None,
        _ => {
            return Err(Wrong::Value(format!(
                "a primitive is of kind {kind}, but must be 0 to 8"
            )));
        }
    })
}

fn draw_debug_shape(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let mut shape = call.fields("a debug shape")?;
    let draw = read_primitive(&mut shape)?;
    let mut color = shape.fields("a colour")?;
    let color_rgb = [color.u8()?, color.u8()?, color.u8()?];
    let (life_secs, persistent) = (shape.f64()?, shape.bool()?);
    let life_nanos = match life_secs {
        secs if secs > MAX_LIFE_SECS => None,
        secs if secs > 0.0 => Some((secs * 1e9) as u64),
        _ if persistent => None,
        _ => Some(0),
    };
    if let Some(draw) = draw {
        gateway.commander.tell(Command::DrawDebug {
            shapes: vec![DebugShape {
                draw,
                color_rgb,
                life_nanos,
            }],
        });
    }
    Ok(Answer::Void)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::list;
    use crate::wire::msgpack::Value;

    fn read(primitive: Value) -> Result<Option<DebugDraw>, Wrong> {
        read_primitive(&mut Fields::new("test", &[primitive]))
    }

    #[test]
    fn shapes_are_mirrored_and_texts_are_nothing() {
        let at = || list![1.0f32, 2.0f32, 3.0f32];
        let line = read(list![
            1u32,
            list![at(), list![4.0f32, 5.0f32, 6.0f32], 0.5f32]
        ])
        .unwrap();
        assert_eq!(
            line,
            Some(DebugDraw::Line {
                from_m: [1.0, -2.0, 3.0],
                to_m: [4.0, -5.0, 6.0],
                width_m: 0.5
            })
        );
        let arrow = read(list![2u32, list![list![at(), at(), 0.1f32], 0.3f32]]).unwrap();
        assert!(matches!(arrow, Some(DebugDraw::Arrow { .. })), "{arrow:?}");
        let turned = list![0.0f32, 90.0f32, 0.0f32];
        let boxed = read(list![
            3u32,
            list![list![at(), at(), turned.clone(), 0u32], turned, 0.1f32]
        ])
        .unwrap();
        let Some(DebugDraw::Box { edges_of, .. }) = boxed else {
            panic!("{boxed:?}")
        };
        assert_eq!(
            (edges_of.pose.translation_m, edges_of.half_m),
            ([1.0, -2.0, 3.0], [1.0, 2.0, 3.0])
        );
        assert!(
            (edges_of.pose.rotation_xyzw[2] + 0.5f64.sqrt()).abs() < 1e-6,
            "90° clockwise: {:?}",
            edges_of.pose
        );
        assert_eq!(read(list![4u32, list![at(), "text", false]]).unwrap(), None);
        assert!(
            read(list![9u32, list![at()]])
                .unwrap_err()
                .to_string()
                .contains("0 to 8")
        );
    }
}
