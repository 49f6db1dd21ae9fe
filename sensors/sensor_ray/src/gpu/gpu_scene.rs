//! The scene in the GPU's memory: triangles and hierarchies of scenery and meshes, which are
//! uploaded once, and the instances of the tick.

use nalgebra::{Isometry3, Point3};
use sensor_gpu::Gpu;

use super::pairs::{pair, rows_of, shift_from};
use super::shader::STACK_ENTRIES;
use crate::bvh::{
    Bounds, FIRST_CHILD, MARGIN, NODE_WORDS, Packed, TriangleTree, empty_node, moving_tree,
};
use crate::ray_scene::{CHUNK, Labels, Leg, NO_LEG, RayScene, box_about};

/// The part of a scene that a GPU cannot hold.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TooLarge {
    /// A ray would need more of the shader's stack than there is.
    #[error(
        "a hierarchy of boxes takes {n_levels} entries of the shader's stack, which has {STACK_ENTRIES}"
    )]
    Stack {
        /// Entries that a ray needs.
        n_levels: u32,
    },
    /// A buffer would be larger than shaders can reach.
    #[error("{what} take {n_bytes} bytes, and shaders of {gpu:?} reach {most} at once")]
    Buffer {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the buffer.
        n_bytes: u64,
        /// Name of the GPU.
        gpu: String,
        /// Greatest size that the GPU allows.
        most: u64,
    },
}

/// Where a hierarchy begins in the buffers.
#[derive(Clone, Copy)]
struct Place {
    root: u32,
    first_triangle: u32,
}

/// Nodes at the front of the buffer that are reserved for the hierarchy over instances.
const UPPER_NODES: usize = 1024;

/// An instance as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct InstanceWords {
    rows: [[f32; 4]; 6],
    root: u32,
    first_triangle: u32,
    object: u32,
    /// Where its legs begin in the buffer, behind all instances; 0 if it stands still.
    first_leg: u32,
}

impl InstanceWords {
    /// A leg in the place of an instance: the later place of the mesh's origin, the way to the
    /// earlier one and the later rotation, high parts in the first three rows and low parts in the
    /// others; and the half turn.
    fn of_leg(leg: &Leg) -> Self {
        let turn = leg.later.coords;
        let numbers = [
            [leg.later_m.x, leg.later_m.y, leg.later_m.z, leg.half_turn.x],
            [leg.step_m.x, leg.step_m.y, leg.step_m.z, leg.half_turn.y],
            [turn.x, turn.y, turn.z, turn.w],
        ];
        let mut rows = [[0.0; 4]; 6];
        for (i, row) in numbers.iter().enumerate() {
            for (j, x) in row.iter().enumerate() {
                [rows[i][j], rows[i + 3][j]] = pair(*x);
            }
        }
        let [high, low] = pair(leg.half_turn.z);
        InstanceWords {
            rows,
            root: high.to_bits(),
            first_triangle: low.to_bits(),
            object: 0,
            first_leg: 0,
        }
    }
}

/// Buffers of the scene, and what they hold.
pub(super) struct GpuScene {
    pub nodes: wgpu::Buffer,
    pub triangles: wgpu::Buffer,
    pub instances: wgpu::Buffer,
    tiles: Vec<Option<Place>>,
    meshes: Vec<Option<Place>>,
    /// Serial number of the scene whose hierarchies were uploaded, and the number of its mesh
    /// hierarchies.
    loaded: Option<(u64, usize)>,
    /// The same for hierarchies that the GPU cannot hold, and the reason.
    refused: Option<((u64, usize), TooLarge)>,
    /// Revision of hidden triangles that was uploaded.
    revision: u64,
    upper_nodes: usize,
    /// Levels of the deepest hierarchy of scenery or a mesh.
    n_levels: u32,
    /// What moves, as it was last uploaded.
    uploaded: Uploaded,
    /// Ages of the ticks that motion leads through, nanoseconds, and the root of the hierarchy over
    /// all places on the way.
    motion: (Vec<u64>, u32),
}

/// What moves, as it was last uploaded.
#[derive(Default)]
struct Uploaded {
    poses: Vec<Isometry3<f64>>,
    instances: Vec<InstanceWords>,
    nodes: Vec<[u32; NODE_WORDS]>,
}

const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);
/// Bytes of a triangle.
const TRIANGLE_BYTES: usize = 48;

impl GpuScene {
    pub fn new(gpu: &Gpu) -> Self {
        let empty = |label| gpu.buffer(label, 256, USAGE);
        GpuScene {
            nodes: empty("ray nodes"),
            triangles: empty("ray triangles"),
            instances: empty("ray instances"),
            tiles: Vec::new(),
            meshes: Vec::new(),
            loaded: None,
            refused: None,
            revision: 0,
            upper_nodes: UPPER_NODES,
            n_levels: 0,
            uploaded: Uploaded::default(),
            motion: Default::default(),
        }
    }

    /// Ages of the ticks that motion leads through, nanoseconds, and the root of the hierarchy over all
    /// places on the way.
    pub fn motion(&self) -> (&[u64], u32) {
        (&self.motion.0, self.motion.1)
    }

    /// Uploads what changed; true if a buffer was replaced.
    ///
    /// # Errors
    /// If the GPU cannot hold the scene; buffers may have been replaced then.
    pub fn update(&mut self, gpu: &Gpu, scene: &RayScene) -> Result<bool, TooLarge> {
        let key = (scene.serial, scene.mesh_trees.iter().flatten().count());
        if let Some((_, why)) = self.refused.as_ref().filter(|(refused, _)| *refused == key) {
            return Err(why.clone());
        }
        let mut upper = upper_level(scene);
        self.motion = (scene.motion.ages_nanos.clone(), upper.swept_root);
        let mut is_new = false;
        if self.loaded != Some(key) || upper.nodes.len() > self.upper_nodes {
            self.loaded = None;
            self.upper_nodes = self.upper_nodes.max(upper.nodes.len().next_power_of_two());
            self.load(gpu, scene)
                .inspect_err(|why| self.refused = Some((key, why.clone())))?;
            self.loaded = Some(key);
            is_new = true;
        } else if scene.hiding.revision != self.revision {
            self.change_triangles(gpu, scene);
        }
        self.revision = scene.hiding.revision;
        let n_levels = self.n_levels + 2 * upper.n_levels;
        if n_levels > STACK_ENTRIES {
            return Err(TooLarge::Stack { n_levels });
        }
        // In an empty scene, a root without children stops every ray.
        if upper.nodes.is_empty() {
            upper.nodes.push(empty_node());
        }
        if upper.nodes != self.uploaded.nodes {
            gpu.queue()
                .write_buffer(&self.nodes, 0, bytemuck::cast_slice(&upper.nodes));
            self.uploaded.nodes = upper.nodes;
        }
        Ok(self.update_instances(gpu, scene)? || is_new)
    }

    /// Uploads the instances from the first to the last one that changed; true if their buffer was
    /// replaced.
    fn update_instances(&mut self, gpu: &Gpu, scene: &RayScene) -> Result<bool, TooLarge> {
        let tiles = scene
            .scenery
            .tiles
            .iter()
            .zip(&self.tiles)
            .filter_map(|(tile, place)| Some(((*place)?, shift_from(&tile.origin_m), 0, NO_LEG)));
        let place_of = |mesh_idx: u32| {
            self.meshes[mesh_idx as usize].expect("what has bounds has a hierarchy")
        };
        let moving = scene.dynamics.iter().map(|placed| {
            (
                place_of(placed.mesh_idx),
                placed.mesh_from_world,
                placed.object.0,
                placed.first_leg,
            )
        });
        let n_placed = self.tiles.iter().flatten().count() + scene.dynamics.len();
        let n_records = n_placed + scene.motion.legs.len();
        let n_bytes = (n_records * size_of::<InstanceWords>()) as u64;
        let is_new = n_bytes > self.instances.size();
        // Checked before anything is noted as uploaded.
        if is_new {
            check_size(gpu, "moving things", n_bytes.next_power_of_two())?;
        }
        let Uploaded {
            poses, instances, ..
        } = &mut self.uploaded;
        let (mut n, mut changed) = (0, None);
        for (place, pose, object, leg) in tiles.chain(moving) {
            let first_leg = match leg {
                NO_LEG => 0,
                leg => n_placed as u32 + leg,
            };
            let is_same = |known: &InstanceWords| {
                (known.root, known.first_triangle) == (place.root, place.first_triangle)
                    && (known.object, known.first_leg) == (object, first_leg)
            };
            if !instances.get(n).is_some_and(is_same) || poses[n] != pose {
                let words = InstanceWords {
                    rows: rows_of(&pose),
                    root: place.root,
                    first_triangle: place.first_triangle,
                    object,
                    first_leg,
                };
                if n == instances.len() {
                    instances.push(words);
                    poses.push(pose);
                } else {
                    (instances[n], poses[n]) = (words, pose);
                }
                changed = Some((changed.map_or(n, |(first, _)| first), n + 1));
            }
            n += 1;
        }
        instances.truncate(n);
        poses.truncate(n);
        if is_new {
            self.instances = gpu.buffer("ray instances", n_bytes.next_power_of_two(), USAGE);
            changed = Some((0, n));
        }
        if let Some((first, end)) = changed {
            let begin = (first * size_of::<InstanceWords>()) as u64;
            gpu.queue().write_buffer(
                &self.instances,
                begin,
                bytemuck::cast_slice(&instances[first..end]),
            );
        }
        let legs: Vec<_> = scene
            .motion
            .legs
            .iter()
            .map(InstanceWords::of_leg)
            .collect();
        if !legs.is_empty() {
            let begin = (n_placed * size_of::<InstanceWords>()) as u64;
            gpu.queue()
                .write_buffer(&self.instances, begin, bytemuck::cast_slice(&legs));
        }
        Ok(is_new)
    }

    /// Uploads all hierarchies.
    fn load(&mut self, gpu: &Gpu, scene: &RayScene) -> Result<(), TooLarge> {
        let mut nodes = vec![[0; NODE_WORDS]; self.upper_nodes];
        let mut triangles: Vec<[u32; 4]> = Vec::new();
        self.tiles.clear();
        for tile_idx in 0..scene.scenery.tiles.len() {
            let tile = &scene.scenery.tiles[tile_idx];
            let labels = |number: u32| scene.scenery.labels(tile, number);
            self.tiles
                .push(append(&tile.tree, labels, &mut nodes, &mut triangles));
        }
        self.meshes.clear();
        for (mesh_idx, tree) in scene.mesh_trees.iter().enumerate() {
            let mesh = &scene.scenery.meshes[mesh_idx];
            let labels = |triangle: u32| Labels::of(mesh, triangle);
            self.meshes.push(
                tree.as_ref()
                    .and_then(|tree| append(tree, labels, &mut nodes, &mut triangles)),
            );
        }
        if triangles.is_empty() {
            triangles.push([0; 4]);
        }
        check_size(gpu, "hierarchies", size_of_val(&nodes[..]) as u64)?;
        check_size(gpu, "triangles", size_of_val(&triangles[..]) as u64)?;
        self.nodes = gpu.buffer_with("ray nodes", bytemuck::cast_slice(&nodes), USAGE);
        self.triangles = gpu.buffer_with("ray triangles", bytemuck::cast_slice(&triangles), USAGE);
        self.uploaded = Uploaded::default();
        self.n_levels = n_levels(scene);
        Ok(())
    }

    /// Uploads the chunks of scenery in which something was hidden or shown, consecutive chunks in
    /// one piece.
    fn change_triangles(&mut self, gpu: &Gpu, scene: &RayScene) {
        for (tile_idx, revisions) in scene.hiding.chunks.iter().enumerate() {
            let tile = &scene.scenery.tiles[tile_idx];
            let (Some(place), Some(packed)) = (self.tiles[tile_idx], &tile.tree.packed) else {
                continue;
            };
            let is_changed = |chunk: &usize| revisions[*chunk] > self.revision;
            let mut chunk = 0;
            while let Some(first) = (chunk..revisions.len()).find(is_changed) {
                chunk = (first..revisions.len())
                    .find(|chunk| !is_changed(chunk))
                    .unwrap_or(revisions.len());
                let items = first * CHUNK..packed.corners.len().min(chunk * CHUNK);
                let mut words = Vec::with_capacity(3 * items.len());
                for (number, corners) in packed.items[items.clone()]
                    .iter()
                    .zip(&packed.corners[items.clone()])
                {
                    push_triangle(&mut words, corners, scene.scenery.labels(tile, *number));
                }
                let begin = (place.first_triangle as usize + items.start) * TRIANGLE_BYTES;
                gpu.queue().write_buffer(
                    &self.triangles,
                    begin as u64,
                    bytemuck::cast_slice(&words),
                );
            }
        }
    }
}

/// Checks that a shader can reach `n_bytes` of one buffer.
fn check_size(gpu: &Gpu, what: &'static str, n_bytes: u64) -> Result<(), TooLarge> {
    let limits = gpu.device().limits();
    let most = limits
        .max_buffer_size
        .min(limits.max_storage_buffer_binding_size);
    if n_bytes > most {
        Err(TooLarge::Buffer {
            what,
            n_bytes,
            gpu: gpu.name().to_owned(),
            most,
        })
    } else {
        Ok(())
    }
}

/// Levels of the deepest hierarchy of scenery or a mesh.
fn n_levels(scene: &RayScene) -> u32 {
    let trees = scene
        .scenery
        .tiles
        .iter()
        .map(|tile| &tile.tree)
        .chain(scene.mesh_trees.iter().flatten());
    trees
        .filter_map(|tree| tree.packed.as_ref())
        .map(|packed| packed.n_levels)
        .max()
        .unwrap_or(0)
}

/// The hierarchies over the tiles of scenery and the moving instances, in world space: as they are
/// at the tick, and behind it, if anything moved, over all places on the way.
struct Upper {
    nodes: Vec<[u32; NODE_WORDS]>,
    n_levels: u32,
    swept_root: u32,
}

fn upper_level(scene: &RayScene) -> Upper {
    let (mut boxes, mut ends) = (
        Vec::<Bounds>::with_capacity(scene.scenery.tiles.len() + scene.dynamics.len()),
        Vec::new(),
    );
    for tile in &scene.scenery.tiles {
        let Some(bounds) = tile.tree.bounds() else {
            continue;
        };
        boxes.push(box_about(
            &Point3::origin(),
            &shift_from(&tile.origin_m).inverse(),
            bounds,
        ));
        ends.push(boxes.len() as u32);
    }
    let first = boxes.len() as u32;
    boxes.extend(
        scene
            .dynamics
            .iter()
            .map(|placed| scene.bounds_of(placed, &Point3::origin())),
    );
    ends.extend(scene.actor_ends.iter().map(|end| first + end));
    let packed = |boxes: &[Bounds]| {
        let tree = moving_tree(boxes, &ends);
        Packed::in_place(&tree, MARGIN * tree.reach)
    };
    let Packed {
        mut nodes,
        mut n_levels,
        ..
    } = packed(&boxes);
    let swept_root = nodes.len() as u32;
    if !scene.motion.legs.is_empty() {
        let swept = scene.swept_boxes(&boxes[first as usize..], &Point3::origin());
        boxes.splice(first as usize.., swept);
        let swept = packed(&boxes);
        n_levels = n_levels.max(swept.n_levels);
        nodes.extend(swept.nodes.iter().map(|node| below(node, swept_root)));
    }
    Upper {
        nodes,
        n_levels,
        swept_root,
    }
}

/// A node whose children are numbered from `root` on.
fn below(node: &[u32; NODE_WORDS], root: u32) -> [u32; NODE_WORDS] {
    let mut node = *node;
    node[FIRST_CHILD] += root;
    node
}

/// Appends a hierarchy and its triangles: three corners each, with object and class beside the
/// first two.
fn append(
    tree: &TriangleTree,
    labels: impl Fn(u32) -> Labels,
    nodes: &mut Vec<[u32; NODE_WORDS]>,
    triangles: &mut Vec<[u32; 4]>,
) -> Option<Place> {
    let packed = tree
        .packed
        .as_ref()
        .filter(|packed| !packed.nodes.is_empty())?;
    let place = Place {
        root: nodes.len() as u32,
        first_triangle: triangles.len() as u32 / 3,
    };
    nodes.extend(packed.nodes.iter().map(|node| below(node, place.root)));
    for (number, corners) in packed.items.iter().zip(&packed.corners) {
        push_triangle(triangles, corners, labels(*number));
    }
    Some(place)
}

fn push_triangle(triangles: &mut Vec<[u32; 4]>, corners: &[[f32; 3]; 3], labels: Labels) {
    for ([x, y, z], beside) in corners
        .iter()
        .zip([labels.object.0, labels.class.0 as u32, 0])
    {
        triangles.push([x.to_bits(), y.to_bits(), z.to_bits(), beside]);
    }
}
