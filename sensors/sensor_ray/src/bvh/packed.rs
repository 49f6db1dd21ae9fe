//! Nodes as the GPU walks them: 80 bytes each, the children's boxes quantised to a byte per side,
//! the children sorted into slots by octant.
//!
//! Source: Ylitie, Karras and Laine, *Efficient Incoherent Ray Traversal on GPUs Through Compressed
//! Wide BVHs* (HPG 2017).

use super::tree::{LEAF, Node, Tree, WIDTH};

/// 32-bit words of a node: origin (3), exponents and inner slots, first child, first item, meta
/// (2), then lower and upper sides: x, y, z lower, x, y, z upper (2 each).
pub(crate) const NODE_WORDS: usize = 20;

/// Which word of a node holds the number of its first child.
pub(crate) const FIRST_CHILD: usize = 4;

/// Meta byte of a slot that holds no leaf.
const NO_CHILD: u8 = 0xff;

/// A hierarchy packed for the GPU; the root is node 0.
#[derive(Clone, Debug, Default)]
pub(crate) struct Packed {
    pub nodes: Vec<[u32; NODE_WORDS]>,
    /// Items in the order of leaves.
    pub items: Vec<u32>,
    /// Nodes on the longest way from the root to a node, both counted.
    pub n_levels: u32,
    /// Corners of each item, if items are triangles.
    pub corners: Vec<[[f32; 3]; 3]>,
}

/// A node without children: no ray goes on from it.
pub(crate) fn empty_node() -> [u32; NODE_WORDS] {
    Quantised::new(&Node::empty(), 0.0).words()
}

impl Packed {
    /// Packs a tree whose leaves hold at most four items; boxes are widened by `margin`.
    pub fn new<'l>(tree: &Tree, items_of: impl Fn(u32) -> &'l [u32], margin: f32) -> Packed {
        let mut items = Vec::new();
        let packed = Packed::pack(tree, margin, |leaves| {
            let (first, mut meta) = (items.len(), [NO_CHILD; WIDTH]);
            for (slot, leaf) in (0..)
                .zip(leaves)
                .filter_map(|(slot, leaf)| Some((slot, (*leaf)?)))
            {
                let own: &[u32] = items_of(leaf);
                assert!(
                    (1..=4).contains(&own.len()),
                    "a leaf of {} items",
                    own.len()
                );
                meta[slot] = ((own.len() as u8 - 1) << 5) | (items.len() - first) as u8;
                items.extend_from_slice(own);
            }
            (first as u32, meta)
        });
        Packed { items, ..packed }
    }

    /// Packs a tree whose leaves are single items. Items keep their numbers, so the items of a node
    /// must have consecutive ones.
    pub fn in_place(tree: &Tree, margin: f32) -> Packed {
        Packed::pack(tree, margin, |leaves| {
            let first = leaves.iter().flatten().copied().min().unwrap_or(0);
            let meta = leaves.map(|leaf| leaf.map_or(NO_CHILD, |leaf| (leaf - first) as u8));
            assert!(
                meta.iter()
                    .all(|meta| *meta < WIDTH as u8 || *meta == NO_CHILD),
                "leaves of a node that are no neighbours: {leaves:?}"
            );
            (first, meta)
        })
    }

    /// `place` gets the leaves in a node's slots and returns the number of the node's first item
    /// and the slots' meta bytes.
    fn pack(
        tree: &Tree,
        margin: f32,
        mut place: impl FnMut(&[Option<u32>; WIDTH]) -> (u32, [u8; WIDTH]),
    ) -> Packed {
        let mut packed = Packed::default();
        if tree.nodes.is_empty() {
            return packed;
        }
        packed.nodes.push([0; NODE_WORDS]);
        let mut todo = vec![(0, 0, 1)];
        while let Some((wide, at, depth)) = todo.pop() {
            packed.n_levels = packed.n_levels.max(depth);
            let node = &tree.nodes[wide as usize];
            let (slots, mut leaves) = (slots(node), [None; WIDTH]);
            let mut quantised = Quantised::new(node, margin);
            quantised.first_child = packed.nodes.len() as u32;
            for (slot, child) in slots.iter().enumerate() {
                let Some(child) = *child else { continue };
                quantised.set_box(slot, node, child);
                let target = node.child[child];
                if target & LEAF == 0 {
                    quantised.inner |= 1 << slot;
                    todo.push((target, packed.nodes.len(), depth + 1));
                    packed.nodes.push([0; NODE_WORDS]);
                } else {
                    leaves[slot] = Some(target & !LEAF);
                }
            }
            (quantised.first_item, quantised.meta) = place(&leaves);
            packed.nodes[at] = quantised.words();
        }
        packed
    }
}

/// Which child sits in which slot: slot `s` is for what lies towards −x if bit 2 of `s` is clear,
/// −y for bit 1, −z for bit 0, so that visiting slots by `s XOR octant` goes from near to far.
fn slots(node: &Node) -> [Option<usize>; WIDTH] {
    let n = node.n_children as usize;
    let centre = |i: usize| [0, 1, 2].map(|axis| node.bounds[axis][0][i] + node.bounds[axis][1][i]);
    let mut mean = [0.0; 3];
    for i in 0..n {
        (0..3).for_each(|axis| mean[axis] += centre(i)[axis] / n as f32);
    }
    let mut costs = [[0.0f32; WIDTH]; WIDTH];
    for (i, costs) in costs[..n].iter_mut().enumerate() {
        let centre = centre(i);
        let [x, y, z] = [0, 1, 2].map(|axis| centre[axis] - mean[axis]);
        for (slot, cost) in costs.iter_mut().enumerate() {
            let signed = |bit: usize, x: f32| if slot & bit == 0 { x } else { -x };
            *cost = signed(4, x) + signed(2, y) + signed(1, z);
        }
    }
    assign(&costs[..n])
}

/// Assigns slots to children greedily, cheapest pair first. Ties and NaN costs go to the first
/// child and the first slot.
fn assign(costs: &[[f32; WIDTH]]) -> [Option<usize>; WIDTH] {
    let mut slots = [None; WIDTH];
    // The cheapest free slot for a child.
    let cheapest = |slots: &[Option<usize>; WIDTH], costs: &[f32; WIDTH]| {
        let free = (0..WIDTH)
            .filter(|slot| slots[*slot].is_none())
            .map(|slot| (slot, costs[slot]));
        free.reduce(|best, other| {
            if other.1 < best.1 || best.1.is_nan() {
                other
            } else {
                best
            }
        })
    };
    let mut wishes = [None; WIDTH];
    for (wish, costs) in wishes.iter_mut().zip(costs) {
        *wish = cheapest(&slots, costs);
    }
    for _ in costs {
        let open = wishes
            .iter()
            .enumerate()
            .filter_map(|(child, wish)| Some((child, (*wish)?)));
        let first = open.reduce(|best, other| {
            if other.1.1 < best.1.1 || best.1.1.is_nan() {
                other
            } else {
                best
            }
        });
        let (child, (slot, _)) = first.expect("there are as many slots as children");
        (slots[slot], wishes[child]) = (Some(child), None);
        for (wish, costs) in wishes
            .iter_mut()
            .zip(costs)
            .filter(|(wish, _)| wish.is_some_and(|(wished, _)| wished == slot))
        {
            *wish = cheapest(&slots, costs);
        }
    }
    slots
}

/// A node while it is packed.
struct Quantised {
    origin: [f32; 3],
    /// Biased exponent of the quantisation step, per axis.
    exponent: [u32; 3],
    margin: f32,
    inner: u32,
    first_child: u32,
    first_item: u32,
    meta: [u8; WIDTH],
    /// `sides[0][axis]` are the lower sides of the boxes, `sides[1][axis]` the upper ones.
    sides: [[[u8; WIDTH]; 3]; 2],
}

impl Quantised {
    fn new(node: &Node, margin: f32) -> Self {
        let n = node.n_children as usize;
        let mut quantised = Quantised {
            origin: [0.0; 3],
            exponent: [1; 3],
            margin,
            inner: 0,
            first_child: 0,
            first_item: 0,
            meta: [NO_CHILD; WIDTH],
            sides: [[[255; WIDTH]; 3], [[0; WIDTH]; 3]],
        };
        for axis in 0..3 {
            let low = node.bounds[axis][0][..n]
                .iter()
                .fold(f32::INFINITY, |a, b| a.min(*b))
                - margin;
            let high = node.bounds[axis][1][..n]
                .iter()
                .fold(f32::NEG_INFINITY, |a, b| a.max(*b))
                + margin;
            quantised.origin[axis] = low;
            // The smallest power of two of which 254 steps span the node; the 255th is kept for
            // rounding.
            let unit = ((high - low) / 254.0).max(f32::MIN_POSITIVE);
            quantised.exponent[axis] = ((unit.to_bits() >> 23) + 1).min(254);
        }
        quantised
    }

    fn set_box(&mut self, slot: usize, node: &Node, child: usize) {
        for axis in 0..3 {
            let unit = f32::from_bits(self.exponent[axis] << 23);
            let at = |x: f32| (x - self.origin[axis]) / unit;
            self.sides[0][axis][slot] = at(node.bounds[axis][0][child] - self.margin)
                .floor()
                .clamp(0.0, 255.0) as u8;
            self.sides[1][axis][slot] = at(node.bounds[axis][1][child] + self.margin)
                .ceil()
                .clamp(0.0, 255.0) as u8;
        }
    }

    fn words(&self) -> [u32; NODE_WORDS] {
        let mut words = [0; NODE_WORDS];
        for axis in 0..3 {
            words[axis] = self.origin[axis].to_bits();
            words[3] |= self.exponent[axis] << (8 * axis);
        }
        words[3] |= self.inner << 24;
        (words[4], words[5]) = (self.first_child, self.first_item);
        let sides = self.sides.iter().flatten();
        for (i, bytes) in [&self.meta].into_iter().chain(sides).enumerate() {
            for half in 0..2 {
                let four = [0, 1, 2, 3].map(|k| bytes[4 * half + k]);
                words[6 + 2 * i + half] = u32::from_le_bytes(four);
            }
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_child_has_a_slot_of_its_own_even_if_boxes_are_no_numbers() {
        let mut rng = fastrand::Rng::with_seed(4);
        for round in 0..200 {
            let mut node = Node::empty();
            node.n_children = 1 + round % WIDTH as u32;
            for i in 0..node.n_children as usize {
                let mut side = || {
                    [rng.f32(), f32::INFINITY, f32::NEG_INFINITY, f32::NAN]
                        [if round < 100 { 0 } else { rng.usize(0..4) }]
                };
                node.set(i, ([side(), side(), side()], [side(), side(), side()]), 0);
            }
            let mut placed: Vec<usize> = slots(&node).into_iter().flatten().collect();
            placed.sort_unstable();
            assert!(
                placed.iter().copied().eq(0..node.n_children as usize),
                "{placed:?}"
            );
        }
    }
}
