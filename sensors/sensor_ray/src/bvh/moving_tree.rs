//! The hierarchy over moving instances. The parts of each actor hang in nodes whose shape depends
//! on the number of parts only; a small hierarchy over the actors is built anew in every tick.
//!
//! The result is a function of the tick alone. A hierarchy that is refitted from tick to tick would
//! depend on where things stood when it was built, and where two surfaces lie at the same distance
//! a ray's answer would depend on the history of the run.

use std::ops::Range;

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use super::tree::{LEAF, Node, Tree, WIDTH};

/// Lower and upper corner.
pub(crate) type Bounds = ([f32; 3], [f32; 3]);

/// The hierarchy over boxes that come group by group. `ends[i]` is the number of the first box
/// after group `i`. Leaves are numbers of boxes, and the leaves of a node have consecutive numbers.
pub(crate) fn moving_tree(boxes: &[Bounds], ends: &[u32]) -> Tree {
    if boxes.is_empty() {
        return Tree::default();
    }
    let group = |i: usize| if i == 0 { 0 } else { ends[i - 1] as usize }..ends[i] as usize;
    let hulls: Vec<Bounds> = (0..ends.len()).map(|i| hull(&boxes[group(i)])).collect();
    let mut tree = Tree::fold(&box_hierarchy(&hulls), 1, |groups| groups[0]);
    tree.nodes.reserve(ends.len() + boxes.len() / 4);
    for upper in 0..tree.nodes.len() {
        for i in 0..tree.nodes[upper].n_children as usize {
            let child = tree.nodes[upper].child[i];
            if child & LEAF != 0 {
                tree.nodes[upper].child[i] =
                    add_parts(&mut tree.nodes, boxes, group((child & !LEAF) as usize));
            }
        }
    }
    tree
}

/// Adds the nodes of a group and returns the number of the first.
fn add_parts(nodes: &mut Vec<Node>, boxes: &[Bounds], items: Range<usize>) -> u32 {
    let (at, n) = (nodes.len(), items.len());
    nodes.push(Node::empty());
    let n_children = if n <= WIDTH {
        n
    } else {
        n.div_ceil(WIDTH).min(WIDTH)
    };
    for i in 0..n_children {
        let share = items.start + n * i / n_children..items.start + n * (i + 1) / n_children;
        let bounds = hull(&boxes[share.clone()]);
        let child = if n <= WIDTH {
            LEAF | share.start as u32
        } else {
            add_parts(nodes, boxes, share)
        };
        nodes[at].set(i, bounds, child);
    }
    nodes[at].n_children = n_children as u32;
    at as u32
}

/// The smallest box around all of them.
fn hull(boxes: &[Bounds]) -> Bounds {
    let wider = |(low, high): Bounds, (a, b): &Bounds| {
        (
            [0, 1, 2].map(|i| low[i].min(a[i])),
            [0, 1, 2].map(|i| high[i].max(b[i])),
        )
    };
    boxes[1..].iter().fold(boxes[0], wider)
}

fn box_hierarchy(boxes: &[Bounds]) -> Bvh2 {
    let aabbs: Vec<Aabb> = boxes
        .iter()
        .map(|(low, high)| Aabb::new(Vec3A::from(*low), Vec3A::from(*high)))
        .collect();
    let indices = (0..boxes.len() as u32).collect();
    PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Low,
        &aabbs,
        indices,
        SortPrecision::U64,
        0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the boxes under a node, each of which must lie in the box that its node has for
    /// it.
    fn leaves(tree: &Tree, at: u32, boxes: &[Bounds], out: &mut Vec<u32>) {
        let node = &tree.nodes[at as usize];
        for i in 0..node.n_children as usize {
            let first = out.len();
            if node.child[i] & LEAF != 0 {
                out.push(node.child[i] & !LEAF);
            } else {
                leaves(tree, node.child[i], boxes, out);
            }
            for leaf in &out[first..] {
                let (low, high) = boxes[*leaf as usize];
                assert!(
                    (0..3)
                        .all(|axis| node.low(i)[axis] <= low[axis]
                            && high[axis] <= node.high(i)[axis]),
                    "box {leaf} sticks out"
                );
            }
        }
    }

    #[test]
    fn every_box_hangs_in_the_tree_once_and_inside_of_all_boxes_above() {
        let mut rng = fastrand::Rng::with_seed(5);
        for groups in [
            vec![1],
            vec![8],
            vec![9],
            vec![12, 1, 5, 64, 65, 200],
            vec![1; 300],
            vec![12; 60],
        ] {
            let ends: Vec<u32> = groups
                .iter()
                .scan(0, |end, n| {
                    *end += n;
                    Some(*end)
                })
                .collect();
            let n = *ends.last().expect("there are groups");
            let boxes: Vec<Bounds> = (0..n)
                .map(|_| {
                    let low = [rng.f32() * 200.0, rng.f32() * 200.0, rng.f32()];
                    (low, low.map(|x| x + rng.f32()))
                })
                .collect();
            let tree = moving_tree(&boxes, &ends);
            let mut found = Vec::new();
            leaves(&tree, 0, &boxes, &mut found);
            found.sort_unstable();
            assert!(
                found.iter().copied().eq(0..n),
                "{} of {n} boxes",
                found.len()
            );
            assert_eq!(tree.bounds, Some(hull(&boxes)));
        }
        assert!(moving_tree(&[], &[]).nodes.is_empty());
    }
}
