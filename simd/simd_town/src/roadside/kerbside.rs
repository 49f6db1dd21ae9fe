//! What stands along the kerbs: lamps, trees, small things, parked cars, power lines.

use schema_types::Class;

use crate::building::box_solid;
use crate::geometry::{P2, left, unit};
use crate::ground::{BAYS_M, n_bays};
use crate::kit::Kit;
use crate::network::Road;
use crate::object::MapLayer;
use crate::open_drive::KERB_HEIGHT_M;
use crate::plan::Edge;
use crate::random::Random;
use crate::scenery::Builder;

/// Streams of random numbers.
const ROADSIDE: u64 = 0x72;
const PARKING: u64 = 0x73;
/// Between power poles.
const SPAN_M: f64 = 38.0;

impl Builder<'_> {
    /// Everything along one road.
    pub fn roadside(&mut self, kit: &Kit, idx: usize) {
        let road = &self.network.roads[idx];
        if road.tunnel {
            return;
        }
        let mut random = Random::new(self.seed, ROADSIDE, idx as u64);
        if road.profile.one_way && road.profile.verge {
            self.masts(kit, road);
        } else if road.profile.verge && !road.profile.main && road.profile.n_lanes == 1 {
            self.power_line(kit, road);
            self.avenue(kit, road, &mut random);
        } else {
            self.street(kit, idx, &mut random);
        }
        self.road_decals(kit, road, &mut random);
    }

    /// Nothing passes over this station, and the road lies on the ground.
    fn is_open(&self, road: &Road, s_m: f64) -> bool {
        let p = road.path.at(s_m).0;
        !road.is_on_bridge(s_m)
            && !crate::bridge::is_near(self.network, p, road.profile.back_m() + 1.0)
            || self.network.roads.iter().all(|other| {
                other.bridge.is_none() || other.id == road.id && !road.is_on_bridge(s_m)
            })
    }

    fn street(&mut self, kit: &Kit, idx: usize, random: &mut Random) {
        let road = &self.network.roads[idx];
        let length = road.path.length_m();
        for side in [1.0, -1.0] {
            let trees = random.chance(0.8);
            let mut s = 7.0 + if side > 0.0 { 4.0 } else { 0.0 };
            let mut k = 0;
            while s < length - 7.0 {
                let at = |aside: f64| road.path.beside(s, side * (road.profile.kerb_m() + aside));
                let to_road = road.path.at(s).1 - side * std::f64::consts::FRAC_PI_2;
                let near_sign = (s - 14.0).abs() < 1.5 || (s - (length - 14.0)).abs() < 1.5;
                let z = road.elevation.at(s) + KERB_HEIGHT_M;
                let open = self.is_open(road, s);
                match k % 3 {
                    0 if open && (!road.profile.verge || road.profile.main) => {
                        self.lamp(&kit.lamp, at(0.55), z, to_road)
                    }
                    _ if near_sign || !open => {}
                    1 | 2 if trees && !road.profile.verge => {
                        self.street_tree(kit, idx, at(0.9), random)
                    }
                    _ => {}
                }
                if !near_sign && !road.profile.verge && open {
                    self.small_thing(
                        kit,
                        road,
                        (s + 3.2).min(length - 6.0),
                        side,
                        to_road,
                        random,
                    );
                }
                s += 8.5;
                k += 1;
            }
            for end in [5.6, 7.2] {
                for s in [end, length - end] {
                    if road.profile.main && !road.profile.verge && length > 20.0 {
                        let p = road.path.beside(s, side * (road.profile.kerb_m() + 0.4));
                        self.stand(
                            kit.bollard,
                            (MapLayer::Props, Class::STATIC, "bollard"),
                            p,
                            KERB_HEIGHT_M,
                            0.0,
                        );
                    }
                }
            }
        }
    }

    fn small_thing(
        &mut self,
        kit: &Kit,
        road: &Road,
        s: f64,
        side: f64,
        to_road: f64,
        random: &mut Random,
    ) {
        let at = |aside: f64| road.path.beside(s, side * (road.profile.kerb_m() + aside));
        let back = road.profile.pavement_m;
        let along = to_road + std::f64::consts::FRAC_PI_2;
        let draw = random.unit();
        let (mesh, class, name, aside, yaw) = match draw {
            ..0.09 => (kit.bench, Class::STATIC, "bench", 1.0, to_road),
            ..0.20 => (kit.bin, Class::DYNAMIC, "bin", 0.6, 0.0),
            ..0.25 => (kit.hydrant, Class::STATIC, "hydrant", 0.55, to_road),
            ..0.31 => (kit.planter, Class::VEGETATION, "planter", 0.8, along),
            ..0.35 => (kit.rack, Class::STATIC, "bicycle_rack", 0.9, along),
            ..0.38 => (
                kit.letter_box,
                Class::STATIC,
                "letter_box",
                back - 0.6,
                to_road,
            ),
            ..0.42 => (kit.cabinet, Class::STATIC, "cabinet", back - 0.45, to_road),
            ..0.46 if road.profile.main => (kit.shelter, Class::STATIC, "bus_stop", 1.9, to_road),
            _ => return,
        };
        let p = at(aside);
        if self.is_free(p, 1.0) {
            self.stand(mesh, (MapLayer::Props, class, name), p, KERB_HEIGHT_M, yaw);
        }
    }

    /// Tall lamps along motorways and ramps, on the right.
    fn masts(&mut self, kit: &Kit, road: &Road) {
        let n = (road.path.length_m() / 45.0) as usize;
        for k in 0..n {
            let s = (k as f64 + 0.5) * road.path.length_m() / n as f64;
            if !self.is_open(road, s) {
                continue;
            }
            let p = road.path.beside(s, -(road.profile.kerb_m() + 1.0));
            self.lamp(
                &kit.mast,
                p,
                road.elevation.at(s) + KERB_HEIGHT_M,
                road.path.at(s).1 + std::f64::consts::FRAC_PI_2,
            );
        }
    }

    /// Poles with wires on the left of a country road.
    fn power_line(&mut self, kit: &Kit, road: &Road) {
        let length = road.path.length_m();
        let n = ((length - 30.0) / SPAN_M) as usize;
        let spot = |k: usize| {
            let s = 15.0 + (length - 30.0) * k as f64 / n.max(1) as f64;
            (
                road.path.beside(s, road.profile.back_m() + 2.2),
                road.path.at(s).1,
            )
        };
        if n < 2 {
            return;
        }
        let object = self.object_in(Some(MapLayer::Props), Class::POLES, "power_line");
        let spots: Vec<(P2, f64)> = (0..=n)
            .map(spot)
            .filter(|(p, _)| !self.is_on_drive(*p))
            .collect();
        if !spots.iter().all(|(p, _)| self.is_free(*p, 2.0)) {
            return;
        }
        for (p, heading) in &spots {
            let pole = self.stand(
                kit.power_pole,
                (MapLayer::Props, Class::POLES, "power_pole"),
                *p,
                0.0,
                *heading,
            );
            self.pole_solid(pole, *p, 0.14, 8.0);
        }
        for pair in spots.windows(2) {
            crate::props::wires(&mut self.chunks, object, pair[0], pair[1]);
        }
    }

    /// Trees along country roads.
    fn avenue(&mut self, kit: &Kit, road: &Road, random: &mut Random) {
        let length = road.path.length_m();
        let mut s = 12.0;
        while s < length - 12.0 {
            let side = if random.chance(0.6) { -1.0 } else { 1.0 };
            let p = road
                .path
                .beside(s, side * (road.profile.back_m() + random.between(3.6, 6.0)));
            let alone = self
                .network
                .roads
                .iter()
                .all(|other| other.path.nearest(p).1 > other.profile.back_m() + 1.5);
            if alone && !self.is_on_drive(p) && self.is_free(p, 2.0) && random.chance(0.75) {
                self.tree(kit, p, random);
            }
            s += random.between(9.0, 26.0);
        }
    }

    /// Covers in the road, where no paint is.
    fn road_decals(&mut self, kit: &Kit, road: &Road, random: &mut Random) {
        if road.profile.verge {
            return;
        }
        let mut s = random.between(9.0, 20.0);
        while s < road.path.length_m() - 9.0 {
            let side = if random.chance(0.5) { 1.0 } else { -1.0 };
            let p = road.path.beside(s, side * 0.5 * road.profile.lane_m);
            let object = self.object_in(Some(MapLayer::Decals), Class::ROADS, "manhole");
            if road.elevation.is_level() {
                self.stand_as(
                    object,
                    kit.manhole,
                    p,
                    road.elevation.at(s),
                    random.between(0.0, 3.0),
                );
            }
            s += random.between(24.0, 55.0);
        }
    }

    /// Cars in the parking bays.
    pub fn parked(&mut self, kit: &Kit, idx: usize) {
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
                let p = road.path.beside(
                    s,
                    side * (road.profile.driving_m()
                        + 0.5 * road.profile.edge_m
                        + random.between(0.06, 0.14)),
                );
                let yaw = road.path.at(s).1
                    + if side > 0.0 {
                        std::f64::consts::PI
                    } else {
                        0.0
                    }
                    + random.between(-0.02, 0.02);
                let object = self.stand(
                    mesh,
                    (MapLayer::ParkedVehicles, Class::CAR, "parked_car"),
                    p,
                    0.0,
                    yaw,
                );
                let z = self.chunks.terrain.at(p);
                let (u, v) = (
                    unit(yaw) * shape.half_m[0],
                    left(unit(yaw)) * shape.half_m[1],
                );
                let footprint = [p - u - v, p + u - v, p + u + v, p - u + v];
                box_solid(
                    &mut self.solid,
                    object,
                    &footprint,
                    (z + 0.15, z + 2.0 * shape.half_m[2]),
                );
            }
        }
    }
}
