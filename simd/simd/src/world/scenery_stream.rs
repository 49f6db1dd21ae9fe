//! Scenery of large maps that comes and goes with the sensors that look at it.
//!
//! Which tiles are there follows from the places of the sensors at the tick, so that a run sees the
//! same again. Cameras and rays have tiles of their own: rays reach less far.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use sensor_core::scene::SceneAssets;
use sensor_core::stream::{RAY_REACH_M, TILE_M, Tile, Tiles, VIEW_REACH_M, tiles_near};
use simd_world::World;

use simd_frames::frames::Sensors;
use simd_frames::sensor::{Model, Sensor};

/// Ticks for which tiles stay that a query asked for, because queries come in numbers.
const ASKED_TICKS: u64 = 200;
/// Most tiles that queries keep.
const MAX_ASKED: usize = 64;
/// Longest part of a ray along which tiles are asked for, metres.
const ASKED_M: f64 = 3000.0;

/// The scenery of an episode on a large map.
pub struct SceneryStream {
    tiles: Tiles,
    /// The whole scenery without what is hidden.
    visible: Arc<SceneAssets>,
    /// Tiles that cameras have, and the scenery of these.
    views: BTreeSet<Tile>,
    shown: Arc<SceneAssets>,
    /// Tiles that rays hit.
    rays: BTreeSet<Tile>,
    /// Tiles that queries asked for, and until which tick they stay.
    asked: BTreeMap<Tile, u64>,
}

impl SceneryStream {
    /// A stream of this scenery, with nothing there yet.
    pub fn new(tiles: Tiles, visible: Arc<SceneAssets>) -> SceneryStream {
        SceneryStream {
            shown: Arc::new(tiles.shown(&visible, &BTreeSet::new())),
            tiles,
            visible,
            views: BTreeSet::new(),
            rays: BTreeSet::new(),
            asked: BTreeMap::new(),
        }
    }

    /// The scenery that cameras have.
    pub fn shown(&self) -> &Arc<SceneAssets> {
        &self.shown
    }

    /// Takes over what is hidden and switched now.
    pub fn set_visible(&mut self, visible: Arc<SceneAssets>) {
        self.shown = Arc::new(self.tiles.shown(&visible, &self.views));
        self.visible = visible;
    }

    /// The scenery that rays have.
    pub fn hit(&self) -> Arc<SceneAssets> {
        Arc::new(self.tiles.shown(&self.visible, &self.rays))
    }

    /// Brings the tiles near the sensors that are read.
    ///
    /// # Errors
    /// When frames in flight cannot be sent.
    pub fn follow(
        &mut self,
        sensors: &mut Sensors,
        world: &World,
        tick: u64,
    ) -> anyhow::Result<()> {
        let mut views = BTreeSet::new();
        self.asked.retain(|_, until| *until >= tick);
        let mut rays: BTreeSet<Tile> = self.asked.keys().copied().collect();
        let mut casts = !rays.is_empty();
        for sensor in &sensors.sensors {
            let Some(reach) = reach_of(sensor, sensors.is_read(sensor)) else {
                continue;
            };
            let Some(record) = world.record(sensor.actor) else {
                continue;
            };
            let at = record.world_from_actor.translation_m;
            if !(at[0].is_finite() && at[1].is_finite()) {
                continue;
            }
            let near = || tiles_near(at[0], at[1], reach.metres);
            if reach.is_cast {
                casts = true;
                rays.extend(near());
            }
            if reach.is_drawn {
                views.extend(near());
            }
        }
        if views != self.views {
            self.views = views;
            self.shown = Arc::new(self.tiles.shown(&self.visible, &self.views));
            sensors.load_views(&self.shown)?;
        }
        if casts && (rays != self.rays || !sensors.has_rays()) {
            self.rays = rays;
            sensors.load_rays(&self.hit(), true);
        }
        Ok(())
    }

    /// Brings the tiles that rays of a query pass.
    pub fn ask(
        &mut self,
        sensors: &mut Sensors,
        rays: &[(Point3<f64>, Vector3<f64>, f64)],
        tick: u64,
    ) {
        for (from, direction, length_m) in rays {
            let n = (length_m.min(ASKED_M) / (0.5 * TILE_M)).ceil() as usize;
            for k in 0..=n {
                let at = from + direction * (0.5 * TILE_M * k as f64).min(*length_m);
                for tile in tiles_near(at.x, at.y, 1.0) {
                    if self.asked.len() < MAX_ASKED || self.asked.contains_key(&tile) {
                        self.asked.insert(tile, tick + ASKED_TICKS);
                    }
                }
            }
        }
        let missing = self.asked.keys().any(|tile| !self.rays.contains(tile));
        if missing || !sensors.has_rays() {
            self.rays.extend(self.asked.keys());
            sensors.load_rays(&self.hit(), true);
        }
    }
}

/// How far a sensor sees, and by what.
struct Reach {
    metres: f64,
    is_drawn: bool,
    is_cast: bool,
}

/// Of a sensor that is read; `None` for one that needs no scenery.
fn reach_of(sensor: &Sensor, is_read: bool) -> Option<Reach> {
    let (is_drawn, is_cast) = (sensor.model.view().is_some(), sensor.model.casts_rays());
    let metres = match sensor.model {
        _ if !is_read || !(is_drawn || is_cast) => return None,
        Model::View(_) | Model::Lens(_) => VIEW_REACH_M,
        _ => RAY_REACH_M,
    };
    Some(Reach {
        metres,
        is_drawn,
        is_cast,
    })
}
