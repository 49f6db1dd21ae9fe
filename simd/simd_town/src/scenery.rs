//! Puts everything that stands still into the scene and gives it ids.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Vector3};
use schema_types::{Class, ObjectId};
use sensor_core::{Mesh, MeshId, SceneAssets};

use crate::building::Lot;
use crate::chunk::{Chunks, place};
use crate::elevation::Terrain;
use crate::geometry::{P2, heading, left, unit};
use crate::ground::{BAYS_M, Floor, n_bays};
use crate::network::{Network, Road, Signal, SignalKind};
use crate::open_drive::{KERB_HEIGHT_M, facing};
use crate::plan::{Edge, Houses, Plan};
use crate::random::Random;
use crate::ring::{Ring, contains, rings};
use crate::town::{CollisionMesh, LightSite, SceneryObject};
use crate::vehicle::{BodyStyle, VehicleShape, vehicle_meshes};
use crate::{barrier, building, furniture, greenery, ground};

/// What [`build`] makes.
pub struct Scenery {
    pub assets: SceneAssets,
    pub objects: Vec<SceneryObject>,
    pub lights: Vec<LightSite>,
    pub collision: Vec<CollisionMesh>,
}

struct Builder<'a> {
    network: &'a Network,
    seed: u64,
    assets: SceneAssets,
    objects: Vec<SceneryObject>,
    chunks: Chunks,
    floor: Floor,
    solid: CollisionMesh,
    lights: Vec<LightSite>,
}

/// Builds the scenery of a network.
pub fn build(plan: &Plan, network: &Network, seed: u64) -> Scenery {
    let rings = rings(network);
    let chunks = Chunks::on(Terrain::build(network, &rings, plan.hills_m));
    let mut b = Builder {
        network,
        seed,
        assets: SceneAssets::default(),
        objects: Vec::new(),
        chunks,
        floor: Floor::default(),
        solid: CollisionMesh { name: "buildings and poles".to_owned(), ..CollisionMesh::default() },
        lights: Vec::new(),
    };
    b.floor.road.name = "road".to_owned();
    b.floor.raised.name = "pavement".to_owned();
    b.streets();
    let kit = Kit::new(plan, &mut b.assets);
    b.blocks(plan, &kit, &rings);
    for road in 0..network.roads.len() {
        b.roadside(&kit, road);
        b.parked(&kit, road);
    }
    for signal in &network.signals {
        b.signal(&kit, signal);
    }
    let Builder { mut assets, objects, chunks, floor, solid, lights, .. } = b;
    chunks.finish(&mut assets);
    Scenery { assets, objects, lights, collision: vec![floor.road, floor.raised, solid] }
}

/// Meshes that stand in many places.
struct Kit {
    trees: Vec<MeshId>,
    bush: MeshId,
    lamp: MeshId,
    bench: MeshId,
    bin: MeshId,
    bollard: MeshId,
    shelter: MeshId,
    poles: [MeshId; 2],
    signs: Vec<(SignalKind, MeshId)>,
    cars: Vec<(MeshId, VehicleShape)>,
}

impl Kit {
    fn new(plan: &Plan, assets: &mut SceneAssets) -> Kit {
        let limits: BTreeSet<u32> = plan.streets.iter().map(|street| street.profile.speed_kmh).collect();
        let signs = [SignalKind::Stop, SignalKind::Yield].into_iter().chain(limits.into_iter().map(SignalKind::Limit));
        Kit {
            trees: (0..greenery::N_KINDS).map(|kind| assets.add_mesh(greenery::tree(kind))).collect(),
            bush: assets.add_mesh(greenery::bush()),
            lamp: assets.add_mesh(furniture::street_lamp()),
            bench: assets.add_mesh(furniture::bench()),
            bin: assets.add_mesh(furniture::bin()),
            bollard: assets.add_mesh(furniture::bollard()),
            shelter: assets.add_mesh(furniture::shelter()),
            poles: [0.0, 5.0].map(|arm_m| assets.add_mesh(furniture::light_pole(arm_m))),
            signs: signs.map(|kind| (kind, assets.add_mesh(furniture::sign(kind)))).collect(),
            cars: PARKED.iter().map(|&(shape, rgb)| (assets.add_mesh(parked_car(&shape, rgb)), shape)).collect(),
        }
    }
}

const fn shape(style: BodyStyle, half_m: [f64; 3], wheel_radius_m: f64, wheelbase_m: f64) -> VehicleShape {
    VehicleShape { style, half_m, wheel_radius_m, wheelbase_m }
}
const PARKED_SALOON: VehicleShape = shape(BodyStyle::Saloon, [2.35, 1.0, 0.73], 0.325, 2.78);
const PARKED_HATCH: VehicleShape = shape(BodyStyle::Hatch, [1.98, 0.98, 0.755], 0.31, 2.50);
const PARKED_SUV: VehicleShape = shape(BodyStyle::Suv, [2.25, 1.02, 0.845], 0.36, 2.72);
const PARKED_VAN: VehicleShape = shape(BodyStyle::Van, [2.55, 1.05, 1.0], 0.34, 3.2);
const PARKED: [(VehicleShape, [u8; 3]); 10] = [
    (PARKED_SALOON, [198, 200, 204]),
    (PARKED_SALOON, [28, 30, 34]),
    (PARKED_SALOON, [30, 52, 96]),
    (PARKED_HATCH, [168, 28, 30]),
    (PARKED_HATCH, [236, 236, 234]),
    (PARKED_HATCH, [92, 128, 150]),
    (PARKED_SUV, [60, 64, 68]),
    (PARKED_SUV, [222, 222, 218]),
    (PARKED_SUV, [70, 84, 66]),
    (PARKED_VAN, [232, 232, 230]),
];

/// Body and wheels of a parked car in one mesh, tinted.
fn parked_car(shape: &VehicleShape, rgb: [u8; 3]) -> Mesh {
    let parts = vehicle_meshes(shape);
    let mut car = Mesh { name: format!("parked {:?}", shape.style).to_lowercase(), ..Mesh::default() };
    for level in 0..3 {
        let first_idx = car.indices.len() as u32;
        append(&mut car, &parts.body, level, &Isometry3::identity());
        for site in &parts.wheels {
            let turn = Vector3::z() * if site.left { std::f64::consts::PI } else { 0.0 };
            append(&mut car, &parts.wheel, level, &Isometry3::new(Vector3::from(site.centre_m), turn));
        }
        let n_indices = car.indices.len() as u32 - first_idx;
        car.lods.push(sensor_core::Lod { first_idx, n_indices, until_m: [10.0, 20.0, 200.0][level] });
    }
    for vertex in &mut car.vertices {
        if vertex.material == sensor_core::Material::CarPaint as u8 {
            vertex.color = std::array::from_fn(|i| if i < 3 { (u16::from(vertex.color[i]) * u16::from(rgb[i]) / 255) as u8 } else { 255 });
        }
    }
    crate::chunk::bound(&mut car);
    car
}

fn append(to: &mut Mesh, from: &Mesh, level: usize, pose: &Isometry3<f64>) {
    let lod = from.lods[level];
    let range = lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize;
    let pose: Isometry3<f32> = nalgebra::convert(*pose);
    for &i in &from.indices[range] {
        let mut vertex = from.vertices[i as usize];
        vertex.position_m = (pose * nalgebra::Point3::from(vertex.position_m)).coords.into();
        let normal = Vector3::new(vertex.normal[0], vertex.normal[1], vertex.normal[2]).map(f32::from);
        let turned = pose.rotation * normal;
        vertex.normal = [turned.x.round() as i8, turned.y.round() as i8, turned.z.round() as i8, 0];
        to.indices.push(to.vertices.len() as u32);
        to.vertices.push(vertex);
    }
}

/// Streams of random numbers.
const LOTS: u64 = 0x71;
const ROADSIDE: u64 = 0x72;
const PARKING: u64 = 0x73;
const PARK: u64 = 0x74;

impl Builder<'_> {
    fn object(&mut self, class: Class, name: impl Into<String>) -> ObjectId {
        let id = ObjectId::scenery(1 + self.objects.len() as u32);
        self.objects.push(SceneryObject { id, class, name: name.into() });
        id
    }

    fn stand(&mut self, mesh: MeshId, class: Class, name: &str, p: P2, z_m: f64, yaw_rad: f64) {
        let object = self.object(class, name);
        let z = z_m + self.chunks.terrain.at(p);
        place(&mut self.assets, mesh, Isometry3::new(Vector3::new(p.x, p.y, z), Vector3::z() * yaw_rad), object);
    }

    fn streets(&mut self) {
        for road in &self.network.roads {
            let object = self.object(Class::ROADS, format!("street {}", road.id));
            ground::road(&mut self.chunks, &mut self.floor, self.network, road, object);
            if road.tunnel {
                let object = self.object(Class::BUILDINGS, "tunnel");
                barrier::tunnel(&mut self.chunks, &mut self.solid, road, object);
            }
            if road.profile.has_rails() {
                let object = self.object(Class::GUARD_RAIL, "guard rail");
                barrier::rails(&mut self.chunks, &mut self.solid, road, object);
            }
        }
        for idx in 0..self.network.junctions.len() {
            let object = self.object(Class::ROADS, format!("junction {}", self.network.junctions[idx].id));
            ground::junction(&mut self.chunks, &mut self.floor, self.network, idx, object);
        }
    }

    fn blocks(&mut self, plan: &Plan, kit: &Kit, rings: &[Ring]) {
        for (i, ring) in rings.iter().enumerate() {
            let object = self.object(Class::SIDEWALKS, format!("pavement {i}"));
            ground::pavement(&mut self.chunks, &mut self.floor, ring, object);
            let park = !ring.outside && plan.parks_m.iter().any(|&p| contains(&ring.kerb_m, p));
            let green = park || matches!(plan.houses, Houses::Cottages | Houses::Farms);
            let object = self.object(if green || ring.outside { Class::TERRAIN } else { Class::GROUND }, format!("block {i}"));
            if ring.outside {
                ground::outside(&mut self.chunks, &mut self.floor, ring, object);
            } else {
                ground::inside(&mut self.chunks, &mut self.floor, ring, green, object);
            }
            let mut random = Random::new(self.seed, LOTS, i as u64);
            if park {
                self.park(kit, ring);
            } else {
                let houses = match plan.houses {
                    Houses::Towers { .. } if ring.outside => Houses::Towers { within_m: 0.0 },
                    Houses::Cottages if ring.outside => Houses::Farms,
                    other => other,
                };
                let mut lots = building::lots(ring, houses, &mut random);
                lots.retain(|lot| {
                    let f = &lot.footprint_m;
                    !(0..4).any(|i| self.at_tunnel(f[i]) || self.at_tunnel(0.5 * (f[i] + f[(i + 1) % 4])))
                });
                for lot in &lots {
                    let object = self.object(Class::BUILDINGS, "building");
                    building::build(&mut self.chunks, &mut self.solid, lot, houses, object, &mut random);
                }
                self.green_gaps(kit, ring, &lots, &mut random);
            }
        }
    }

    /// Trees where houses left room: in corners and yards, and in a belt round the town.
    fn green_gaps(&mut self, kit: &Kit, ring: &Ring, lots: &[Lot], random: &mut Random) {
        let n = ring.back_m.len();
        let wanted = if ring.outside { 160 } else { 7 };
        let mut spots: Vec<P2> = Vec::new();
        for _ in 0..wanted * 12 {
            let i = random.below(n);
            let (a, b) = (ring.back_m[i], ring.back_m[(i + 1) % n]);
            if (b - a).norm() < 1e-3 {
                continue;
            }
            let deep = if ring.outside { random.between(2.5, 90.0) } else { random.between(2.2, 9.0) };
            let p = a + (b - a) * random.unit() + left((b - a).normalize()) * deep;
            let free = (contains(&ring.back_m, p) != ring.outside)
                && ring.back_m.iter().all(|q| (p - q).norm() > 2.0)
                && spots.iter().all(|q| (p - q).norm() > 4.5)
                && !lots.iter().any(|lot| (0..12).any(|k| contains(&lot.footprint_m, p + unit(f64::from(k) * 0.53) * 2.4)));
            if free && spots.len() < wanted && !self.at_tunnel(p) {
                spots.push(p);
            }
        }
        for p in spots {
            self.tree(kit, p, random);
        }
    }

    /// Under the earth beside a tunnel, or next to it.
    fn at_tunnel(&self, p: P2) -> bool {
        self.network.roads.iter().filter(|road| road.tunnel).any(|road| {
            let n = (road.path.length_m() / 2.0) as usize;
            (0..=n).any(|k| (road.path.at(2.0 * k as f64).0 - p).norm() < road.profile.back_m() + 6.0)
        })
    }

    fn park(&mut self, kit: &Kit, ring: &Ring) {
        let mut random = Random::new(self.seed, PARK, 0);
        let n = ring.back_m.len();
        let middle = ring.back_m.iter().sum::<P2>() / n as f64;
        let mut spots: Vec<P2> = Vec::new();
        for _ in 0..900 {
            let p = middle + P2::new(random.between(-60.0, 60.0), random.between(-90.0, 90.0));
            let deep = contains(&ring.back_m, p) && contains(&ring.back_m, p + (p - middle).normalize() * 2.5);
            if spots.len() < 70 && deep && spots.iter().all(|q| (p - q).norm() > 5.5) {
                spots.push(p);
            }
        }
        for p in spots {
            self.tree(kit, p, &mut random);
        }
        for i in 0..n {
            let (a, b) = (ring.back_m[i], ring.back_m[(i + 1) % n]);
            let length = (b - a).norm();
            for k in 0..(length / 1.1) as usize {
                let p = a + (b - a) * ((k as f64 + 0.5) * 1.1 / length);
                let inward = left((b - a).normalize());
                if k % 12 > 1 {
                    self.stand(
                        kit.bush,
                        Class::VEGETATION,
                        "hedge",
                        p + inward * 0.7,
                        KERB_HEIGHT_M,
                        random.between(0.0, std::f64::consts::TAU),
                    );
                }
                if k % 12 == 6 {
                    self.stand(kit.bench, Class::STATIC, "bench", p + inward * 2.2, KERB_HEIGHT_M, heading(inward));
                }
            }
        }
    }

    fn tree(&mut self, kit: &Kit, p: P2, random: &mut Random) {
        let mesh = random.pick(&kit.trees);
        self.stand(mesh, Class::VEGETATION, "tree", p, KERB_HEIGHT_M, random.between(0.0, std::f64::consts::TAU));
        self.pole_solid(p, 0.17, 4.0);
    }

    fn pole_solid(&mut self, p: P2, radius_m: f64, height_m: f64) {
        let ring: Vec<P2> = (0..6).map(|k| p + unit(std::f64::consts::TAU * k as f64 / 6.0) * radius_m).collect();
        let z = self.chunks.terrain.at(p);
        building::box_solid(&mut self.solid, &ring, (z - 0.1, z + height_m));
    }

    /// Lamps, trees and small things along both kerbs.
    fn roadside(&mut self, kit: &Kit, idx: usize) {
        let road = &self.network.roads[idx];
        if road.tunnel {
            return;
        }
        let mut random = Random::new(self.seed, ROADSIDE, idx as u64);
        let length = road.path.length_m();
        for side in [1.0, -1.0] {
            let trees = random.chance(0.8);
            let mut s = 7.0 + if side > 0.0 { 4.0 } else { 0.0 };
            let mut k = 0;
            while s < length - 7.0 {
                let at = |aside: f64| road.path.beside(s, side * (road.profile.kerb_m() + aside));
                let to_road = road.path.at(s).1 - side * std::f64::consts::FRAC_PI_2;
                let near_sign = (s - 14.0).abs() < 1.5 || (s - (length - 14.0)).abs() < 1.5;
                match k % 3 {
                    0 if !road.profile.verge || road.profile.main => {
                        self.stand(kit.lamp, Class::POLES, "street lamp", at(0.55), KERB_HEIGHT_M, to_road);
                        self.pole_solid(at(0.55), 0.1, 7.0);
                    }
                    _ if near_sign => {}
                    1 | 2 if trees => self.tree(kit, at(0.9), &mut random),
                    _ => {}
                }
                if !near_sign && !road.profile.verge {
                    self.small_thing(kit, road, (s + 3.2).min(length - 6.0), side, to_road, &mut random);
                }
                s += 8.5;
                k += 1;
            }
            for end in [5.6, 7.2] {
                for s in [end, length - end] {
                    if road.profile.main && !road.profile.verge {
                        let p = road.path.beside(s, side * (road.profile.kerb_m() + 0.4));
                        self.stand(kit.bollard, Class::STATIC, "bollard", p, KERB_HEIGHT_M, 0.0);
                    }
                }
            }
        }
    }

    fn small_thing(&mut self, kit: &Kit, road: &Road, s: f64, side: f64, to_road: f64, random: &mut Random) {
        let at = |aside: f64| road.path.beside(s, side * (road.profile.kerb_m() + aside));
        let draw = random.unit();
        if draw < 0.10 {
            self.stand(kit.bench, Class::STATIC, "bench", at(1.0), KERB_HEIGHT_M, to_road);
        } else if draw < 0.24 {
            self.stand(kit.bin, Class::DYNAMIC, "bin", at(0.6), KERB_HEIGHT_M, 0.0);
        } else if draw < 0.27 && road.profile.main {
            self.stand(kit.shelter, Class::STATIC, "shelter", at(1.9), KERB_HEIGHT_M, to_road);
        }
    }

    fn parked(&mut self, kit: &Kit, idx: usize) {
        let road = &self.network.roads[idx];
        if road.profile.edge != Edge::Parking {
            return;
        }
        let mut random = Random::new(self.seed, PARKING, idx as u64);
        for side in [1.0, -1.0] {
            for k in 0..n_bays(road) {
                if !random.chance(0.62) {
                    continue;
                }
                let (mesh, shape) = random.pick(&kit.cars);
                let s = BAYS_M.0 + (k as f64 + 0.5) * BAYS_M.1 + random.between(-0.25, 0.25);
                // In a bend a lorry that passes needs the room.
                if (road.path.at(s - 9.0).1 - road.path.at(s + 9.0).1).abs() > 0.02 {
                    continue;
                }
                let p = road.path.beside(s, side * (road.profile.driving_m() + 0.5 * road.profile.edge_m + random.between(0.06, 0.14)));
                let yaw = road.path.at(s).1 + if side > 0.0 { std::f64::consts::PI } else { 0.0 } + random.between(-0.02, 0.02);
                self.stand(mesh, Class::CAR, "parked car", p, 0.0, yaw);
                let z = self.chunks.terrain.at(p);
                let (u, v) = (unit(yaw) * shape.half_m[0], left(unit(yaw)) * shape.half_m[1]);
                building::box_solid(&mut self.solid, &[p - u - v, p + u - v, p + u + v, p - u + v], (z + 0.15, z + 2.0 * shape.half_m[2]));
            }
        }
    }

    fn signal(&mut self, kit: &Kit, signal: &Signal) {
        let road = &self.network.roads[signal.road];
        let foot = road.path.beside(signal.pole_s_m, signal.t_m);
        let yaw = facing(road.path.at(signal.pole_s_m).1, signal.against);
        self.pole_solid(foot, 0.09, 2.6);
        if signal.kind != SignalKind::Light {
            let mesh = kit.signs.iter().find(|(kind, _)| *kind == signal.kind).expect("the kit has every sign that networks place").1;
            self.stand(mesh, Class::TRAFFIC_SIGNS, "sign", foot, KERB_HEIGHT_M, yaw);
            return;
        }
        let wide = road.profile.main;
        self.stand(kit.poles[usize::from(wide)], Class::POLES, "traffic light pole", foot, KERB_HEIGHT_M, yaw);
        let pole = Isometry3::new(Vector3::new(foot.x, foot.y, KERB_HEIGHT_M + self.chunks.terrain.at(foot)), Vector3::z() * yaw);
        let head = |y: f64, z: f64| pole * Isometry3::translation(0.2, y, z);
        let mut heads = vec![head(0.0, furniture::HEADS_M.0)];
        if wide {
            heads.push(head(-4.6, furniture::HEADS_M.1 - 0.45));
        }
        self.lights.push(LightSite { signal_id: signal.id.to_string(), pole: pole.into(), heads });
    }
}
