//! Hierarchies of boxes: built by obvhs (PLOC with reinsertion), walked here by whole packets.

use std::time::Duration;

use glam::Vec3A;
use nalgebra::Vector3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::triangle::Triangle;
use obvhs::{BvhBuildParams, bvh2::node::Bvh2Node};

use crate::ball::Ball;
use crate::packet::Packet;

/// A box with two children at `first` and `first + 1`, or, if `count > 0`, with the leaf's items `first..first + count`.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Node {
    low: [f32; 3],
    count: u32,
    high: [f32; 3],
    first: u32,
}

impl From<&Bvh2Node> for Node {
    fn from(node: &Bvh2Node) -> Self {
        let aabb = node.aabb();
        Node { low: aabb.min.to_array(), count: node.prim_count, high: aabb.max.to_array(), first: node.first_index }
    }
}

/// A hierarchy without its items.
#[derive(Debug, Default)]
struct Tree {
    nodes: Vec<Node>,
}

impl Tree {
    fn new(bvh: &Bvh2) -> Self {
        Tree { nodes: bvh.nodes.iter().map(Node::from).collect() }
    }

    /// Calls `leaf` with every range of items whose box some lane enters before its limit, nearer ones first where that is known.
    #[inline(always)]
    fn walk<const N: usize>(&self, packet: &mut Packet<N>, stack: &mut Vec<(u32, f32)>, leaf: &mut impl Leaf<N>) {
        let Some(root) = self.nodes.first() else { return };
        if packet.enter(&root.low, &root.high) == f32::INFINITY {
            return;
        }
        stack.clear();
        let mut current = *root;
        loop {
            if current.count > 0 {
                leaf.visit(packet, current.first, current.count);
            } else {
                let (a, b) = (&self.nodes[current.first as usize], &self.nodes[current.first as usize + 1]);
                let (near_a, near_b) = (packet.enter(&a.low, &a.high), packet.enter(&b.low, &b.high));
                let a_first = near_a <= near_b;
                let (near, far_idx) = if a_first { (near_a, current.first + 1) } else { (near_b, current.first) };
                let behind = if a_first { near_b } else { near_a };
                if behind < f32::INFINITY {
                    stack.push((far_idx, behind));
                }
                if near < f32::INFINITY {
                    current = if a_first { *a } else { *b };
                    continue;
                }
            }
            let limit = packet.farthest();
            loop {
                let Some((idx, near)) = stack.pop() else { return };
                if near <= limit {
                    current = self.nodes[idx as usize];
                    break;
                }
            }
        }
    }
}

/// What is done at the leaves. A trait, because closures cannot be told to be inlined.
trait Leaf<const N: usize> {
    /// Tries the items `first..first + count`.
    fn visit(&mut self, packet: &mut Packet<N>, first: u32, count: u32);
}

/// Triangles at the leaves.
struct Faces<'t> {
    faces: &'t [Face],
    place: u32,
}

impl<const N: usize> Leaf<N> for Faces<'_> {
    #[inline(always)]
    fn visit(&mut self, packet: &mut Packet<N>, first: u32, count: u32) {
        for slot in first..first + count {
            let face = &self.faces[slot as usize];
            packet.triangle(&face.corner, &face.edge1, &face.edge2, slot, self.place);
        }
    }
}

/// Boxes at the leaves.
struct Boxes<'t, F> {
    items: &'t [u32],
    item: F,
}

impl<const N: usize, F: FnMut(&mut Packet<N>, u32)> Leaf<N> for Boxes<'_, F> {
    #[inline(always)]
    fn visit(&mut self, packet: &mut Packet<N>, first: u32, count: u32) {
        for idx in &self.items[first as usize..(first + count) as usize] {
            (self.item)(packet, *idx);
        }
    }
}

/// A triangle as the packet test wants it.
#[derive(Clone, Copy, Debug)]
struct Face {
    corner: [f32; 3],
    edge1: [f32; 3],
    edge2: [f32; 3],
    /// Number in the order the triangles were given.
    number: u32,
}

/// Triangles under a hierarchy.
#[derive(Debug, Default)]
pub(crate) struct TriangleTree {
    tree: Tree,
    faces: Vec<Face>,
}

impl TriangleTree {
    /// Builds over corners; numbers in hits are indices into `corners`. Triangles that are not finite are left out.
    pub fn new(corners: &[[[f32; 3]; 3]]) -> Self {
        let finite = |c: &[[f32; 3]; 3]| c.iter().flatten().all(|x| x.is_finite());
        let numbers: Vec<u32> = (0..corners.len() as u32).filter(|i| finite(&corners[*i as usize])).collect();
        let triangles: Vec<Triangle> = numbers
            .iter()
            .map(|i| {
                let [v0, v1, v2] = corners[*i as usize].map(Vec3A::from);
                Triangle { v0, v1, v2 }
            })
            .collect();
        if triangles.is_empty() {
            return TriangleTree::default();
        }
        let bvh = build_bvh2_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let face = |i: &u32| {
            let t = &triangles[*i as usize];
            let (edge1, edge2) = (t.v1 - t.v0, t.v2 - t.v0);
            Face { corner: t.v0.to_array(), edge1: edge1.to_array(), edge2: edge2.to_array(), number: numbers[*i as usize] }
        };
        TriangleTree { tree: Tree::new(&bvh), faces: bvh.primitive_indices.iter().map(face).collect() }
    }

    /// Lower and upper corner of the box around everything; `None` without triangles.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        self.tree.nodes.first().map(|root| (root.low, root.high))
    }

    /// Nearest hits of all lanes before their limits; hits are marked with `place` and the triangle's slot.
    #[inline(always)]
    pub fn intersect<const N: usize>(&self, packet: &mut Packet<N>, place: u32, stack: &mut Vec<(u32, f32)>) {
        self.tree.walk(packet, stack, &mut Faces { faces: &self.faces, place });
    }

    /// Number of the triangle at a hit's slot, as it was given.
    #[inline(always)]
    pub fn number(&self, slot: u32) -> u32 {
        self.faces[slot as usize].number
    }

    /// Distance at which a ray meets the plane of the triangle at a slot, in `f64`; not finite along the plane.
    #[inline(always)]
    pub fn plane_distance(&self, slot: u32, origin: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
        let face = &self.faces[slot as usize];
        let [corner, edge1, edge2] = [face.corner, face.edge1, face.edge2].map(|v| Vector3::from(v.map(f64::from)));
        let normal = edge1.cross(&edge2);
        normal.dot(&(corner - origin)) / normal.dot(direction)
    }
}

impl Tree {
    /// Calls `item` for every item of the leaves that a moving ball comes near before the limit, which `item` may shorten.
    fn walk_ball(&self, ball: &Ball, limit_m: &mut f64, mut item: impl FnMut(u32, &mut f64)) {
        let mut stack = Vec::new();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
        let mut ray = Packet::<1>::empty();
        ray.aim(0, ball.centre.coords.cast::<f32>().into(), ball.direction.cast::<f32>().into());
        let radius_m = ball.radius_m as f32;
        while let Some(idx) = stack.pop() {
            let node = &self.nodes[idx as usize];
            let (low, high) = (node.low.map(|x| x - radius_m), node.high.map(|x| x + radius_m));
            // A little beyond: the exact test decides.
            ray.far[0] = (*limit_m * (1.0 + 1e-6) + 1e-3) as f32;
            if ray.enter(&low, &high) == f32::INFINITY {
                continue;
            }
            if node.count > 0 {
                (node.first..node.first + node.count).for_each(|i| item(i, limit_m));
            } else {
                stack.extend([node.first + 1, node.first]);
            }
        }
    }
}

impl TriangleTree {
    /// Calls `triangle` with the number of every triangle that a moving ball comes near, until the limit, which it may shorten.
    pub fn visit_ball(&self, ball: &Ball, limit_m: &mut f64, mut triangle: impl FnMut(u32, &mut f64)) {
        self.tree.walk_ball(ball, limit_m, |i, limit_m| triangle(self.faces[i as usize].number, limit_m));
    }
}

/// Boxes under a hierarchy: what the moving instances of a tick hang in.
#[derive(Debug, Default)]
pub(crate) struct BoxTree {
    tree: Tree,
    items: Vec<u32>,
}

impl BoxTree {
    /// Builds over (lower, upper) corners; items are indices into `boxes`.
    pub fn new(boxes: &[([f32; 3], [f32; 3])]) -> Self {
        if boxes.is_empty() {
            return BoxTree::default();
        }
        let aabbs: Vec<Aabb> = boxes.iter().map(|(low, high)| Aabb::new(Vec3A::from(*low), Vec3A::from(*high))).collect();
        let indices = (0..boxes.len() as u32).collect();
        let bvh = PlocBuilder::with_capacity(boxes.len()).build(PlocSearchDistance::Low, &aabbs, indices, SortPrecision::U64, 0);
        BoxTree { tree: Tree::new(&bvh), items: bvh.primitive_indices.clone() }
    }

    /// Calls `item` for every box that some lane enters before its limit.
    #[inline(always)]
    pub fn visit<const N: usize>(&self, packet: &mut Packet<N>, stack: &mut Vec<(u32, f32)>, item: impl FnMut(&mut Packet<N>, u32)) {
        self.tree.walk(packet, stack, &mut Boxes { items: &self.items, item });
    }
}
