//! An imported world under construction: meshes by cell, solids, objects with ids, and what
//! builders ask about.

use nalgebra::{Isometry3, Vector3};
use schema_roads::RoadMap;
use schema_types::{Class, ObjectId};
use sensor_core::{MeshId, SceneAssets};

use super::cover::Cover;
use super::height_grid::HeightGrid;
use super::options::ImportOptions;
use crate::geometry::{P2, unit};
use crate::scenery::{
    Chunks, CollisionMesh, LampGroup, LightSite, MapLayer, SceneryLamp, SceneryObject, measure,
    place,
};

/// Place of a street lamp's light: distance along its arm, and height over its foot.
const LIGHT_M: (f64, f64) = (1.75, 7.95);

/// Least room between a post that vehicles run into and a lane on which they drive, metres.
const POST_ROOM_M: f64 = 0.1;

/// A world under construction, in coordinates about its origin.
pub(super) struct ImportBuilder<'m> {
    pub roads: &'m RoadMap,
    pub origin: Vector3<f64>,
    pub seed: u64,
    pub options: ImportOptions,
    pub cover: Cover,
    pub ground: HeightGrid,
    pub assets: SceneAssets,
    pub objects: Vec<SceneryObject>,
    pub chunks: Chunks,
    /// Lanes for vehicles.
    pub road: CollisionMesh,
    /// Everything else that vehicles drive on: pavements, embankments, ground.
    pub raised: CollisionMesh,
    /// Everything that vehicles run into.
    pub solid: CollisionMesh,
    pub lights: Vec<LightSite>,
    pub lamps: Vec<SceneryLamp>,
}

/// The finished parts of a world.
pub(super) struct Parts {
    pub assets: SceneAssets,
    pub objects: Vec<SceneryObject>,
    pub lights: Vec<LightSite>,
    pub lamps: Vec<SceneryLamp>,
    pub collision: Vec<CollisionMesh>,
}

impl<'m> ImportBuilder<'m> {
    pub fn new(
        roads: &'m RoadMap,
        origin: Vector3<f64>,
        seed: u64,
        options: ImportOptions,
        cover: Cover,
        ground: HeightGrid,
    ) -> ImportBuilder<'m> {
        let mesh = |what: &str| CollisionMesh {
            name: what.to_owned(),
            ..CollisionMesh::default()
        };
        let chunks = Chunks::on(ground.terrain());
        ImportBuilder {
            roads,
            origin,
            seed,
            options,
            cover,
            ground,
            assets: SceneAssets::default(),
            objects: Vec::new(),
            chunks,
            road: mesh("road"),
            raised: mesh("pavement"),
            solid: mesh("buildings and poles"),
            lights: Vec::new(),
            lamps: Vec::new(),
        }
    }

    /// A new object with an id of its own; its name gets a number.
    pub fn object(&mut self, class: Class, name: &str) -> ObjectId {
        let number = 1 + self.objects.len() as u32;
        let id = ObjectId::scenery(number);
        self.objects.push(SceneryObject::new(
            id,
            class,
            format!("{name}_{number}"),
            layer_of(class),
        ));
        id
    }

    /// Adds an instance of a shared mesh as a new object.
    pub fn stand(
        &mut self,
        mesh: MeshId,
        class: Class,
        name: &str,
        at: [f64; 3],
        yaw_rad: f64,
    ) -> ObjectId {
        let object = self.object(class, name);
        place(
            &mut self.assets,
            mesh,
            Isometry3::new(Vector3::from(at), Vector3::z() * yaw_rad),
            object,
        );
        object
    }

    /// Adds a street lamp; its arm reaches towards `yaw_rad`.
    pub fn street_lamp(&mut self, mesh: MeshId, name: &str, at: [f64; 3], yaw_rad: f64) {
        let object = self.stand(mesh, Class::POLES, name, at, yaw_rad);
        if let Some(lamp) = self.objects.last_mut() {
            lamp.layer = Some(MapLayer::StreetLights);
        }
        self.post(object, at, 0.1, 7.0);
        let light = P2::new(at[0], at[1]) + unit(yaw_rad) * LIGHT_M.0;
        let position_m = [light.x, light.y, at[2] + LIGHT_M.1];
        self.lamps.push(SceneryLamp {
            object,
            position_m,
            rgb: [255, 226, 178],
            intensity_lm: 6500.0,
            group: LampGroup::Street,
        });
    }

    /// Adds a round post to the solids, unless a file puts it where vehicles drive.
    pub fn post(&mut self, object: ObjectId, at: [f64; 3], radius_m: f64, height_m: f64) {
        let beside_m = radius_m + POST_ROOM_M;
        if self.cover.vehicles_near(P2::new(at[0], at[1]), beside_m) {
            return;
        }
        let ring: Vec<P2> = (0..6)
            .map(|k| {
                P2::new(at[0], at[1]) + unit(std::f64::consts::TAU * f64::from(k) / 6.0) * radius_m
            })
            .collect();
        self.solid
            .prism(object, &ring, (at[2] - 0.1, at[2] + height_m));
    }

    /// A world point in coordinates about the origin.
    pub fn local(&self, p: [f64; 3]) -> [f64; 3] {
        (Vector3::from(p) - self.origin).into()
    }

    /// A world pose in coordinates about the origin.
    pub fn local_pose(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(
            (pose.translation.vector - self.origin).into(),
            pose.rotation,
        )
    }

    /// Height on which something beside the road stands: that of the lane there, otherwise of the
    /// ground.
    pub fn floor(&self, p: P2) -> f64 {
        self.cover.height_at(p).unwrap_or_else(|| self.ground.at(p))
    }

    pub fn finish(self) -> Parts {
        let ImportBuilder {
            mut assets,
            mut objects,
            chunks,
            road,
            raised,
            solid,
            lights,
            lamps,
            ..
        } = self;
        chunks.finish(&mut assets);
        measure(&mut objects, &assets);
        Parts {
            assets,
            objects,
            lights,
            lamps,
            collision: vec![road, raised, solid],
        }
    }
}

/// The layer that things of a class belong to, if they can be hidden.
fn layer_of(class: Class) -> Option<MapLayer> {
    match class {
        Class::BUILDINGS => Some(MapLayer::Buildings),
        Class::VEGETATION => Some(MapLayer::Foliage),
        Class::WALLS | Class::FENCES => Some(MapLayer::Walls),
        Class::STATIC | Class::DYNAMIC => Some(MapLayer::Props),
        _ => None,
    }
}
