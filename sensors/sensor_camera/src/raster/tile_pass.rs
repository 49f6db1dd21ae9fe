//! Draws a view in tiles: sorts its triangles, fills, resolves and lights tile by tile. Rows of tiles
//! are shared out over threads; no pixel depends on that.

use rayon::prelude::*;
use sensor_core::vector_lanes::in_lanes;

use super::plan::RasterView;
use super::tile_images::{Band, TileImages};
use super::tile_resolve::Resolve;
use super::tile_shade::{Shade, TileLight};
use super::tile_surfaces::{SurfaceBand, SurfaceRows, Surfaces};
use super::tiles::{TILE_PX, Tile, TileInput, TileLists};
use crate::target::{Target, TargetSet};
use crate::uniform::ViewData;

/// Draws depth, classes, ids, flow and normals of a view. Where its draw calls begin, and which
/// targets are wanted, is not taken from `view`: all of `input` is drawn, and everything is made.
///
/// # Panics
/// If a draw call names vertices, indices or instances that are not there.
pub fn exact_images(view: &ViewData, input: &TileInput<'_>) -> TileImages {
    let set = [
        Target::Depth,
        Target::Class,
        Target::Instance,
        Target::Flow,
        Target::Normals,
    ];
    let set = set.map(Target::bit).into_iter();
    let mut images = TileImages::default();
    TilePass::default().draw(
        view,
        input,
        None,
        set.fold(TargetSet::default(), TargetSet::union),
        &mut images,
    );
    images
}

/// Memory that is used again for the next view.
#[derive(Debug, Default)]
pub(crate) struct TilePass {
    lists: TileLists,
    /// Surfaces of all pixels, where they show each other.
    whole: Surfaces,
}

/// What tiles of a view share.
struct Drawing<'d> {
    view: &'d ViewData,
    lists: &'d TileLists,
    input: &'d TileInput<'d>,
    light: Option<&'d TileLight<'d>>,
}

impl TilePass {
    /// Draws the images of `set`. Colour needs light.
    ///
    /// # Panics
    /// If a draw call names vertices, indices or instances that are not there.
    pub fn draw(
        &mut self,
        view: &ViewData,
        input: &TileInput<'_>,
        light: Option<&TileLight<'_>>,
        set: TargetSet,
        images: &mut TileImages,
    ) {
        let raster_view = RasterView {
            lens_px: view.lens_px,
            size_px: view.size_px.map(|size| size as u32),
            first_pixel: 0,
            near_m: view.near_m,
        };
        let view = &ViewData {
            wanted: set.0 as u32,
            ..*view
        };
        images.fit(view.size_px.map(|size| size as usize), set);
        self.lists.sort(&raster_view, input);
        let drawing = Drawing {
            view,
            lists: &self.lists,
            input,
            light: light.filter(|_| set.contains(Target::Color)),
        };
        match drawing.light {
            Some(light) if light.mirrors_pixels() => {
                self.whole.fit(drawing.lists.n_tiles());
                let rows = self.whole.rows();
                let bands = shared_out(images).zip(rows);
                bands.for_each_init(Tile::default, |tile, ((number, mut band), mut rows)| {
                    for (tile_idx, origin_px) in drawing.tiles(number) {
                        let surfaces = Some((&mut rows, origin_px[0]));
                        drawing.resolve(tile_idx, origin_px, tile, &mut band, surfaces);
                    }
                });
                let whole = &self.whole;
                shared_out(images).for_each(|(number, mut band)| {
                    let all = whole.band(number);
                    for (_, origin_px) in drawing.tiles(number) {
                        let (own, column) = (&all, origin_px[0]);
                        drawing.shade(light, (own, column), Some(whole), origin_px, &mut band);
                    }
                });
            }
            _ => shared_out(images).for_each_init(
                || (Tile::default(), Surfaces::of_tile()),
                |(tile, surfaces), (number, mut band)| {
                    for (tile_idx, origin_px) in drawing.tiles(number) {
                        let mut rows = surfaces.rows();
                        let rows = drawing.light.and(rows.first_mut()).map(|rows| (rows, 0));
                        drawing.resolve(tile_idx, origin_px, tile, &mut band, rows);
                        if let Some(light) = drawing.light {
                            drawing.shade(
                                light,
                                (&surfaces.band(0), 0),
                                None,
                                origin_px,
                                &mut band,
                            );
                        }
                    }
                },
            ),
        }
    }
}

/// The rows of tiles with their numbers, one after the other for any thread.
fn shared_out(images: &mut TileImages) -> impl IndexedParallelIterator<Item = (usize, Band<'_>)> {
    images.bands().into_par_iter().enumerate().with_max_len(1)
}

impl Drawing<'_> {
    /// Number and first pixel of each tile in a row of tiles.
    fn tiles(&self, band: usize) -> impl Iterator<Item = (usize, [usize; 2])> + use<> {
        let across = self.lists.n_tiles()[0];
        (0..across).map(move |column| {
            let origin_px = [column, band].map(|at| at * TILE_PX);
            (band * across + column, origin_px)
        })
    }

    fn resolve(
        &self,
        tile_idx: usize,
        origin_px: [usize; 2],
        tile: &mut Tile,
        out: &mut Band<'_>,
        surfaces: Option<(&mut SurfaceRows<'_>, usize)>,
    ) {
        self.lists.fill(tile_idx, tile);
        in_lanes(Resolve {
            view: self.view,
            input: self.input,
            tile,
            origin_px,
            out,
            surfaces,
        });
    }

    fn shade(
        &self,
        light: &TileLight<'_>,
        (own, column): (&SurfaceBand<'_>, usize),
        whole: Option<&Surfaces>,
        origin_px: [usize; 2],
        out: &mut Band<'_>,
    ) {
        in_lanes(Shade {
            light,
            view: self.view,
            own,
            column,
            whole,
            origin_px,
            color: out.color,
            width: out.width,
        });
    }
}
