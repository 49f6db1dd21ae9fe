//! Hierarchies of boxes with eight children per node, folded from the binary ones that obvhs
//! builds.

use obvhs::bvh2::Bvh2;

/// Children of a node, and triangles of a block.
pub(crate) const WIDTH: usize = 8;

/// Bit of a child that is a leaf; the rest is the number of its block or item.
pub(crate) const LEAF: u32 = 1 << 31;

/// Boxes of up to eight children, an axis at a time.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// `bounds[axis][0]` are the lower sides, `bounds[axis][1]` the upper ones.
    pub bounds: [[[f32; WIDTH]; 2]; 3],
    /// A node, or [`LEAF`] and a block or item.
    pub child: [u32; WIDTH],
    pub n_children: u32,
}

impl Node {
    pub fn empty() -> Self {
        Node {
            bounds: [[[0.0; WIDTH]; 2]; 3],
            child: [0; WIDTH],
            n_children: 0,
        }
    }

    /// Makes child number `i` a box, and the node or leaf behind it.
    pub fn set(&mut self, i: usize, (low, high): ([f32; 3], [f32; 3]), child: u32) {
        for axis in 0..3 {
            (self.bounds[axis][0][i], self.bounds[axis][1][i]) = (low[axis], high[axis]);
        }
        self.child[i] = child;
    }

    pub fn low(&self, i: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.bounds[axis][0][i])
    }

    pub fn high(&self, i: usize) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.bounds[axis][1][i])
    }
}

/// A hierarchy of boxes; what its leaves hold is kept elsewhere. The root is node 0; a tree without
/// nodes is empty.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    pub nodes: Vec<Node>,
    pub bounds: Option<([f32; 3], [f32; 3])>,
    /// Largest absolute coordinate of the bounds: rounding errors of `f32` grow with it.
    pub reach: f32,
}

/// Folds a binary hierarchy into a wide one.
struct Folder<'b, F> {
    bvh: &'b Bvh2,
    /// Items under each binary node.
    n_items: Vec<u32>,
    /// Most items of a leaf.
    leaf_items: u32,
    /// Makes a leaf of items and returns its number.
    make_leaf: F,
    nodes: Vec<Node>,
}

impl Tree {
    /// Folds `bvh`; subtrees of at most `leaf_items` items become leaves, each made by `make_leaf`
    /// from indices of items.
    pub(crate) fn fold(bvh: &Bvh2, leaf_items: u32, make_leaf: impl FnMut(&[u32]) -> u32) -> Tree {
        let Some(root) = bvh.nodes.first() else {
            return Tree::default();
        };
        let mut folder = Folder {
            bvh,
            n_items: vec![0; bvh.nodes.len()],
            leaf_items,
            make_leaf,
            nodes: Vec::with_capacity(bvh.nodes.len() / 4 + 1),
        };
        folder.count();
        folder.fold();
        let (low, high) = (root.aabb().min.to_array(), root.aabb().max.to_array());
        let reach = low
            .iter()
            .chain(&high)
            .fold(0.0f32, |reach, x| reach.max(x.abs()));
        Tree {
            nodes: folder.nodes,
            bounds: Some((low, high)),
            reach,
        }
    }
}

impl<F: FnMut(&[u32]) -> u32> Folder<'_, F> {
    fn count(&mut self) {
        let mut order = vec![0];
        let mut next = 0;
        while next < order.len() {
            let node = &self.bvh.nodes[order[next] as usize];
            if !node.is_leaf() {
                order.extend([node.first_index, node.first_index + 1]);
            }
            next += 1;
        }
        for idx in order.into_iter().rev() {
            let node = &self.bvh.nodes[idx as usize];
            self.n_items[idx as usize] = match node.is_leaf() {
                true => node.prim_count,
                false => {
                    self.n_items[node.first_index as usize]
                        + self.n_items[node.first_index as usize + 1]
                }
            };
        }
    }

    fn is_leaf(&self, idx: u32) -> bool {
        self.n_items[idx as usize] <= self.leaf_items || self.bvh.nodes[idx as usize].is_leaf()
    }

    fn fold(&mut self) {
        self.nodes.push(Node::empty());
        let mut todo = vec![(0, 0)];
        while let Some((binary, wide)) = todo.pop() {
            let children = self.children(binary);
            for (i, child) in children.iter().enumerate() {
                let aabb = *self.bvh.nodes[*child as usize].aabb();
                let target = if self.is_leaf(*child) {
                    LEAF | self.leaf(*child)
                } else {
                    let inner = self.nodes.len() as u32;
                    self.nodes.push(Node::empty());
                    todo.push((*child, inner));
                    inner
                };
                self.nodes[wide as usize].set(
                    i,
                    (aabb.min.to_array(), aabb.max.to_array()),
                    target,
                );
            }
            self.nodes[wide as usize].n_children = children.len() as u32;
        }
    }

    /// Up to eight binary nodes under `idx`. As long as there is room, the node with the largest
    /// surface is replaced by its two children.
    fn children(&self, idx: u32) -> Vec<u32> {
        let mut children = vec![idx];
        while children.len() < WIDTH {
            let area = |i: &usize| self.bvh.nodes[children[*i] as usize].aabb().half_area();
            let opened = (0..children.len())
                .filter(|i| !self.is_leaf(children[*i]))
                .max_by(|a, b| area(a).total_cmp(&area(b)));
            let Some(opened) = opened else { break };
            let first = self.bvh.nodes[children[opened] as usize].first_index;
            children[opened] = first;
            children.push(first + 1);
        }
        children
    }

    fn leaf(&mut self, idx: u32) -> u32 {
        let (mut items, mut todo) = (Vec::new(), vec![idx]);
        while let Some(idx) = todo.pop() {
            let node = &self.bvh.nodes[idx as usize];
            if node.is_leaf() {
                let first = node.first_index as usize;
                items.extend_from_slice(
                    &self.bvh.primitive_indices[first..first + node.prim_count as usize],
                );
            } else {
                todo.extend([node.first_index + 1, node.first_index]);
            }
        }
        (self.make_leaf)(&items)
    }
}
