//! The scene: what renderers and ray casters see in one tick. Sensors only read it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use schema_frames::document::Weather;
use schema_types::{ActorId, ObjectId, SimTime, Tick};

use crate::mesh::Mesh;

/// Index into [`SceneAssets::meshes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MeshId(pub u32);

/// A mesh that stands still for the whole episode. Its triangles carry their own object ids where
/// they differ.
#[derive(Clone, Debug)]
pub struct StaticInstance {
    /// Mesh.
    pub mesh: MeshId,
    /// Pose; world positions are `f64`, the mesh's own coordinates stay small.
    pub world_from_mesh: Isometry3<f64>,
    /// Object of triangles whose own object id is 0.
    pub object: ObjectId,
}

/// How the lamps or windows of a scenery object are switched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampSetting {
    /// Whether they shine; `None`: only when it is dark.
    pub on: Option<bool>,
    /// Colour of their light, sRGB; `None`: as built.
    pub rgb: Option<[u8; 3]>,
    /// Strength of their light relative to how they were built.
    pub strength_ratio: f32,
}

/// Everything that does not change within an episode: uploaded to the GPU and put into BVHs once.
#[derive(Clone, Debug, Default)]
pub struct SceneAssets {
    /// Count of map loads; renderers rebuild when it changes.
    pub episode: u32,
    /// Meshes of scenery and of every actor that may appear.
    pub meshes: Vec<Arc<Mesh>>,
    /// Scenery.
    pub statics: Vec<StaticInstance>,
    /// Scenery whose lamps or windows are switched differently from how they were built.
    pub switched: BTreeMap<ObjectId, LampSetting>,
    /// Objects of the scenery that were left out of it; see [`SceneAssets::without`].
    pub hidden: BTreeSet<ObjectId>,
    /// Whether the map is so large that sensors get the scenery near them only; see
    /// [`crate::stream`].
    pub streamed: bool,
}

impl SceneAssets {
    /// Adds a mesh and returns its id.
    pub fn add_mesh(&mut self, mesh: Mesh) -> MeshId {
        self.meshes.push(Arc::new(mesh));
        MeshId(self.meshes.len() as u32 - 1)
    }

    /// The same assets without some objects of the scenery: without their instances, and without
    /// their triangles in meshes that show several objects.
    pub fn without(&self, hidden: &BTreeSet<ObjectId>) -> SceneAssets {
        let mut left = self.clone();
        left.hidden.extend(hidden);
        if hidden.is_empty() {
            return left;
        }
        left.statics
            .retain(|instance| !hidden.contains(&instance.object));
        // Vertices come in runs of one object, so the previous answer mostly holds again.
        let mut last = (ObjectId::BACKGROUND, false);
        let mut is_hidden = |id: u32| {
            if last.0.0 != id {
                last = (ObjectId(id), hidden.contains(&ObjectId(id)));
            }
            last.1
        };
        let mut empty = BTreeSet::new();
        for (i, mesh) in left.meshes.iter_mut().enumerate() {
            if mesh
                .vertices
                .iter()
                .any(|vertex| is_hidden(vertex.object_id))
            {
                let shown = mesh.keeping(|vertex| !is_hidden(vertex.object_id));
                if shown.indices.is_empty() {
                    empty.insert(MeshId(i as u32));
                }
                *mesh = Arc::new(shown);
            }
        }
        left.statics
            .retain(|instance| !empty.contains(&instance.mesh));
        left
    }

    /// The mesh with this id.
    pub fn mesh(&self, id: MeshId) -> &Mesh {
        &self.meshes[id.0 as usize]
    }
}

/// A rigid part of an actor in this tick: body, wheel, lamp head, limb.
#[derive(Clone, Debug)]
pub struct DynamicInstance {
    /// Actor it belongs to; instance images show its id.
    pub actor: ActorId,
    /// Part of that actor: (actor, part) is the same thing from tick to tick, which flow relies on.
    pub part: u16,
    /// Mesh.
    pub mesh: MeshId,
    /// Pose.
    pub world_from_mesh: Isometry3<f64>,
    /// Tint of `CarPaint` triangles, sRGB.
    pub tint_rgb: [u8; 3],
    /// Lamp bits that shine.
    pub lamps: u32,
    /// Velocity of the mesh origin, m/s, for radar and motion-distorted lidar.
    pub velocity_in_world_mps: Vector3<f64>,
}

impl DynamicInstance {
    /// Actor and part, which identify it from tick to tick.
    pub fn key(&self) -> (u32, u16) {
        (self.actor.0, self.part)
    }
}

/// Where the parts that moved were at the ticks before a scene's.
///
/// What appeared, or was put elsewhere, has no way behind it: at all ticks before that it stands
/// where it appeared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Past {
    /// How long before the scene's time the ticks were, nanoseconds, rising.
    pub ages_nanos: Vec<u64>,
    /// Places in [`Scene::dynamics`] of the parts that moved, rising.
    pub moved: Vec<u32>,
    /// Their poses: for each part one per tick.
    pub poses: Vec<Isometry3<f64>>,
}

/// Direction towards the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector from the ground to the sun, world.
    pub towards: Vector3<f64>,
}

impl Sun {
    /// The direction of the sun in a weather.
    pub fn of(weather: &Weather) -> Sun {
        let (azimuth, altitude) = (
            (weather.sun_azimuth_deg as f64).to_radians(),
            (weather.sun_altitude_deg as f64).to_radians(),
        );
        Sun {
            towards: Vector3::new(
                altitude.cos() * azimuth.cos(),
                altitude.cos() * azimuth.sin(),
                altitude.sin(),
            ),
        }
    }
}

/// A line that is drawn into colour images only; a line without length is a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DebugStroke {
    /// One end, world, metres.
    pub from_m: [f64; 3],
    /// The other end.
    pub to_m: [f64; 3],
    /// Thickness, metres; never thinner than a pixel.
    pub width_m: f32,
    /// sRGB.
    pub color_rgb: [u8; 3],
}

/// A text at a place of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct DebugText {
    /// Where its upper left corner is, world, metres.
    pub at_m: [f64; 3],
    /// The text.
    pub text: String,
    /// sRGB.
    pub color_rgb: [u8; 3],
    /// Whether it has a dark shadow.
    pub shadow: bool,
}

/// What is drawn over the finished colour image of the spectator; nothing hides it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overlay {
    /// Lines between places of the world; their thickness `width_m` is in pixels here.
    pub strokes: Vec<DebugStroke>,
    /// Texts at places of the world.
    pub texts: Vec<DebugText>,
    /// Lines of text in the upper left corner.
    pub panel: Vec<String>,
}

impl Overlay {
    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.strokes.is_empty() && self.texts.is_empty() && self.panel.is_empty()
    }
}

/// Everything that sensors see at the end of one tick.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The tick.
    pub tick: Tick,
    /// Simulated time.
    pub sim_time: SimTime,
    /// Length of this tick.
    pub period_nanos: u64,
    /// What does not move.
    pub assets: Arc<SceneAssets>,
    /// What moves, by rising (actor, part).
    pub dynamics: Vec<DynamicInstance>,
    /// Where it was at the ticks before; empty unless a turning lidar fires.
    pub past: Past,
    /// Weather.
    pub weather: Weather,
    /// Loss of lidar light in the air, 1/m; 0 unless weather is to act on sensors.
    pub lidar_extinction_per_m: f64,
    /// Lines that are drawn into colour images for debugging.
    pub debug: Vec<DebugStroke>,
    /// What only the spectator sees.
    pub overlay: Overlay,
}
