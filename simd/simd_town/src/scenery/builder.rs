//! The scenery of a town under construction: builders add objects to it and ask it what is free.

use nalgebra::{Isometry3, Vector3};
use schema_types::{Class, ObjectId};
use sensor_core::{MeshId, SceneAssets};

use super::chunk::{Chunks, place};
use super::collision::{CollisionMesh, Floor};
use super::lamp::{LightSite, SceneryLamp};
use super::object::{MapLayer, SceneryObject, measure};
use super::terrain::Terrain;
use crate::geometry::{P2, contains, unit};
use crate::network::Network;
use crate::plan::Plan;

/// What a mesh that is placed is.
#[derive(Clone, Copy, Debug)]
pub struct Standing<'a> {
    pub layer: MapLayer,
    pub class: Class,
    /// Name of its kind; a number follows.
    pub name: &'a str,
}

/// A town's scenery under construction.
pub struct Builder<'a> {
    pub network: &'a Network,
    pub plan: &'a Plan,
    pub seed: u64,
    pub assets: SceneAssets,
    pub objects: Vec<SceneryObject>,
    pub lamps: Vec<SceneryLamp>,
    pub chunks: Chunks,
    pub floor: Floor,
    pub solid: CollisionMesh,
    pub lights: Vec<LightSite>,
    /// Driveways beside houses with the room round them, where nothing else may stand.
    pub driveway_plots_m: Vec<[P2; 4]>,
}

/// The finished scenery.
pub struct Scenery {
    pub assets: SceneAssets,
    pub objects: Vec<SceneryObject>,
    pub lamps: Vec<SceneryLamp>,
    pub lights: Vec<LightSite>,
    pub collision: Vec<CollisionMesh>,
}

impl<'a> Builder<'a> {
    /// An empty collection on this ground.
    pub fn new(plan: &'a Plan, network: &'a Network, seed: u64, terrain: Terrain) -> Builder<'a> {
        let named = |name: &str| CollisionMesh {
            name: name.to_owned(),
            ..CollisionMesh::default()
        };
        Builder {
            network,
            plan,
            seed,
            assets: SceneAssets::default(),
            objects: Vec::new(),
            lamps: Vec::new(),
            chunks: Chunks::on(terrain),
            floor: Floor {
                road: named("road"),
                raised: named("pavement"),
            },
            solid: named("buildings and poles"),
            lights: Vec::new(),
            driveway_plots_m: Vec::new(),
        }
    }

    /// Turns the cells into meshes and measures the objects.
    pub fn finish(self) -> Scenery {
        let Builder {
            mut assets,
            mut objects,
            lamps,
            chunks,
            floor,
            solid,
            lights,
            ..
        } = self;
        chunks.finish(&mut assets);
        measure(&mut objects, &assets);
        Scenery {
            assets,
            objects,
            lamps,
            lights,
            collision: vec![floor.road, floor.raised, solid],
        }
    }

    /// Adds an object that belongs to no layer.
    pub fn object(&mut self, class: Class, name: &str) -> ObjectId {
        self.object_in(None, class, name)
    }

    /// Adds an object of a layer.
    pub fn object_in(&mut self, layer: Option<MapLayer>, class: Class, name: &str) -> ObjectId {
        let number = 1 + self.objects.len() as u32;
        let id = ObjectId::scenery(number);
        self.objects.push(SceneryObject::new(
            id,
            class,
            format!("{name}_{number}"),
            layer,
        ));
        id
    }

    /// Places a mesh as a new object, `z_m` over the ground.
    pub fn stand(
        &mut self,
        mesh: MeshId,
        what: Standing<'_>,
        p: P2,
        z_m: f64,
        yaw_rad: f64,
    ) -> ObjectId {
        let object = self.object_in(Some(what.layer), what.class, what.name);
        self.stand_as(object, mesh, p, z_m + self.chunks.terrain.at(p), yaw_rad);
        object
    }

    /// Places a mesh at a height as an existing object.
    pub fn stand_as(&mut self, object: ObjectId, mesh: MeshId, p: P2, z_m: f64, yaw_rad: f64) {
        place(
            &mut self.assets,
            mesh,
            Isometry3::new(Vector3::new(p.x, p.y, z_m), Vector3::z() * yaw_rad),
            object,
        );
    }

    /// Adds a pole on the ground to the solids.
    pub fn pole_solid(&mut self, object: ObjectId, p: P2, radius_m: f64, height_m: f64) {
        let z = self.chunks.terrain.at(p);
        self.pole_at(object, p, z, radius_m, height_m);
    }

    /// Adds a pole to the solids; its foot is at `z_m`.
    pub fn pole_at(&mut self, object: ObjectId, p: P2, z_m: f64, radius_m: f64, height_m: f64) {
        let ring: Vec<P2> = (0..6)
            .map(|k| p + unit(std::f64::consts::TAU * k as f64 / 6.0) * radius_m)
            .collect();
        self.solid.prism(object, &ring, (z_m - 0.1, z_m + height_m));
    }

    /// Whether no tunnel, bridge or pond is at this place or near it.
    pub fn is_free(&self, p: P2, margin_m: f64) -> bool {
        let in_tunnel = self
            .network
            .roads
            .iter()
            .filter(|road| road.tunnel)
            .any(|road| road.path.nearest(p).1 < road.profile.back_m() + 6.0);
        let in_pond = self
            .plan
            .ponds_m
            .iter()
            .any(|(middle, radius)| (p - middle).norm() < radius + 2.0 + margin_m);
        !in_tunnel && !in_pond && !self.network.is_near_bridge(p, margin_m)
    }

    /// Whether a driveway is at this place.
    pub fn is_on_driveway(&self, p: P2) -> bool {
        self.driveway_plots_m.iter().any(|plot| contains(plot, p))
    }
}
