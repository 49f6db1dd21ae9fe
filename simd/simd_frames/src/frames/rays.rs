//! The scene as rays see it, on the CPU and, for lidars, on the GPU.

use std::sync::Arc;

use sensor_core::scene::{Scene, SceneAssets};
use sensor_gpu::Gpu;
use sensor_ray::{GpuRayOptions, GpuRays, RayScene};

use crate::topic::Writer;

/// Hierarchies of triangles for everything that casts rays.
pub(super) struct Rays {
    /// `None` while no sensor casts rays.
    scene: Option<RayScene>,
    /// Casts lidars; `None` leaves that to the CPU.
    lidar_gpu: Option<GpuRays>,
    /// Lidars fell back to the CPU once, which is logged only then.
    lidars_were_refused: bool,
    /// A lidar as sold was left to the CPU, which is logged only once.
    has_noted_as_sold: bool,
}

impl Rays {
    /// Nothing loaded yet.
    pub fn new(gpu: Option<&Gpu>, lidars_on: Writer) -> Rays {
        Rays {
            scene: None,
            lidar_gpu: gpu
                .filter(|_| lidars_on == Writer::Gpu)
                .map(|gpu| GpuRays::new(gpu, GpuRayOptions::default())),
            lidars_were_refused: false,
            has_noted_as_sold: false,
        }
    }

    /// Takes over other static scenery; `is_needed` says whether a sensor casts rays.
    ///
    /// Building takes the better part of a second. It happens here, and not in the tick in which
    /// the first reader comes. Hiding objects takes less.
    pub fn load(&mut self, assets: &Arc<SceneAssets>, is_needed: bool) {
        let takes_over = |scene: &mut RayScene| {
            if assets.streamed {
                scene.stream(assets)
            } else {
                scene.hide(assets)
            }
        };
        if !self.scene.as_mut().is_some_and(takes_over) {
            self.scene = is_needed.then(|| self.build(assets));
        }
    }

    /// Whether any scenery is loaded.
    pub fn is_loaded(&self) -> bool {
        self.scene.is_some()
    }

    /// Loads the scenery if nothing is loaded yet.
    pub fn require(&mut self, assets: &SceneAssets) {
        if self.scene.is_none() {
            self.scene = Some(self.build(assets));
        }
    }

    /// The scene at its tick, loaded if nothing is loaded yet.
    pub fn at(&mut self, scene: &Scene) -> &RayScene {
        if !scene.assets.streamed {
            self.require(&scene.assets);
        }
        let rays = self.scene.as_mut().expect("just loaded");
        rays.update(&scene.dynamics);
        rays
    }

    /// The scene of the tick for rays on the CPU, brought up to date when first asked for.
    pub fn of_tick<'a>(&'a mut self, scene: &'a Scene) -> TickRays<'a> {
        TickRays {
            rays: self.scene.as_mut(),
            tick: scene,
            is_current: false,
        }
    }

    /// Whether the GPU casts lidars.
    pub fn casts_lidars_on_gpu(&self) -> bool {
        self.lidar_gpu.is_some()
    }

    /// Says that the processor casts a lidar as sold, once.
    pub fn note_as_sold(&mut self, topic: &str) {
        if !std::mem::replace(&mut self.has_noted_as_sold, true) {
            tracing::info!(
                topic,
                "lidars with returns or tables of channels are cast on the processor; said once"
            );
        }
    }

    /// The GPU's hierarchies at the scene's tick; `None` if the CPU has to cast the lidars.
    pub fn on_gpu(&mut self, scene: &Scene) -> Option<&mut GpuRays> {
        let (Some(gpu), Some(rays)) = (&mut self.lidar_gpu, &mut self.scene) else {
            return None;
        };
        rays.update_for_gpu(&scene.dynamics, &scene.past);
        if let Err(why) = gpu.update(rays) {
            if !std::mem::replace(&mut self.lidars_were_refused, true) {
                tracing::warn!(
                    tick = scene.tick.0,
                    why = why.to_string(),
                    "lidars are cast on the CPU as long as they are too much for the GPU; said once"
                );
            }
            return None;
        }
        Some(gpu)
    }

    fn build(&self, assets: &SceneAssets) -> RayScene {
        if self.lidar_gpu.is_some() {
            RayScene::load_for_gpu(assets)
        } else {
            RayScene::load(assets)
        }
    }
}

/// The ray scene of one tick.
pub(super) struct TickRays<'a> {
    rays: Option<&'a mut RayScene>,
    tick: &'a Scene,
    is_current: bool,
}

impl TickRays<'_> {
    pub fn current(&mut self) -> &RayScene {
        let rays = self
            .rays
            .as_mut()
            .expect("loaded with the map because there is a sensor that casts rays");
        if !std::mem::replace(&mut self.is_current, true) {
            rays.update_moving(&self.tick.dynamics, &self.tick.past);
        }
        rays
    }
}
