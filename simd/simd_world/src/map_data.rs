//! What the world needs of a map: roads, solid ground, spawn points, traffic lights.

use std::sync::Arc;

use nalgebra::Isometry3;
use schema_roads::RoadMap;
use schema_types::{Class, ObjectId, Pose};
use sensor_core::Mesh;
use simd_town::{SceneryLamp, SceneryObject};

use crate::errors::NoRoom;

/// Solid triangles, `f32` about [`MapData::origin_m`].
#[derive(Clone, Debug, Default)]
pub struct CollisionMesh {
    /// Corners, metres about the origin.
    pub vertices_m: Vec<[f32; 3]>,
    /// Three corners per triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Class that collisions report; [`Class::UNLABELED`] if the mesh is of several kinds.
    pub class: Class,
}

/// Where the lamp heads of one OpenDRIVE signal hang.
#[derive(Clone, Debug)]
pub struct LightHeads {
    /// Id of the signal in the OpenDRIVE text.
    pub signal_id: String,
    /// World poses of the heads; x points towards the traffic that must obey.
    pub heads: Vec<Isometry3<f64>>,
}

/// A map as the world loads it.
#[derive(Clone, Debug, Default)]
pub struct MapData {
    /// Name, e.g. `Town10HD`.
    pub name: String,
    /// OpenDRIVE text; empty for a ground without roads.
    pub open_drive: String,
    /// Origin of the collision meshes and of the physics engine's `f32` coordinates: in the world,
    /// metres.
    pub origin_m: [f64; 3],
    /// What vehicles drive on and run into.
    pub collision: Vec<CollisionMesh>,
    /// Scenery object of every triangle, by mesh of `collision`; empty for meshes that cannot be
    /// hidden.
    pub collision_objects: Vec<Vec<ObjectId>>,
    /// Objects that can be listed and hidden.
    pub objects: Vec<SceneryObject>,
    /// Lamps that can be switched.
    pub lamps: Vec<SceneryLamp>,
    /// Where vehicles may be put, x along the lane.
    pub spawn_points: Vec<Pose>,
    /// Lamp heads per signal; a light without an entry has no visible heads.
    pub lights: Vec<LightHeads>,
    /// A head with lamps 0 red, 1 yellow, 2 green.
    pub light_head: Mesh,
    /// What `open_drive` says, if it has been read already; otherwise the world reads it when it
    /// loads the map.
    pub roads: Option<Arc<RoadMap>>,
    /// Whether a vehicle's limit is that of the last speed-limit sign it passed, as on CARLA's
    /// server; otherwise, and on maps without such signs, it is the limit of its lane.
    pub signs_post_limits: bool,
}

/// Why a map could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The OpenDRIVE text cannot be used.
    #[error("cannot load map {map:?}: {source}")]
    Roads {
        /// Map name.
        map: String,
        /// What is wrong with the text.
        source: schema_roads::MapError,
    },
    /// It brings more actors than a world can have.
    #[error("cannot load map {map:?}: it has {n_signals} traffic lights and signs, and {source}")]
    Actors {
        /// Map name.
        map: String,
        /// Its lights and signs.
        n_signals: usize,
        /// Of what there is too much.
        source: NoRoom,
    },
    /// A collision mesh cannot be used.
    #[error("cannot load map {map:?}: collision mesh {mesh_idx} {reason}")]
    Collision {
        /// Map name.
        map: String,
        /// Which mesh.
        mesh_idx: usize,
        /// What is wrong with it.
        reason: String,
    },
}

impl MapData {
    /// The map's roads: those in `roads`, or else parsed from the OpenDRIVE text; `None` without a
    /// text.
    pub(crate) fn read_roads(&self) -> Result<Option<Arc<RoadMap>>, LoadError> {
        match (&self.roads, self.open_drive.as_str()) {
            (Some(roads), _) => Ok(Some(roads.clone())),
            (None, "") => Ok(None),
            (None, text) => match RoadMap::parse(text) {
                Ok(roads) => Ok(Some(Arc::new(roads))),
                Err(source) => Err(LoadError::Roads {
                    map: self.name.clone(),
                    source,
                }),
            },
        }
    }

    /// A level square at height 0 without roads, `half_m` in each direction, with spawn points 12 m
    /// apart along x.
    pub fn flat(half_m: f32) -> MapData {
        let corner = |x: f32, y: f32| [x * half_m, y * half_m, 0.0];
        let spawn_points = (0..200).map(|i| {
            Pose::from_xyz_yaw(
                -100.0 + 12.0 * (i % 20) as f64,
                12.0 * (i / 20) as f64,
                0.3,
                0.0,
            )
        });
        MapData {
            name: "flat".to_owned(),
            collision: vec![CollisionMesh {
                vertices_m: vec![
                    corner(-1.0, -1.0),
                    corner(1.0, -1.0),
                    corner(1.0, 1.0),
                    corner(-1.0, 1.0),
                ],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                class: Class::GROUND,
            }],
            spawn_points: spawn_points.collect(),
            ..MapData::default()
        }
    }
}

impl MapData {
    /// A town whose text has been read.
    pub fn of_town(town: &simd_town::Town, roads: Arc<RoadMap>) -> MapData {
        MapData {
            roads: Some(roads),
            ..MapData::from(town)
        }
    }
}

impl MapData {
    /// A town that was made from somebody's map, on which signs post the speed limits.
    pub fn of_import(town: &simd_town::Town, roads: Arc<RoadMap>) -> MapData {
        MapData {
            signs_post_limits: true,
            ..MapData::of_town(town, roads)
        }
    }
}

impl MapData {
    /// Scenery object of every triangle of a mesh, or nothing if they are not known.
    pub(crate) fn objects_of(&self, mesh_idx: usize) -> Option<&[ObjectId]> {
        let objects = self.collision_objects.get(mesh_idx)?;
        let is_complete = objects.len() == self.collision.get(mesh_idx)?.triangles.len();
        is_complete.then_some(objects.as_slice())
    }
}

impl From<&simd_town::Town> for MapData {
    fn from(town: &simd_town::Town) -> MapData {
        let solid = |mesh: &simd_town::CollisionMesh| CollisionMesh {
            vertices_m: mesh.vertices_m.clone(),
            triangles: mesh.triangles.clone(),
            class: match mesh.name.as_str() {
                "road" => Class::ROADS,
                "pavement" => Class::SIDEWALKS,
                _ => Class::UNLABELED,
            },
        };
        let heads = |site: &simd_town::LightSite| LightHeads {
            signal_id: site.signal_id.clone(),
            heads: site.heads.clone(),
        };
        MapData {
            name: town.name.clone(),
            open_drive: town.open_drive.clone(),
            origin_m: town.origin_m,
            collision: town.collision.iter().map(solid).collect(),
            collision_objects: town
                .collision
                .iter()
                .map(|mesh| mesh.objects.clone())
                .collect(),
            objects: town.objects.clone(),
            lamps: town.lamps.clone(),
            spawn_points: town.spawn_points.clone(),
            lights: town.lights.iter().map(heads).collect(),
            light_head: town.light_head.clone(),
            roads: None,
            signs_post_limits: false,
        }
    }
}
