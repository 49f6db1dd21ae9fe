//! Hidden scenery. The hierarchies stay as they are; a hidden triangle is shrunk to a point, which
//! no ray hits.

use std::collections::BTreeSet;
use std::ops::Range;

use schema_types::ObjectId;

use super::placed::Labels;
use super::scenery::{Scenery, Tile, corners_in};
use crate::bvh::NO_TRIANGLE;

/// Triangles that are uploaded to the GPU together when one of them changes.
pub(crate) const CHUNK: usize = 256;

/// What is hidden of a scene.
#[derive(Debug, Default)]
pub(crate) struct Hiding {
    /// Objects that were left out when the scenery was loaded: the hierarchies lack their
    /// triangles.
    never_there: BTreeSet<ObjectId>,
    hidden: BTreeSet<ObjectId>,
    /// Built when something is hidden for the first time.
    table: Option<Table>,
    /// Number of changes so far.
    pub revision: u64,
    /// By tile and chunk of packed triangles: the revision in which the chunk last changed.
    pub chunks: Vec<Vec<u64>>,
}

/// Where the triangles of objects are.
#[derive(Debug)]
struct Table {
    runs: Vec<Run>,
    /// By tile.
    places: Vec<Places>,
}

/// Where a tile's triangles are, by triangle number.
#[derive(Debug)]
struct Places {
    /// In the hierarchy that the CPU walks.
    slots: Vec<u32>,
    /// In the one for the GPU.
    items: Vec<u32>,
}

/// Consecutive triangles of a tile that are hidden together.
#[derive(Debug)]
struct Run {
    tile: usize,
    numbers: Range<u32>,
    /// Object of the instance, and the triangles' own object.
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

    /// Whether the hierarchies were built without just these objects.
    pub fn is_hiding(&self, hidden: &BTreeSet<ObjectId>) -> bool {
        self.never_there == *hidden && self.hidden == *hidden
    }

    /// Whether the hierarchies hold every object that is to be shown.
    pub fn can_hide(&self, hidden: &BTreeSet<ObjectId>) -> bool {
        self.never_there.is_subset(hidden)
    }

    /// Hides these objects of the scenery and shows all others.
    pub fn set(&mut self, hidden: &BTreeSet<ObjectId>, scenery: &mut Scenery) {
        if *hidden == self.hidden {
            return;
        }
        let mut table = self.table.take().unwrap_or_else(|| Table::new(scenery));
        self.revision += 1;
        self.chunks.resize_with(scenery.tiles.len(), Vec::new);
        for run in &mut table.runs {
            let hides = run.objects.iter().any(|object| hidden.contains(object));
            if hides != run.is_hidden {
                run.is_hidden = hides;
                for number in run.numbers.clone() {
                    self.set_triangle(scenery, run, number, &table.places[run.tile]);
                }
            }
        }
        self.hidden.clone_from(hidden);
        self.table = Some(table);
    }

    /// Shrinks a triangle to a point, or restores it, as its run says.
    fn set_triangle(&mut self, scenery: &mut Scenery, run: &Run, number: u32, places: &Places) {
        let tile = &mut scenery.tiles[run.tile];
        let (instance, triangle) = tile.sources[number as usize];
        let placed = &scenery.statics[instance as usize];
        let mesh = &scenery.meshes[placed.mesh_idx as usize];
        let in_mesh = mesh.triangle(triangle as usize).map(|v| v.position_m);
        let whole = corners_in(&tile.origin_m, &placed.world_from_mesh, in_mesh);
        let (corners, shown) = if run.is_hidden {
            ([whole[0]; 3], NO_TRIANGLE)
        } else {
            (whole, number)
        };
        let slot = places.slots[number as usize];
        if slot != NO_TRIANGLE {
            tile.tree.set(slot, &corners, shown);
        }
        let item = places
            .items
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
            let chunks = &mut self.chunks[run.tile];
            chunks.resize(packed.corners.len().div_ceil(CHUNK), 0);
            chunks[item / CHUNK] = self.revision;
        }
    }
}

impl Table {
    /// The table of a scenery in which nothing is hidden yet.
    fn new(scenery: &Scenery) -> Self {
        let mut table = Table {
            runs: Vec::new(),
            places: Vec::new(),
        };
        for (tile_idx, tile) in scenery.tiles.iter().enumerate() {
            for (number, (instance, triangle)) in (0..).zip(&tile.sources) {
                let placed = &scenery.statics[*instance as usize];
                let mesh = &scenery.meshes[placed.mesh_idx as usize];
                let objects = [placed.object, Labels::of(mesh, *triangle).object];
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
            let slots = tile.tree.numbers.iter().flatten().copied();
            let items = tile
                .tree
                .packed
                .iter()
                .flat_map(|packed| packed.items.iter().copied());
            table.places.push(Places {
                slots: inverse(tile, (0..).zip(slots)),
                items: inverse(tile, (0..).zip(items)),
            });
        }
        table
    }
}

/// Inverts pairs of place and triangle number: the place by triangle number.
fn inverse(tile: &Tile, found: impl Iterator<Item = (u32, u32)>) -> Vec<u32> {
    let mut places = vec![NO_TRIANGLE; tile.sources.len()];
    found
        .filter(|(_, number)| *number != NO_TRIANGLE)
        .for_each(|(place, number)| places[number as usize] = place);
    places
}
