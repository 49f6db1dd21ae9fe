//! Renders views on processors, without a GPU: finds what a view sees by the rules of
//! [`crate::CameraRenderer`], draws its shadow map, and draws and lights it in tiles. Colour is that of
//! low quality, by the film curve alone.

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_frames::Modality;
use schema_types::space::sensor_from_camera;
use sensor_core::{InstancePoses, Scene, Vertex};
use sensor_shade::images::{Beyond, ByteImage, DepthImage, NumberImage};
use sensor_shade::shading::Overrides;
use sensor_spec::Intrinsics;

use crate::assets::{Meshes, switched_words};
use crate::camera_motion::{CameraMotion, Firing};
use crate::lamps::{self, LampLists};
use crate::light::{Light, noise_levels};
use crate::quality::Quality;
use crate::raster::{RasterDraw, TileImages, TileInput, TileLight, TilePass};
use crate::shadow::{CasterInput, Eye, TileMaps};
use crate::target::{Target, TargetSet};
use crate::uniform::ViewData;
use crate::visible::{self, Drawn, Moving, Seen, StillAs};

/// The meshes of an episode.
#[derive(Debug)]
struct Loaded {
    meshes: Meshes,
    vertices: Vec<Vertex>,
    indices: Vec<u32>,
    /// How lamps are switched, for shading.
    switched: Vec<[u32; 2]>,
}

/// Draws views of a scene, one after the other.
#[derive(Debug)]
pub struct TileRenderer {
    loaded: Option<Loaded>,
    light: Option<(Light, NumberImage)>,
    noise: ByteImage,
    maps: TileMaps,
    no_map: DepthImage,
    pass: TilePass,
    draws: Vec<RasterDraw>,
}

/// A camera with its state from firing to firing.
#[derive(Debug)]
pub struct TileCamera {
    lens: Intrinsics,
    previous: Option<Firing>,
    drawn: Drawn,
}

impl TileCamera {
    /// A camera that has not fired.
    pub fn new(lens: Intrinsics) -> TileCamera {
        TileCamera {
            lens,
            previous: None,
            drawn: Drawn::default(),
        }
    }
}

/// The target that is a modality's image; events are none.
fn target_of(modality: Modality) -> Option<Target> {
    match modality {
        Modality::Rgb => Some(Target::Color),
        Modality::Depth => Some(Target::Depth),
        Modality::Semantic => Some(Target::Class),
        Modality::Instance => Some(Target::Instance),
        Modality::Flow => Some(Target::Flow),
        Modality::Normals => Some(Target::Normals),
        _ => None,
    }
}

impl Default for TileRenderer {
    fn default() -> Self {
        let levels = noise_levels();
        let levels: Vec<&[[u8; 4]]> = levels.iter().map(Vec::as_slice).collect();
        TileRenderer {
            loaded: None,
            light: None,
            noise: ByteImage::new(&levels, Beyond::Repeat),
            maps: TileMaps::new(Quality::Low),
            no_map: DepthImage::far(1),
            pass: TilePass::default(),
            draws: Vec::new(),
        }
    }
}

impl TileRenderer {
    /// Draws those of these modalities that are images into `images`, and remembers the firing.
    pub fn render(
        &mut self,
        scene: &Scene,
        camera: &mut TileCamera,
        world_from_sensor: &Isometry3<f64>,
        modalities: &[Modality],
        images: &mut TileImages,
    ) {
        let targets = modalities
            .iter()
            .filter_map(|modality| target_of(*modality));
        let set = targets.fold(TargetSet::default(), |set, target| set.union(target.bit()));
        self.load(scene);
        if self
            .light
            .as_ref()
            .is_none_or(|(light, _)| !light.is_of(&scene.weather))
        {
            let (light, sky) = Light::new(Quality::Low, &scene.weather);
            let texels: Vec<[f32; 4]> = sky.rgb.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
            self.light = Some((light, NumberImage::new(&[&texels], Beyond::Clamp)));
        }
        let world_from_camera = world_from_sensor * sensor_from_camera();
        let episode = scene.assets.episode;
        if camera
            .previous
            .as_ref()
            .is_some_and(|firing| firing.episode != episode)
        {
            camera.previous = None;
        }
        self.draw(scene, camera, world_from_camera, set, images);
        camera.previous = Some(Firing {
            world_from_camera,
            sim_time: scene.sim_time,
            episode,
            poses: Arc::new(InstancePoses::of(scene)),
        });
    }

    /// Takes the scene's assets, if they are others.
    fn load(&mut self, scene: &Scene) {
        let assets = &scene.assets;
        match &mut self.loaded {
            Some(loaded) if Arc::ptr_eq(&loaded.meshes.scene_assets, assets) => {}
            Some(loaded) if loaded.meshes.shows_the_same(assets) => {
                loaded.meshes.switch_lamps(assets);
                loaded.switched = switched_words(assets);
            }
            _ => {
                let (meshes, (vertices, indices)) = Meshes::of(assets);
                self.loaded = Some(Loaded {
                    meshes,
                    vertices,
                    indices,
                    switched: switched_words(assets),
                });
                self.maps.clear();
            }
        }
    }

    fn draw(
        &mut self,
        scene: &Scene,
        camera: &mut TileCamera,
        world_from_camera: Isometry3<f64>,
        set: TargetSet,
        images: &mut TileImages,
    ) {
        let loaded = self.loaded.as_ref().expect("render() loaded the assets");
        let (light, sky) = self.light.as_ref().expect("render() made the light");
        let (lens, meshes) = (&camera.lens, &loaded.meshes);
        let motion = CameraMotion::new(world_from_camera, camera.previous.as_ref());
        let seen = Seen {
            lens: *lens,
            previous: camera.previous.as_ref(),
            hidden: &[],
            still: StillAs::Instances,
            by_walls: true,
        };
        let moving = Moving::of(scene, meshes);
        visible::visible(scene, meshes, &moving, seen, &motion, &mut camera.drawn);
        self.draws.clear();
        self.draws.extend(RasterDraw::all_of(&camera.drawn, 0, 0));
        let input = TileInput {
            vertices: &loaded.vertices,
            indices: &loaded.indices,
            instances: &camera.drawn.instances,
            draws: &self.draws,
        };
        let blockers = &camera.drawn.blockers;
        let mut view = ViewData {
            n_blockers: blockers.n,
            blockers: blockers.boxes,
            ..motion.view_data(lens)
        };
        if !set.contains(Target::Color) {
            self.pass.draw(&view, &input, None, set, images);
            return;
        }
        let shining = lamps::shining(scene, meshes, light.exposure, light.dark_ratio);
        let mut lists = LampLists::default();
        let found = lamps::reaching(&shining, Quality::Low, lens, &motion);
        let n_lamps = lists.add_view(&found, lens).n;
        let mut shadows = &self.no_map;
        if light.has_shadows {
            let casters = CasterInput {
                meshes,
                vertices: &loaded.vertices,
                indices: &loaded.indices,
            };
            let eye = Eye {
                world_from_camera,
                focal_px: lens.focal_px,
            };
            let lookup = self.maps.draw(&casters, scene, light.sun_towards, &eye);
            view = ViewData {
                shadow_from_camera: lookup.shadow_from_camera,
                has_shadows: 1.0,
                shadow_texel_depth: lookup.texel_depth,
                ..view
            };
            shadows = lookup.depths;
        }
        let is_switched = meshes.is_switched();
        let lit = TileLight {
            light: &light.data_at(scene.sim_time.as_secs()),
            overrides: Overrides {
                simple: true,
                with_fog: light.has_fog,
                with_wet: light.is_wet,
                with_switched: is_switched,
                with_lamps: n_lamps > 0 || light.dark_ratio > 0.0 || is_switched,
            },
            lamps: &lists.lamps,
            lamp_tiles: &lists.tiles,
            switched: &loaded.switched,
            noise: &self.noise,
            sky,
            shadows,
        };
        self.pass.draw(&view, &input, Some(&lit), set, images);
    }
}
