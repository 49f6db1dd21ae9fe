//! The scene in the GPU's memory: triangles and hierarchies of scenery and meshes, uploaded once, and the instances of the tick.

use nalgebra::{Isometry3, Point3};
use sensor_gpu::Gpu;

use super::STACK_ENTRIES;
use super::frame::{rows_of, shift_from};
use super::pack::{FIRST_CHILD, NODE_WORDS, Packed, empty_node};
use crate::scene::{RayScene, box_about};
use crate::tree::{BoxTree, TriangleTree};

/// Where a hierarchy begins.
#[derive(Clone, Copy)]
struct Place {
    root: u32,
    first_triangle: u32,
}

/// Nodes at the front of the buffer that are kept for the instances of the tick.
const UPPER_NODES: usize = 1024;

/// An instance as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct InstanceWords {
    rows: [[f32; 4]; 6],
    what: [u32; 4],
}

/// Buffers of the world.
pub(super) struct World {
    pub nodes: wgpu::Buffer,
    pub triangles: wgpu::Buffer,
    pub instances: wgpu::Buffer,
    tiles: Vec<Option<Place>>,
    meshes: Vec<Option<Place>>,
    /// Episode and number of hierarchies that were uploaded.
    loaded: Option<(u32, usize)>,
    upper_nodes: usize,
}

const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);

impl World {
    pub fn new(gpu: &Gpu) -> Self {
        let empty = |label| gpu.buffer(label, 256, USAGE);
        World {
            nodes: empty("ray nodes"),
            triangles: empty("ray triangles"),
            instances: empty("ray instances"),
            tiles: Vec::new(),
            meshes: Vec::new(),
            loaded: None,
            upper_nodes: UPPER_NODES,
        }
    }

    /// Uploads what is new and says whether buffers are others than before; `None` if a hierarchy is too deep.
    pub fn update(&mut self, gpu: &Gpu, scene: &RayScene) -> Option<bool> {
        let (instances, upper) = upper_level(scene);
        if n_levels(scene) + 2 * upper.n_levels > STACK_ENTRIES {
            return None;
        }
        let n_trees = scene.mesh_trees.iter().flatten().count();
        let mut is_new = false;
        if self.loaded != Some((scene.episode(), n_trees)) || upper.nodes.len() > self.upper_nodes {
            self.upper_nodes = self.upper_nodes.max(upper.nodes.len().next_power_of_two());
            self.load(gpu, scene);
            self.loaded = Some((scene.episode(), n_trees));
            is_new = true;
        }
        let words: Vec<InstanceWords> = upper
            .items
            .iter()
            .filter_map(|item| {
                let Instance { pose, source, object } = &instances[*item as usize];
                let place = match source {
                    Source::Tile(i) => self.tiles[*i],
                    Source::Mesh(i) => self.meshes[*i],
                };
                place.map(|place| InstanceWords { rows: rows_of(pose), what: [place.root, place.first_triangle, *object, 0] })
            })
            .collect();
        assert_eq!(words.len(), upper.items.len(), "what has bounds has a hierarchy");
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        if (bytes.len() as u64) > self.instances.size() {
            self.instances = gpu.buffer("ray instances", (bytes.len() as u64).next_power_of_two(), USAGE);
            is_new = true;
        }
        // A root without children stops every ray of an empty world.
        let nodes = if upper.nodes.is_empty() { vec![empty_node()] } else { upper.nodes };
        gpu.queue().write_buffer(&self.nodes, 0, bytemuck::cast_slice(&nodes));
        gpu.queue().write_buffer(&self.instances, 0, bytes);
        Some(is_new)
    }

    fn load(&mut self, gpu: &Gpu, scene: &RayScene) {
        let mut nodes = vec![[0; NODE_WORDS]; self.upper_nodes];
        let mut triangles: Vec<[u32; 4]> = Vec::new();
        self.tiles.clear();
        for tile in &scene.tiles {
            let labels = |number: u32| {
                let (instance, triangle) = tile.sources[number as usize];
                let placed = &scene.statics[instance as usize];
                let (own, class) = scene.labels(placed.mesh_idx, triangle);
                (if own == 0 { placed.object.0 } else { own }, class)
            };
            self.tiles.push(append(&tile.tree, labels, &mut nodes, &mut triangles));
        }
        self.meshes.clear();
        for (mesh_idx, tree) in scene.mesh_trees.iter().enumerate() {
            let labels = |triangle: u32| scene.labels(mesh_idx as u32, triangle);
            self.meshes.push(tree.as_ref().and_then(|tree| append(tree, labels, &mut nodes, &mut triangles)));
        }
        if triangles.is_empty() {
            triangles.push([0; 4]);
        }
        self.nodes = gpu.buffer_with("ray nodes", bytemuck::cast_slice(&nodes), USAGE);
        self.triangles = gpu.buffer_with("ray triangles", bytemuck::cast_slice(&triangles), USAGE);
    }
}

/// Levels of the deepest hierarchy of scenery or a mesh.
fn n_levels(scene: &RayScene) -> u32 {
    let trees = scene.tiles.iter().map(|tile| &tile.tree).chain(scene.mesh_trees.iter().flatten());
    trees.filter_map(|tree| tree.packed.as_ref()).map(|packed| packed.n_levels).max().unwrap_or(0)
}

/// Where an instance's triangles are.
enum Source {
    Tile(usize),
    Mesh(usize),
}

struct Instance {
    /// From the world to its space.
    pose: Isometry3<f64>,
    source: Source,
    /// Object of triangles without one of their own.
    object: u32,
}

/// Scenery and moving instances, and the hierarchy over their boxes in the world.
fn upper_level(scene: &RayScene) -> (Vec<Instance>, Packed) {
    let (mut instances, mut boxes) = (Vec::new(), Vec::new());
    for (i, tile) in scene.tiles.iter().enumerate() {
        let Some(bounds) = tile.tree.bounds() else { continue };
        let pose = shift_from(&tile.origin_m);
        boxes.push(box_about(&Point3::origin(), &pose.inverse(), bounds));
        instances.push(Instance { pose, source: Source::Tile(i), object: 0 });
    }
    for placed in &scene.dynamics {
        let tree = scene.mesh_trees[placed.mesh_idx as usize].as_ref();
        let Some(bounds) = tree.and_then(TriangleTree::bounds) else { continue };
        boxes.push(box_about(&Point3::origin(), &placed.mesh_from_world.inverse(), bounds));
        let source = Source::Mesh(placed.mesh_idx as usize);
        instances.push(Instance { pose: placed.mesh_from_world, source, object: placed.object.0 });
    }
    (instances, BoxTree::packed(&boxes))
}

/// Appends a hierarchy and its triangles: three corners each, with object and class beside the first two.
fn append(
    tree: &TriangleTree,
    labels: impl Fn(u32) -> (u32, u8),
    nodes: &mut Vec<[u32; NODE_WORDS]>,
    triangles: &mut Vec<[u32; 4]>,
) -> Option<Place> {
    let packed = tree.packed.as_ref().filter(|packed| !packed.nodes.is_empty())?;
    let place = Place { root: nodes.len() as u32, first_triangle: triangles.len() as u32 / 3 };
    nodes.extend(packed.nodes.iter().map(|node| {
        let mut node = *node;
        node[FIRST_CHILD] += place.root;
        node
    }));
    for (number, corners) in packed.items.iter().zip(&packed.corners) {
        let (object, class) = labels(*number);
        for ([x, y, z], beside) in corners.iter().zip([object, class as u32, 0]) {
            triangles.push([x.to_bits(), y.to_bits(), z.to_bits(), beside]);
        }
    }
    Some(place)
}
