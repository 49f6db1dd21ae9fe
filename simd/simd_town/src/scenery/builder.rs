//! Puts everything that stands still into the scene and gives it ids.

use nalgebra::{Isometry3, Vector3};
use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{MeshId, SceneAssets};

use crate::chunk::{ALL, Chunks, Key, Layer, place};
use crate::elevation::Terrain;
use crate::geometry::{P2, unit};
use crate::ground::Floor;
use crate::kit::{Kit, Lamp};
use crate::network::{Network, Signal, SignalKind};
use crate::object::{LampGroup, MapLayer, SceneryLamp, SceneryObject, measure};
use crate::open_drive::{KERB_HEIGHT_M, facing};
use crate::plan::{Houses, Plan};
use crate::random::Random;
use crate::ring::{Ring, contains, rings};
use crate::town::{CollisionMesh, LightSite};
use crate::{barrier, bridge, building, forest, furniture, gantry, garden, ground, wear};

/// What [`build`] makes.
pub struct Scenery {
    pub assets: SceneAssets,
    pub objects: Vec<SceneryObject>,
    pub lamps: Vec<SceneryLamp>,
    pub lights: Vec<LightSite>,
    pub collision: Vec<CollisionMesh>,
}

/// A scene while it grows.
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
    /// Drives beside houses and the room round them, where nothing else is to stand.
    pub drive_plots_m: Vec<[P2; 4]>,
}

/// Builds the scenery of a network.
pub fn build(plan: &Plan, network: &Network, seed: u64) -> Scenery {
    let rings = rings(network, plan);
    let chunks = Chunks::on(Terrain::build(network, &rings, plan.hills_m));
    let named = |name: &str| CollisionMesh {
        name: name.to_owned(),
        ..CollisionMesh::default()
    };
    let mut b = Builder {
        network,
        plan,
        seed,
        assets: SceneAssets::default(),
        objects: Vec::new(),
        lamps: Vec::new(),
        chunks,
        floor: Floor {
            road: named("road"),
            raised: named("pavement"),
        },
        solid: named("buildings and poles"),
        lights: Vec::new(),
        drive_plots_m: Vec::new(),
    };
    b.streets();
    let kit = Kit::new(plan, &mut b.assets);
    b.blocks(&kit, &rings);
    for road in 0..network.roads.len() {
        b.roadside(&kit, road);
        b.parked(&kit, road);
    }
    for signal in &network.signals {
        b.signal(&kit, signal);
    }
    let Builder {
        mut assets,
        mut objects,
        lamps,
        chunks,
        floor,
        solid,
        lights,
        ..
    } = b;
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

/// Stream of random numbers of the houses.
const LOTS: u64 = 0x71;

impl Builder<'_> {
    /// A new object of no layer.
    pub fn object(&mut self, class: Class, name: &str) -> ObjectId {
        self.object_in(None, class, name)
    }

    /// A new object of a layer.
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

    /// Puts a mesh on the ground, `z_m` over it.
    pub fn stand(
        &mut self,
        mesh: MeshId,
        (layer, class, name): (MapLayer, Class, &str),
        p: P2,
        z_m: f64,
        yaw_rad: f64,
    ) -> ObjectId {
        let object = self.object_in(Some(layer), class, name);
        self.stand_as(object, mesh, p, z_m + self.chunks.terrain.at(p), yaw_rad);
        object
    }

    /// Puts a mesh at a height.
    pub fn stand_as(&mut self, object: ObjectId, mesh: MeshId, p: P2, z_m: f64, yaw_rad: f64) {
        place(
            &mut self.assets,
            mesh,
            Isometry3::new(Vector3::new(p.x, p.y, z_m), Vector3::z() * yaw_rad),
            object,
        );
    }

    /// A street lamp with its switch.
    pub fn lamp(&mut self, lamp: &Lamp, p: P2, z_m: f64, yaw_rad: f64) {
        let object = self.object_in(Some(MapLayer::StreetLights), Class::POLES, "street_lamp");
        self.stand_as(object, lamp.mesh, p, z_m, yaw_rad);
        let light = Isometry3::new(Vector3::new(p.x, p.y, z_m), Vector3::z() * yaw_rad)
            * nalgebra::Point3::from(lamp.light_m);
        self.lamps.push(SceneryLamp {
            object,
            position_m: light.coords.into(),
            rgb: [255, 226, 178],
            intensity_lm: lamp.intensity_lm,
            group: LampGroup::Street,
        });
        self.pole_at(object, p, z_m, 0.1, lamp.height_m);
    }

    /// A lamp below a tunnel's ceiling.
    fn tunnel_lamp(&mut self, corners_m: &[[f64; 3]; 4]) {
        let object = self.object(Class::BUILDINGS, "tunnel_lamp");
        let rgb = [255, 232, 190];
        let key = Key::at(Layer::Building, P2::new(corners_m[0][0], corners_m[0][1]));
        self.chunks.polygon(
            key,
            ALL,
            Surface::lamp(Class::BUILDINGS, rgb, 0).of(object),
            corners_m,
            &[[0.0; 2]; 4],
        );
        let position_m =
            std::array::from_fn(|i| 0.25 * corners_m.iter().map(|corner| corner[i]).sum::<f64>());
        self.lamps.push(SceneryLamp {
            object,
            position_m,
            rgb,
            intensity_lm: 3000.0,
            group: LampGroup::Other,
        });
    }

    /// A solid pole on the ground.
    pub fn pole_solid(&mut self, object: ObjectId, p: P2, radius_m: f64, height_m: f64) {
        let z = self.chunks.terrain.at(p);
        self.pole_at(object, p, z, radius_m, height_m);
    }

    fn pole_at(&mut self, object: ObjectId, p: P2, z_m: f64, radius_m: f64, height_m: f64) {
        let ring: Vec<P2> = (0..6)
            .map(|k| p + unit(std::f64::consts::TAU * k as f64 / 6.0) * radius_m)
            .collect();
        building::box_solid(&mut self.solid, object, &ring, (z_m - 0.1, z_m + height_m));
    }

    fn streets(&mut self) {
        let network = self.network;
        // Streets first: their objects count as their roads do.
        for road in &network.roads {
            let object = self.object(Class::ROADS, "street");
            ground::road(&mut self.chunks, &mut self.floor, network, road, object);
            wear::road(&mut self.chunks, self.seed, road);
        }
        for road in &network.roads {
            if road.bridge.is_some() {
                let object = self.object(Class::BRIDGE, "bridge");
                bridge::build(&mut self.chunks, &mut self.solid, network, road, object);
            }
            if road.tunnel {
                let object = self.object(Class::BUILDINGS, "tunnel");
                for corners in barrier::tunnel(&mut self.chunks, &mut self.solid, road, object) {
                    self.tunnel_lamp(&corners);
                }
            }
            if road.profile.has_rails() {
                let object = self.object(Class::GUARD_RAIL, "guard_rail");
                barrier::rails(&mut self.chunks, &mut self.solid, road, object);
            }
            if road.profile.motorway {
                gantry::build(self, road);
            }
        }
        for idx in 0..network.junctions.len() {
            let object = self.object(Class::ROADS, "junction");
            ground::junction(&mut self.chunks, &mut self.floor, network, idx, object);
        }
    }

    fn blocks(&mut self, kit: &Kit, rings: &[Ring]) {
        for (i, ring) in rings.iter().enumerate() {
            let object = self.object(Class::SIDEWALKS, "pavement");
            ground::pavement(&mut self.chunks, &mut self.floor, ring, object);
            let park =
                !ring.outside && self.plan.parks_m.iter().any(|&p| contains(&ring.kerb_m, p));
            let open =
                ring.fronted.iter().filter(|&&fronted| !fronted).count() * 2 > ring.fronted.len();
            let green = park
                || open
                || ring.outside
                || matches!(self.plan.houses, Houses::Cottages | Houses::Farms);
            let (layer, class) = if green {
                (None, Class::TERRAIN)
            } else {
                (Some(MapLayer::Ground), Class::GROUND)
            };
            let object = self.object_in(layer, class, "block");
            ground::block(&mut self.chunks, &mut self.floor, ring, green, object);
            for pond in &ring.ponds {
                let object = self.object(Class::WATER, "pond");
                ground::pond(&mut self.chunks, pond, object);
            }
            if ring.outside {
                forest::build(self, &ring.back_m);
            }
            if park {
                self.park(kit, ring);
            } else {
                self.houses(kit, ring, i);
            }
        }
    }

    fn houses(&mut self, kit: &Kit, ring: &Ring, idx: usize) {
        let mut random = Random::new(self.seed, LOTS, idx as u64);
        let houses = match self.plan.houses {
            Houses::Towers { .. } if ring.outside => Houses::Towers { within_m: 0.0 },
            Houses::Cottages if ring.outside => Houses::Farms,
            _ if !ring.outside
                && self
                    .plan
                    .cottages_m
                    .iter()
                    .any(|&p| contains(&ring.kerb_m, p)) =>
            {
                Houses::Cottages
            }
            other => other,
        };
        let mut lots = building::lots(ring, houses, &mut random);
        lots.retain(|lot| {
            let f = &lot.footprint_m;
            (0..4).all(|i| {
                self.is_free(f[i], 3.0) && self.is_free(0.5 * (f[i] + f[(i + 1) % 4]), 3.0)
            })
        });
        let mut built = Vec::new();
        for lot in &lots {
            let object = self.object_in(Some(MapLayer::Buildings), Class::BUILDINGS, "building");
            let height_m = building::build(
                &mut self.chunks,
                &mut self.solid,
                lot,
                houses,
                object,
                &mut random,
            );
            let middle = lot.footprint_m.iter().sum::<P2>() / 4.0;
            let ground_m = self.chunks.terrain.at(middle);
            self.lamps.push(SceneryLamp::windows(
                object,
                [middle.x, middle.y, ground_m + 0.5 * height_m],
            ));
            built.push(object);
        }
        if matches!(houses, Houses::Cottages | Houses::Farms) {
            for (lot, house) in lots.iter().zip(built) {
                garden::build(self, lot, house, houses, &mut random);
            }
            let front_m = if houses == Houses::Farms { 5.4 } else { 3.1 };
            let drives = self.drives(kit, ring, idx, &lots, front_m);
            lots.extend(drives);
        }
        self.green_gaps(kit, ring, &lots, &mut random);
    }

    /// No tunnel, bridge or pond is at this place or near it.
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
        !in_tunnel && !in_pond && !bridge::is_near(self.network, p, margin_m)
    }

    /// A drive is at this place.
    pub fn is_on_drive(&self, p: P2) -> bool {
        self.drive_plots_m.iter().any(|plot| contains(plot, p))
    }

    fn signal(&mut self, kit: &Kit, signal: &Signal) {
        let road = &self.network.roads[signal.road];
        let foot = road.path.beside(signal.pole_s_m, signal.t_m);
        let yaw = facing(road.path.at(signal.pole_s_m).1, signal.against);
        let z = KERB_HEIGHT_M + road.elevation.at(signal.pole_s_m);
        if signal.kind != SignalKind::Light {
            let mesh = kit
                .signs
                .iter()
                .find(|(kind, _)| *kind == signal.kind)
                .expect("the kit has every sign that networks place")
                .1;
            let object = self.object(Class::TRAFFIC_SIGNS, "traffic_sign");
            self.stand_as(object, mesh, foot, z, yaw);
            self.pole_at(object, foot, z, 0.09, 2.6);
            return;
        }
        let wide = road.profile.main;
        let object = self.object(Class::POLES, "traffic_light_pole");
        self.stand_as(object, kit.poles[usize::from(wide)], foot, z, yaw);
        self.pole_at(object, foot, z, 0.09, 2.6);
        let pole = Isometry3::new(Vector3::new(foot.x, foot.y, z), Vector3::z() * yaw);
        let head = |y: f64, z: f64| pole * Isometry3::translation(0.2, y, z);
        let mut heads = vec![head(0.0, furniture::HEADS_M.0)];
        if wide {
            heads.push(head(-4.6, furniture::HEADS_M.1 - 0.45));
        }
        self.lights.push(LightSite {
            signal_id: signal.id.to_string(),
            pole: pole.into(),
            heads,
        });
    }
}
