//! Finds the triangles that a moving ball may touch.

use super::touch::Ball;
use crate::bvh::{LEAF, NO_TRIANGLE, Tree, TriangleTree};

/// Calls `triangle` with the number of every triangle that the ball may touch within `limit_m`;
/// `triangle` may shorten the limit.
pub(crate) fn visit_near(
    tree: &TriangleTree,
    ball: &Ball,
    limit_m: &mut f64,
    mut triangle: impl FnMut(u32, &mut f64),
) {
    walk_near(&tree.tree, ball, limit_m, |block, limit_m| {
        let numbers = &tree.numbers[block as usize];
        numbers
            .iter()
            .filter(|number| **number != NO_TRIANGLE)
            .for_each(|number| triangle(*number, limit_m));
    });
}

/// Calls `leaf` for every leaf whose box the ball may touch within `limit_m`; `leaf` may shorten
/// the limit.
fn walk_near(tree: &Tree, ball: &Ball, limit_m: &mut f64, mut leaf: impl FnMut(u32, &mut f64)) {
    let mut stack = Vec::new();
    if !tree.nodes.is_empty() {
        stack.push(0);
    }
    while let Some(at) = stack.pop() {
        if at & LEAF != 0 {
            leaf(at & !LEAF, limit_m);
            continue;
        }
        let node = &tree.nodes[at as usize];
        for i in (0..node.n_children as usize).rev() {
            if nears(ball, &node.low(i), &node.high(i), *limit_m) {
                stack.push(node.child[i]);
            }
        }
    }
}

/// Whether the ball may touch a box on its way. Errs towards yes: the exact test decides.
fn nears(ball: &Ball, low: &[f32; 3], high: &[f32; 3], limit_m: f64) -> bool {
    let (mut enter_m, mut leave_m) = (0.0f64, limit_m * (1.0 + 1e-6) + 1e-3);
    let room_m = ball.radius_m + 1e-3;
    for axis in 0..3 {
        let (from, to) = (
            low[axis] as f64 - room_m - ball.centre[axis],
            high[axis] as f64 + room_m - ball.centre[axis],
        );
        let speed = ball.direction[axis];
        if speed.abs() < 1e-12 {
            if from > 0.0 || to < 0.0 {
                return false;
            }
            continue;
        }
        let (a, b) = (from / speed, to / speed);
        (enter_m, leave_m) = (enter_m.max(a.min(b)), leave_m.min(a.max(b)));
    }
    enter_m <= leave_m
}
