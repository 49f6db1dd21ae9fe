//! Bridges: deck, parapets, piers and abutments.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::{P2, area, contains, left, unit};
use crate::ground::ABUTMENT_M;
use crate::network::kerb::border;
use crate::network::{KERB_HEIGHT_M, Network, PARAPET_M, Road};
use crate::scenery::{ALL, Chunks, CollisionMesh, Key, Layer, Levels};

/// Thickness of a deck.
pub const DECK_M: f64 = 1.1;

/// Greatest distance between two piers.
const SPAN_M: f64 = 26.0;

/// Collects faces of one bridge.
struct Works<'a> {
    chunks: &'a mut Chunks,
    solid: &'a mut CollisionMesh,
    object: ObjectId,
}

impl Works<'_> {
    fn face(&mut self, levels: Levels, surface: Surface, corners: &[[f64; 3]; 4], hard: bool) {
        let size = |a: [f64; 3], b: [f64; 3]| {
            ((0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()) as f32
        };
        let (u, v) = (size(corners[0], corners[1]), size(corners[0], corners[3]));
        let key = Key::at(Layer::Building, P2::new(corners[0][0], corners[0][1]));
        self.chunks.polygon(
            key,
            levels,
            surface.of(self.object),
            corners,
            &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]],
        );
        if hard {
            self.solid.polygon(self.object, corners);
        }
    }

    /// An upright box over four corners, counter-clockwise from above.
    fn block(&mut self, surface: Surface, footprint: &[P2; 4], low_m: f64, high_m: f64) {
        let at = |p: P2, z: f64| [p.x, p.y, z];
        for i in 0..4 {
            let (a, b) = (footprint[i], footprint[(i + 1) % 4]);
            self.face(
                ALL,
                surface,
                &[at(a, low_m), at(b, low_m), at(b, high_m), at(a, high_m)],
                true,
            );
        }
        self.face(ALL, surface, &footprint.map(|p| at(p, high_m)), true);
    }
}

/// Builds the bridge of a road that has one, without the road's asphalt and paint.
pub fn build(
    chunks: &mut Chunks,
    solid: &mut CollisionMesh,
    network: &Network,
    road: &Road,
    object: ObjectId,
) {
    let Some((from, to)) = road.bridge else {
        return;
    };
    let concrete = Surface::new(Class::BRIDGE, Material::Concrete, [168, 166, 160]);
    let dark = Surface::new(Class::BRIDGE, Material::Matte, [116, 115, 112]);
    let footway = Surface::new(Class::BRIDGE, Material::Concrete, [150, 147, 140]);
    let steel = Surface::new(Class::BRIDGE, Material::Metal, [104, 112, 118]);
    let mut works = Works {
        chunks,
        solid,
        object,
    };
    let (kerb, edge, outer) = (
        road.profile.kerb_m(),
        road.profile.kerb_m() + road.deck_edge_m(),
        road.deck_half_width_m(),
    );
    for pair in road.stations_between(from, to).windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for side in [1.0, -1.0] {
            // Faces are drawn for the left side; on the right their corners run the other way
            // round.
            let mut strip =
                |levels: Levels, surface, (t0, z0): (f64, f64), (t1, z1): (f64, f64), hard| {
                    let mut corners = [
                        road.point(a, side * t0, z0),
                        road.point(b, side * t0, z0),
                        road.point(b, side * t1, z1),
                        road.point(a, side * t1, z1),
                    ];
                    if side < 0.0 {
                        corners.swap(0, 1);
                        corners.swap(2, 3);
                    }
                    works.face(levels, surface, &corners, hard);
                };
            let (rise, top) = (KERB_HEIGHT_M, KERB_HEIGHT_M + PARAPET_M.0);
            strip(ALL, footway, (kerb, 0.0), (kerb, rise), true);
            strip(ALL, footway, (kerb, rise), (edge, rise), true);
            strip(ALL, concrete, (edge, rise), (edge, top), true);
            strip(ALL, concrete, (edge, top), (outer, top), true);
            strip(ALL, concrete, (outer, top), (outer, -0.45), true);
            strip(0..=1, dark, (outer, -0.45), (outer - 0.7, -DECK_M), false);
            // A handrail on the parapet.
            strip(
                0..=0,
                steel,
                (edge + 0.1, top + 0.12),
                (edge + 0.1, top + 0.2),
                false,
            );
            strip(
                0..=0,
                steel,
                (edge + 0.2, top + 0.2),
                (edge + 0.2, top + 0.12),
                false,
            );
        }
        let under = [
            road.point(a, outer - 0.7, -DECK_M),
            road.point(b, outer - 0.7, -DECK_M),
            road.point(b, 0.7 - outer, -DECK_M),
            road.point(a, 0.7 - outer, -DECK_M),
        ];
        works.face(ALL, dark, &under, true);
    }
    for (s, inward) in [(from, 1.0), (to, -1.0)] {
        abutment(&mut works, road, s, inward, concrete);
    }
    piers(&mut works, network, road, (from, to), concrete);
}

/// A wall under each end of the deck, with the parapets' ends on it.
fn abutment(works: &mut Works<'_>, road: &Road, s_m: f64, inward: f64, surface: Surface) {
    let reach = road.profile.back_m() + 0.4;
    let (near, far) = (s_m - 0.3 * inward, s_m + (ABUTMENT_M.0 + 0.5) * inward);
    let (a, b) = (near.min(far), near.max(far));
    let footprint = [
        road.path.beside(a, -reach),
        road.path.beside(b, -reach),
        road.path.beside(b, reach),
        road.path.beside(a, reach),
    ];
    let top = road.elevation.at(s_m) - 0.12;
    works.block(surface, &footprint, top - ABUTMENT_M.1 - 2.5, top);
    for side in [1.0, -1.0] {
        let (t0, t1) = (
            side * (road.profile.kerb_m() + road.deck_edge_m()),
            side * reach,
        );
        let mut wing = [
            road.path.beside(a, t0),
            road.path.beside(b, t0),
            road.path.beside(b, t1),
            road.path.beside(a, t1),
        ];
        if side < 0.0 {
            wing.swap(0, 1);
            wing.swap(2, 3);
        }
        wing.reverse();
        if area(&wing) < 0.0 {
            wing.reverse();
        }
        works.block(
            surface,
            &wing,
            top,
            road.elevation.at(s_m) + KERB_HEIGHT_M + PARAPET_M.0,
        );
    }
}

/// Piers that keep clear of the roads below.
fn piers(
    works: &mut Works<'_>,
    network: &Network,
    road: &Road,
    (from, to): (f64, f64),
    surface: Surface,
) {
    let n = ((to - from) / SPAN_M).ceil().max(1.0) as usize;
    for k in 1..n {
        let s = from + (to - from) * k as f64 / n as f64;
        // If a road below is in the way, the pier moves along the bridge.
        let place = [0.0, 4.0, -4.0, 8.0, -8.0, 11.0, -11.0]
            .iter()
            .map(|d| s + d)
            .find(|&s| {
                s > from + 5.0
                    && s < to - 5.0
                    && columns(road, s).iter().all(|&p| is_clear(network, road, p))
            });
        let Some(s) = place else { continue };
        let heading = road.path.at(s).1;
        let (u, v) = (unit(heading) * 0.55, left(unit(heading)) * 0.55);
        let deck = road.elevation.at(s) - DECK_M;
        for p in columns(road, s) {
            let ground = works.chunks.terrain.at(p) - 0.5;
            if deck - 0.8 > ground {
                works.block(
                    surface,
                    &[p - u - v, p + u - v, p + u + v, p - u + v],
                    ground,
                    deck - 0.7,
                );
            }
        }
        let (u, v) = (
            unit(heading) * 0.75,
            left(unit(heading)) * (road.deck_half_width_m() - 0.9),
        );
        let p = road.path.at(s).0;
        works.block(
            surface,
            &[p - u - v, p + u - v, p + u + v, p - u + v],
            deck - 0.8,
            deck + 0.02,
        );
    }
}

/// Middles of the columns of a pier.
fn columns(road: &Road, s_m: f64) -> Vec<P2> {
    let t = 0.55 * road.deck_half_width_m();
    vec![road.path.beside(s_m, t), road.path.beside(s_m, -t)]
}

/// Whether no pavement or lane of a road on the ground is near.
fn is_clear(network: &Network, own: &Road, p: P2) -> bool {
    let off_roads = network
        .roads
        .iter()
        .filter(|road| road.id != own.id)
        .all(|road| {
            let (s, away) = road.path.nearest(p);
            away > road.profile.kerb_m() + 1.3 || road.is_on_bridge(s)
        });
    off_roads && (0..network.junctions.len()).all(|j| !contains(&border(network, j), p))
}
