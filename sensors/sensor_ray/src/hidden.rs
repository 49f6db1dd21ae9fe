//! Scenery that is hidden: its triangles become points, which nothing hits, in hierarchies that
//! stay as they are.

use std::collections::BTreeSet;
use std::ops::Range;

use schema_types::ObjectId;

use crate::scene::{RayScene, Tile, corners_in};
use crate::tree::{NO_TRIANGLE, WIDTH};

/// Triangles that are told together to the GPU when one of them changes.
pub(crate) const CHUNK: usize = 256;

/// What is hidden of a scene.
#[derive(Debug, Default)]
pub(crate) struct Hiding {
    /// Objects that were no part of the scenery when it was loaded.
    never_there: BTreeSet<ObjectId>,
    hidden: BTreeSet<ObjectId>,
    /// Made when something is hidden for the first time.
    table: Option<Table>,
    /// Count of changes.
    pub revision: u64,
    /// Change in which a chunk of a tile's packed triangles last took part, by tile.
    pub chunks: Vec<Vec<u64>>,
}

/// Where the triangles of objects are.
#[derive(Debug)]
struct Table {
    runs: Vec<Run>,
    /// By tile and triangle number: place in the hierarchy, in the one for the GPU.
    slots: Vec<Vec<u32>>,
    items: Vec<Vec<u32>>,
}

/// Neighbouring triangles of a tile that are hidden together.
#[derive(Debug)]
struct Run {
    tile: usize,
    numbers: Range<u32>,
    /// Object of the instance and of the triangles.
    objects: [ObjectId; 2],
    is_hidden: bool,
}

impl Hiding {
    pub fn new(never_there: &BTreeSet<ObjectId>) -> Self {
        Hiding {
            never_there: never_there.clone(),
            hidden: never_there.clone(),
            ..Default::default()
        }
    }

    /// Whether nothing has to be shown that is not there.
    pub fn can_hide(&self, hidden: &BTreeSet<ObjectId>) -> bool {
        self.never_there.is_subset(hidden)
    }
}

impl RayScene {
    pub(crate) fn set_hidden(&mut self, hidden: &BTreeSet<ObjectId>) {
        if *hidden == self.hiding.hidden {
            return;
        }
        let mut table = self.hiding.table.take().unwrap_or_else(|| table_of(self));
        self.hiding.revision += 1;
        self.hiding.chunks.resize_with(self.tiles.len(), Vec::new);
        for run in &mut table.runs {
            let hides = run.objects.iter().any(|object| hidden.contains(object));
            if hides != run.is_hidden {
                run.is_hidden = hides;
                run.numbers.clone().for_each(|number| {
                    self.set_triangle(run.tile, number, hides, &table.slots, &table.items)
                });
            }
        }
        self.hiding.hidden.clone_from(hidden);
        self.hiding.table = Some(table);
    }

    /// Makes a triangle a point or itself again.
    fn set_triangle(
        &mut self,
        tile_idx: usize,
        number: u32,
        is_hidden: bool,
        slots: &[Vec<u32>],
        items: &[Vec<u32>],
    ) {
        let tile = &mut self.tiles[tile_idx];
        let (instance, triangle) = tile.sources[number as usize];
        let placed = &self.statics[instance as usize];
        let mesh = &self.meshes[placed.mesh_idx as usize];
        let first = mesh.lods[0].first_idx as usize + 3 * triangle as usize;
        let in_mesh = [0, 1, 2].map(|i| mesh.vertices[mesh.indices[first + i] as usize].position_m);
        let whole = corners_in(&tile.origin_m, &placed.world_from_mesh, in_mesh);
        let corners = if is_hidden { [whole[0]; 3] } else { whole };
        let slot = slots[tile_idx][number as usize] as usize;
        if slot != NO_TRIANGLE as usize {
            let (block, lane) = (&mut tile.tree.blocks[slot / WIDTH], slot % WIDTH);
            for (of_all, corner) in block.corner.iter_mut().zip(&corners) {
                of_all
                    .iter_mut()
                    .zip(corner)
                    .for_each(|(of_all, x)| of_all[lane] = *x);
            }
            tile.tree.numbers[slot / WIDTH][lane] = if is_hidden { NO_TRIANGLE } else { number };
        }
        let item = items[tile_idx]
            .get(number as usize)
            .copied()
            .unwrap_or(NO_TRIANGLE) as usize;
        if let Some(packed) = tile
            .tree
            .packed
            .as_mut()
            .filter(|packed| item < packed.corners.len())
        {
            packed.corners[item] = corners;
            let chunks = &mut self.hiding.chunks[tile_idx];
            chunks.resize(packed.corners.len().div_ceil(CHUNK), 0);
            chunks[item / CHUNK] = self.hiding.revision;
        }
    }
}

/// Looks for everything: nothing is hidden yet.
fn table_of(scene: &RayScene) -> Table {
    let mut table = Table {
        runs: Vec::new(),
        slots: Vec::new(),
        items: Vec::new(),
    };
    for (tile_idx, tile) in scene.tiles.iter().enumerate() {
        for (number, (instance, triangle)) in (0..).zip(&tile.sources) {
            let placed = &scene.statics[*instance as usize];
            let objects = [
                placed.object,
                ObjectId(scene.labels(placed.mesh_idx, *triangle).0),
            ];
            match table.runs.last_mut() {
                Some(run) if (run.tile, run.objects) == (tile_idx, objects) => {
                    run.numbers.end = number + 1
                }
                _ => table.runs.push(Run {
                    tile: tile_idx,
                    numbers: number..number + 1,
                    objects,
                    is_hidden: false,
                }),
            }
        }
        table.slots.push(inverse(
            tile,
            (0..).zip(tile.tree.numbers.iter().flatten().copied()),
        ));
        let items = tile
            .tree
            .packed
            .iter()
            .flat_map(|packed| packed.items.iter().copied());
        table.items.push(inverse(tile, (0..).zip(items)));
    }
    table
}

/// By triangle number the place it was found at.
fn inverse(tile: &Tile, found: impl Iterator<Item = (u32, u32)>) -> Vec<u32> {
    let mut places = vec![NO_TRIANGLE; tile.sources.len()];
    found
        .filter(|(_, number)| *number != NO_TRIANGLE)
        .for_each(|(place, number)| places[number as usize] = place);
    places
}
