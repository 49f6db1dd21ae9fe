//! Nodes as the GPU walks them: 80 bytes each, children's boxes in eighths of a byte per side, children in the order of octants.
//!
//! Source: Ylitie, Karras and Laine, *Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs* (HPG 2017).

use crate::tree::{LEAF, Node, Tree, WIDTH};

/// 32-bit words of a node: origin (3), exponents and inner slots, first child, first item, meta (2), then lower and upper sides:
/// x, y, z lower, x, y, z upper (2 each).
pub(crate) const NODE_WORDS: usize = 20;

/// Word of a node that numbers its first child.
pub(crate) const FIRST_CHILD: usize = 4;

/// Meta byte of a slot without a child.
const NO_CHILD: u8 = 0xff;

/// A packed hierarchy; the root is node 0.
#[derive(Clone, Debug, Default)]
pub(crate) struct Packed {
    pub nodes: Vec<[u32; NODE_WORDS]>,
    /// Items in the order of leaves.
    pub items: Vec<u32>,
    /// Nodes from the root to the farthest one, both counted.
    pub n_levels: u32,
    /// Corners of each item, if items are triangles.
    pub corners: Vec<[[f32; 3]; 3]>,
}

/// A node that nothing enters.
pub(crate) fn empty_node() -> [u32; NODE_WORDS] {
    Quantised::new(&Node::empty(), 0.0).words()
}

impl Packed {
    /// Packs a tree whose leaves hold at most four items; boxes are widened by `margin`.
    pub fn new<'l>(tree: &Tree, items_of: impl Fn(u32) -> &'l [u32], margin: f32) -> Packed {
        let mut packed = Packed::default();
        if tree.nodes.is_empty() {
            return packed;
        }
        packed.nodes.push([0; NODE_WORDS]);
        let mut todo = vec![(0, 0, 1)];
        while let Some((wide, at, depth)) = todo.pop() {
            packed.n_levels = packed.n_levels.max(depth);
            let node = &tree.nodes[wide as usize];
            let slots = slots(node);
            let mut quantised = Quantised::new(node, margin);
            (quantised.first_child, quantised.first_item) = (packed.nodes.len() as u32, packed.items.len() as u32);
            for (slot, child) in slots.iter().enumerate() {
                let Some(child) = *child else { continue };
                quantised.set_box(slot, node, child);
                let target = node.child[child];
                if target & LEAF == 0 {
                    quantised.inner |= 1 << slot;
                    todo.push((target, packed.nodes.len(), depth + 1));
                    packed.nodes.push([0; NODE_WORDS]);
                } else {
                    let items = items_of(target & !LEAF);
                    assert!((1..=4).contains(&items.len()), "a leaf of {} items", items.len());
                    let offset = packed.items.len() as u32 - quantised.first_item;
                    quantised.meta[slot] = ((items.len() as u8 - 1) << 5) | offset as u8;
                    packed.items.extend_from_slice(items);
                }
            }
            packed.nodes[at] = quantised.words();
        }
        packed
    }
}

/// Which child sits in which slot: slot `s` is for what lies towards −x if bit 2 of `s` is clear, −y for bit 1, −z for bit 0, so that
/// visiting slots by `s XOR octant` goes from near to far.
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
        for (slot, cost) in costs.iter_mut().enumerate() {
            let sign = |axis: usize| if slot >> (2 - axis) & 1 == 0 { 1.0 } else { -1.0 };
            *cost = (0..3).map(|axis| sign(axis) * (centre[axis] - mean[axis])).sum();
        }
    }
    let (mut slots, mut is_placed) = ([None; WIDTH], [false; WIDTH]);
    for _ in 0..n {
        let (mut best, mut least) = ((0, 0), f32::INFINITY);
        for (child, costs) in costs[..n].iter().enumerate().filter(|(child, _)| !is_placed[*child]) {
            for (slot, cost) in costs.iter().enumerate().filter(|(slot, _)| slots[*slot].is_none()) {
                if *cost < least {
                    (best, least) = ((child, slot), *cost);
                }
            }
        }
        let (child, slot) = best;
        (slots[slot], is_placed[child]) = (Some(child), true);
    }
    slots
}

/// A node on the way.
struct Quantised {
    origin: [f32; 3],
    /// Biased exponents of the sides' unit.
    exponent: [u32; 3],
    margin: f32,
    inner: u32,
    first_child: u32,
    first_item: u32,
    meta: [u8; WIDTH],
    /// `sides[0][axis]` are lower ones.
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
            let low = node.bounds[axis][0][..n].iter().fold(f32::INFINITY, |a, b| a.min(*b)) - margin;
            let high = node.bounds[axis][1][..n].iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b)) + margin;
            quantised.origin[axis] = low;
            // Smallest power of two of which 254 span the node: one is left for rounding.
            let unit = ((high - low) / 254.0).max(f32::MIN_POSITIVE);
            quantised.exponent[axis] = ((unit.to_bits() >> 23) + 1).min(254);
        }
        quantised
    }

    fn set_box(&mut self, slot: usize, node: &Node, child: usize) {
        for axis in 0..3 {
            let unit = f32::from_bits(self.exponent[axis] << 23);
            let at = |x: f32| (x - self.origin[axis]) / unit;
            self.sides[0][axis][slot] = at(node.bounds[axis][0][child] - self.margin).floor().clamp(0.0, 255.0) as u8;
            self.sides[1][axis][slot] = at(node.bounds[axis][1][child] + self.margin).ceil().clamp(0.0, 255.0) as u8;
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
