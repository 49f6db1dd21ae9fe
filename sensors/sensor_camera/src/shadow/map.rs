//! One shadow map: where it lies, and which parts must be drawn again.

use super::caster::Caster;
use super::draw::MapWork;
use super::sheet::SheetPlace;

/// One map.
#[derive(Debug)]
pub(super) struct Map {
    pub cell: [i64; 3],
    pub side_px: u32,
    pub sheet: usize,
    pub place: SheetPlace,
    /// Whether the static map is up to date.
    pub fresh: bool,
    /// Moving casters that were drawn over it.
    pub over: Vec<Caster>,
    /// Parts that moving casters cover, which differ from the static map: x, y, width, height.
    pub dirty_px: Vec<[u32; 4]>,
    pub used: u64,
}

impl Map {
    fn origin_px(&self) -> [u32; 2] {
        self.place.tile.map(|i| i * self.side_px)
    }

    fn whole_px(&self) -> [u32; 4] {
        [0, 0, self.side_px, self.side_px]
    }

    /// Plans the drawing of these casters: on the static map, and on the map with moving casters.
    pub fn plan(
        &mut self,
        still: Option<Vec<Caster>>,
        moving: Option<Vec<Caster>>,
    ) -> [Option<MapWork>; 2] {
        let (origin_px, side_px) = (self.origin_px(), self.side_px);
        let still = still.map(|casters| {
            self.fresh = true;
            // Moving casters must be drawn over the new static map again.
            self.dirty_px = vec![self.whole_px()];
            self.over.clear();
            MapWork {
                origin_px,
                side_px,
                wiped_px: vec![self.whole_px()],
                casters,
            }
        });
        let changed = moving.filter(|moving| {
            still.is_some() || self.over != *moving || self.dirty_px.contains(&self.whole_px())
        });
        let all = changed.map(|casters| {
            let wiped_px = std::mem::take(&mut self.dirty_px);
            casters
                .iter()
                .for_each(|caster| add_rect(&mut self.dirty_px, caster.rect_px));
            self.over.clone_from(&casters);
            MapWork {
                origin_px,
                side_px,
                wiped_px,
                casters,
            }
        });
        [still, all]
    }
}

/// Adds a rectangle unless another one contains it, as a car's contains its wheels.
fn add_rect(rects: &mut Vec<[u32; 4]>, new: [u32; 4]) {
    let holds = |[x, y, width, height]: &[u32; 4]| {
        *x <= new[0]
            && *y <= new[1]
            && x + width >= new[0] + new[2]
            && y + height >= new[1] + new[3]
    };
    if !rects.iter().any(holds) {
        rects.push(new);
    }
}
