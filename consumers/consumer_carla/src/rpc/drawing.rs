//! Debug drawing: shapes in the world appear in colour images; texts and shapes on the server's own
//! screen in the spectator's alone.

use schema_frames::query::MAX_DEBUG_TEXT_BYTES;
use schema_frames::{Command, DebugDraw, DebugKind, DebugShape, PosedBox};

use crate::gateway::Gateway;
use crate::rpc::call::{Call, Calls};
use crate::wire::axes::{self, Transform};
use crate::wire::fields::{Fields, Wrong};
use crate::wire::requests::{Answer, Outcome};

pub(crate) const CALLS: Calls = &[
    ("draw_debug_shape", draw_debug_shape),
    ("clear_debug_shape", |gateway, _| {
        clear(gateway, DebugKind::Shapes)
    }),
    ("clear_debug_string", |gateway, _| {
        clear(gateway, DebugKind::Texts)
    }),
];

fn clear(gateway: &Gateway, what: DebugKind) -> Outcome {
    gateway.commander.tell(Command::ClearDebug { what });
    Ok(Answer::Void)
}

/// Thicker strokes are drawn this thick, metres.
const MAX_WIDTH_M: f64 = 100.0;
/// A longer life than this counts as for ever, seconds.
const MAX_LIFE_SECS: f64 = 1e9;

/// Reads what to draw, and whether on the server's screen.
fn read_primitive(fields: &mut Fields<'_>) -> Result<(DebugDraw, bool), Wrong> {
    let mut variant = fields.fields("a primitive")?;
    let (kind, mut given) = (variant.u8()?, variant.fields("a primitive's fields")?);
    // Points, lines, arrows and boxes on the screen are numbered behind the text.
    let (like, on_screen) = match kind {
        5..=8 => (kind - 5, true),
        _ => (kind, false),
    };
    let width = |given: &mut Fields<'_>| given.f64().map(|metres| metres.clamp(0.0, MAX_WIDTH_M));
    let place = |given: &mut Fields<'_>| given.vector().map(axes::mirror);
    let draw = match like {
        0 => DebugDraw::Point {
            at_m: place(&mut given)?,
            size_m: width(&mut given)?,
        },
        1 => DebugDraw::Line {
            from_m: place(&mut given)?,
            to_m: place(&mut given)?,
            width_m: width(&mut given)?,
        },
        2 => {
            let mut line = given.fields("an arrow's line")?;
            let (from_m, to_m, width_m) = (place(&mut line)?, place(&mut line)?, width(&mut line)?);
            DebugDraw::Arrow {
                from_m,
                to_m,
                width_m,
                head_m: width(&mut given)?,
            }
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
            DebugDraw::Box {
                edges_of: PosedBox { pose, half_m },
                width_m: width(&mut given)?,
            }
        }
        4 => {
            let (at_m, mut text) = (place(&mut given)?, given.text()?.to_owned());
            text.truncate(text.floor_char_boundary(MAX_DEBUG_TEXT_BYTES));
            DebugDraw::Text {
                at_m,
                text,
                shadow: given.bool()?,
            }
        }
        _ => {
            return Err(Wrong::Value(format!(
                "a primitive is of kind {kind}, but must be 0 to 8"
            )));
        }
    };
    Ok((draw, on_screen))
}

fn draw_debug_shape(gateway: &Gateway, call: &mut Call<'_>) -> Outcome {
    let mut shape = call.fields("a debug shape")?;
    let (draw, on_screen) = read_primitive(&mut shape)?;
    let mut color = shape.fields("a colour")?;
    let color_rgb = [color.u8()?, color.u8()?, color.u8()?];
    let (life_secs, persistent) = (shape.f64()?, shape.bool()?);
    // What is on the screen lives for one image without a life of its own, `persistent` or not.
    let is_flat = on_screen || matches!(draw, DebugDraw::Text { .. });
    let life_nanos = match life_secs {
        secs if secs > MAX_LIFE_SECS => None,
        secs if secs > 0.0 => Some((secs * 1e9) as u64),
        _ if persistent && !is_flat => None,
        _ => Some(0),
    };
    gateway.commander.tell(Command::DrawDebug {
        shapes: vec![DebugShape {
            draw,
            color_rgb,
            life_nanos,
            on_screen,
        }],
    });
    Ok(Answer::Void)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::list;
    use crate::wire::msgpack::Value;

    fn read(primitive: Value) -> Result<(DebugDraw, bool), Wrong> {
        read_primitive(&mut Fields::new("test", &[primitive]))
    }

    #[test]
    fn shapes_and_texts_are_mirrored_and_those_of_the_screen_are_told_apart() {
        let at = || list![1.0f32, 2.0f32, 3.0f32];
        let line = read(list![
            1u32,
            list![at(), list![4.0f32, 5.0f32, 6.0f32], 0.5f32]
        ])
        .unwrap();
        let expected = DebugDraw::Line {
            from_m: [1.0, -2.0, 3.0],
            to_m: [4.0, -5.0, 6.0],
            width_m: 0.5,
        };
        assert_eq!(line, (expected.clone(), false));
        let on_screen = read(list![
            6u32,
            list![at(), list![4.0f32, 5.0f32, 6.0f32], 0.5f32]
        ]);
        assert_eq!(on_screen.unwrap(), (expected, true));
        let arrow = read(list![2u32, list![list![at(), at(), 0.1f32], 0.3f32]]).unwrap();
        assert!(matches!(arrow.0, DebugDraw::Arrow { .. }), "{arrow:?}");
        let turned = list![0.0f32, 90.0f32, 0.0f32];
        let boxed = read(list![
            3u32,
            list![list![at(), at(), turned.clone(), 0u32], turned, 0.1f32]
        ])
        .unwrap();
        let (DebugDraw::Box { edges_of, .. }, false) = boxed else {
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
        let text = read(list![4u32, list![at(), "text", true]]).unwrap();
        let expected = DebugDraw::Text {
            at_m: [1.0, -2.0, 3.0],
            text: "text".into(),
            shadow: true,
        };
        assert_eq!(text, (expected, false));
        let long = read(list![4u32, list![at(), "é".repeat(4000).as_str(), true]]).unwrap();
        let DebugDraw::Text { text, .. } = long.0 else {
            panic!("{long:?}")
        };
        assert_eq!(text.len(), MAX_DEBUG_TEXT_BYTES, "cut between letters");
        assert!(
            read(list![9u32, list![at()]])
                .unwrap_err()
                .to_string()
                .contains("0 to 8")
        );
    }
}
