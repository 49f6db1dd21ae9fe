//! The shadow maps of one cascade: which are kept, which are drawn again, and where each view finds
//! its own.

use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use sensor_core::Scene;
use sensor_gpu::{Gpu, Uploads};

use super::cascade::{Cascade, MovingCaster};
use super::caster::MatrixRows;
use super::draw::{LayerWork, MapWork, ShadowDraw};
use super::map::Map;
use super::sheet::{Sheet, SheetPlace};
use crate::assets::{GpuAssets, Meshes};
use crate::target::{Image, image};

/// A lit camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    pub world_from_camera: Isometry3<f64>,
    pub focal_px: f64,
}

/// Spare maps of each size, if each map is a layer: cameras often return to a cell.
const SPARE_MAPS: u32 = 3;
/// Up to this number of maps is planned before other threads would wake up.
const FEW_MAPS: usize = 4;

/// Which maps share a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MapLayout {
    /// All maps lie in one texture, because compute shaders look up the maps of several views at
    /// once.
    Together,
    /// Maps of each size lie in one texture, each map in a layer of its own.
    BySize,
}

/// The maps of a cascade.
#[derive(Debug)]
pub(crate) struct CascadeMaps {
    cascade: Cascade,
    layout: MapLayout,
    draw: ShadowDraw,
    /// Memory limit of all textures.
    most_bytes: u64,
    sheets: Vec<Sheet>,
    maps: Vec<Map>,
    sun_towards: Vector3<f64>,
    n_uses: u64,
    none: Image,
}

/// Where an eye's map is.
#[derive(Clone, Copy, Debug)]
struct EyePlace {
    cascade: Cascade,
    cell: [i64; 3],
    world_from_camera: Isometry3<f64>,
}

/// A map's sheet and layer, and the work on it: on the static map, and on the map with moving
/// casters.
type PlannedMap = (usize, u32, [Option<MapWork>; 2]);

/// Result of [`CascadeMaps::plan`]; it must be recorded before the next plan is made.
#[derive(Debug)]
pub(crate) struct ShadowPlan {
    places: Vec<EyePlace>,
    /// Index of each place's map.
    maps: Vec<usize>,
    works: Vec<PlannedMap>,
}

/// What a view needs to look up its map.
#[derive(Clone, Debug)]
pub(crate) struct ShadowLookup {
    /// The map's layer.
    pub view: wgpu::TextureView,
    pub layer: u32,
    /// Its place in the layer: x, y in sides of the map, and its side in sides of the layer.
    pub tile: [f32; 3],
    pub shadow_from_camera: MatrixRows,
    /// One texel in units of the map's depth.
    pub texel_depth: f32,
    /// Whether there is a map at all.
    pub on: bool,
}

impl CascadeMaps {
    /// Its textures get no more than `most_bytes`, or one map of each size.
    pub fn new(gpu: &Gpu, cascade: Cascade, layout: MapLayout, most_bytes: u64) -> Self {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT;
        CascadeMaps {
            cascade,
            layout,
            draw: ShadowDraw::new(gpu),
            most_bytes,
            sheets: Vec::new(),
            maps: Vec::new(),
            sun_towards: Vector3::zeros(),
            n_uses: 0,
            none: image(
                gpu,
                "no shadows",
                [1, 1],
                wgpu::TextureFormat::Depth16Unorm,
                usage,
            ),
        }
    }

    fn is_together(&self) -> bool {
        self.layout == MapLayout::Together
    }

    /// Forgets everything: another episode.
    pub fn clear(&mut self) {
        self.maps.clear();
        self.sheets.iter_mut().for_each(Sheet::clear);
    }

    /// Changes the memory limit of its textures, and drops them.
    pub fn limit(&mut self, most_bytes: u64) {
        self.most_bytes = most_bytes;
        self.maps.clear();
        self.sheets.clear();
    }

    /// Bytes of its textures.
    pub fn n_bytes(&self) -> u64 {
        self.sheets.iter().map(Sheet::n_bytes).sum()
    }

    /// How many of these eyes, counted from the first, can have their maps at the same time; at
    /// least one.
    pub fn n_fitting(&self, eyes: &[Eye]) -> usize {
        let (mut sheets, mut known): (Vec<Sheet>, Vec<([i64; 3], u32)>) = (Vec::new(), Vec::new());
        for (i, eye) in eyes.iter().enumerate() {
            let key = (
                self.cascade.cell_of(&eye.world_from_camera),
                self.cascade.seen_with(eye.focal_px).side_px,
            );
            if known.contains(&key) {
                continue;
            }
            known.push(key);
            let sheet = sheet_of(&mut sheets, self.page_px(key.1), || self.sheet(key.1));
            if sheets[sheet].take(key.0, key.1).is_none() {
                if !sheets[sheet].grow() {
                    return i;
                }
                sheets[sheet].take(key.0, key.1);
            }
        }
        eyes.len()
    }

    fn page_px(&self, side_px: u32) -> u32 {
        if self.is_together() {
            self.cascade.side_px
        } else {
            side_px
        }
    }

    /// A sheet for maps of this size, with its share of the memory.
    fn sheet(&self, side_px: u32) -> Sheet {
        let n_sheets = if self.is_together() {
            1
        } else {
            self.cascade.n_sizes()
        };
        Sheet::new(
            self.page_px(side_px),
            self.cascade.casters,
            self.most_bytes / n_sheets,
        )
    }

    /// Marks the static maps as stale, because other objects are shown.
    pub fn redraw(&mut self) {
        self.maps.iter_mut().for_each(|map| map.fresh = false);
    }

    /// A lookup that finds no shadow.
    pub fn none(&self) -> ShadowLookup {
        ShadowLookup {
            view: self.none.view.clone(),
            layer: 0,
            tile: [0.0, 0.0, 1.0],
            shadow_from_camera: [[0.0; 4]; 3],
            texel_depth: 0.0,
            on: false,
        }
    }

    /// Where compute shaders look up the maps that were last drawn.
    pub fn lookup(&self) -> &wgpu::TextureView {
        match self.sheets.first() {
            Some(sheet) if self.is_together() && !self.maps.is_empty() => sheet.lookup(),
            _ => &self.none.layers,
        }
    }

    /// Plans what to draw for these eyes, of which there are no more than
    /// [`CascadeMaps::n_fitting`] returns.
    pub fn plan(
        &mut self,
        assets: &Meshes,
        scene: &Scene,
        sun_towards: Vector3<f64>,
        eyes: &[Eye],
    ) -> ShadowPlan {
        if self.sun_towards != sun_towards {
            self.clear();
            self.sun_towards = sun_towards;
        }
        let place = |eye: &Eye| EyePlace {
            cascade: self.cascade.seen_with(eye.focal_px),
            cell: self.cascade.cell_of(&eye.world_from_camera),
            world_from_camera: eye.world_from_camera,
        };
        let places: Vec<EyePlace> = eyes.iter().map(place).collect();
        let maps = self.take_maps(&places).or_else(|| {
            // Maps in use are fragmented over the layers; starting over packs them.
            self.clear();
            self.take_maps(&places)
        });
        let maps = maps.expect("so many eyes fit");
        ShadowPlan {
            places,
            maps,
            works: self.works(assets, scene),
        }
    }

    /// Draws what was planned and returns a lookup for each eye.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        assets: &GpuAssets,
        plan: &ShadowPlan,
    ) -> Vec<ShadowLookup> {
        let n_spare = if self.is_together() { 1 } else { SPARE_MAPS };
        self.sheets
            .iter_mut()
            .for_each(|sheet| sheet.ensure(gpu, encoder, n_spare));
        self.draw_maps(gpu, (uploads, encoder), assets, &plan.works);
        let lookup = |(place, map_idx): (&EyePlace, &usize)| {
            let EyePlace {
                cascade,
                cell,
                world_from_camera,
            } = place;
            let map = &self.maps[*map_idx];
            let sheet = &self.sheets[map.sheet];
            let [x, y] = map.place.tile.map(|i| i as f32);
            ShadowLookup {
                view: if self.shows_all(map) {
                    sheet.all(map.place.layer).clone()
                } else {
                    sheet.still(map.place.layer).clone()
                },
                layer: map.place.layer,
                tile: [x, y, map.side_px as f32 / sheet.page_px as f32],
                shadow_from_camera: cascade.shadow_from_camera(
                    *cell,
                    self.sun_towards,
                    world_from_camera,
                ),
                texel_depth: cascade.texel_depth(),
                on: true,
            }
        };
        plan.places.iter().zip(&plan.maps).map(lookup).collect()
    }

    /// Whether shaders look up the map with moving casters instead of the static one.
    fn shows_all(&self, map: &Map) -> bool {
        self.cascade.casters.has_moving() && (self.is_together() || !map.over.is_empty())
    }

    /// The map of each place, made if there is none; `None` if there is no room.
    fn take_maps(&mut self, places: &[EyePlace]) -> Option<Vec<usize>> {
        self.n_uses += 1;
        let used = self.n_uses;
        let mut missing: Vec<([i64; 3], u32)> = Vec::new();
        for EyePlace { cascade, cell, .. } in places {
            let key = (*cell, cascade.side_px);
            match self
                .maps
                .iter_mut()
                .find(|map| (map.cell, map.side_px) == key)
            {
                Some(map) => map.used = used,
                None if !missing.contains(&key) => missing.push(key),
                None => {}
            }
        }
        for (cell, side_px) in missing {
            let (page_px, new) = (self.page_px(side_px), self.sheet(side_px));
            let sheet = sheet_of(&mut self.sheets, page_px, || new);
            let place = self.take_place(sheet, cell, side_px)?;
            self.maps.push(Map {
                cell,
                side_px,
                sheet,
                place,
                fresh: false,
                over: Vec::new(),
                dirty_px: Vec::new(),
                used,
            });
        }
        let idx_of = |EyePlace { cascade, cell, .. }: &EyePlace| {
            let found = self
                .maps
                .iter()
                .position(|map| (map.cell, map.side_px) == (*cell, cascade.side_px));
            found.expect("every missing map was made")
        };
        Some(places.iter().map(idx_of).collect())
    }

    /// Finds room for a map: evicts the least recently used ones, or adds a layer if none can be
    /// evicted and the limit allows it.
    fn take_place(&mut self, sheet: usize, cell: [i64; 3], side_px: u32) -> Option<SheetPlace> {
        loop {
            if let Some(place) = self.sheets[sheet].take(cell, side_px) {
                return Some(place);
            }
            let is_free =
                |idx: &usize| self.maps[*idx].sheet == sheet && self.maps[*idx].used < self.n_uses;
            match (0..self.maps.len())
                .filter(is_free)
                .min_by_key(|idx| self.maps[*idx].used)
            {
                Some(oldest) => {
                    let map = self.maps.swap_remove(oldest);
                    self.sheets[sheet].give_back(map.place);
                }
                None if self.sheets[sheet].grow() => {}
                None => return None,
            }
        }
    }

    /// Work on the maps that are in use.
    fn works(&mut self, assets: &Meshes, scene: &Scene) -> Vec<PlannedMap> {
        let (cascade, together, used, sun_towards) = (
            self.cascade,
            self.is_together(),
            self.n_uses,
            self.sun_towards,
        );
        let moving = if cascade.casters.has_moving() {
            MovingCaster::all_of(assets, scene)
        } else {
            Vec::new()
        };
        let plan = |map: &mut Map| {
            let cascade = Cascade {
                side_px: map.side_px,
                ..cascade
            };
            let still = (!map.fresh).then(|| cascade.still_casters(assets, map.cell, sun_towards));
            let casters = cascade
                .casters
                .has_moving()
                .then(|| cascade.moving_casters(assets, &moving, map.cell, sun_towards));
            // The map with moving casters is not needed where nothing moves, unless all lookups go
            // there.
            let casters =
                casters.filter(|casters| together || !casters.is_empty() || !map.over.is_empty());
            map.plan(still, casters)
        };
        let work = |map: &mut Map| (map.sheet, map.place.layer, plan(map));
        if self.maps.len() <= FEW_MAPS {
            self.maps
                .iter_mut()
                .filter(|map| map.used == used)
                .map(work)
                .collect()
        } else {
            self.maps
                .par_iter_mut()
                .filter(|map| map.used == used)
                .map(work)
                .collect()
        }
    }

    fn draw_maps(
        &mut self,
        gpu: &Gpu,
        to: (&mut Uploads, &mut wgpu::CommandEncoder),
        assets: &GpuAssets,
        works: &[PlannedMap],
    ) {
        // The static maps of all layers come first.
        let mut layers: Vec<((usize, u32, usize), LayerWork<'_>)> = Vec::new();
        for kind in 0..2 {
            for (sheet, layer, work) in works
                .iter()
                .filter_map(|(sheet, layer, works)| Some((*sheet, *layer, works[kind].as_ref()?)))
            {
                if let Some((_, known)) = layers
                    .iter_mut()
                    .find(|(key, _)| *key == (sheet, layer, kind))
                {
                    known.maps.push(work);
                    continue;
                }
                let Sheet { page_px, .. } = self.sheets[sheet];
                let still = self.sheets[sheet].still(layer);
                let (view, from) = if kind == 0 {
                    (still, None)
                } else {
                    (self.sheets[sheet].all(layer), Some(still))
                };
                layers.push((
                    (sheet, layer, kind),
                    LayerWork {
                        view,
                        page_px,
                        from,
                        maps: vec![work],
                    },
                ));
            }
        }
        let layers: Vec<LayerWork<'_>> = layers.into_iter().map(|(_, work)| work).collect();
        self.draw.record(gpu, to, assets, &layers);
    }
}

/// Index of the sheet with layers of this size, which is made if there is none.
fn sheet_of(sheets: &mut Vec<Sheet>, page_px: u32, new: impl FnOnce() -> Sheet) -> usize {
    sheets
        .iter()
        .position(|sheet| sheet.page_px == page_px)
        .unwrap_or_else(|| {
            sheets.push(new());
            sheets.len() - 1
        })
}
