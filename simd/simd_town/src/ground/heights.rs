//! Heights of the ground under a network and in its blocks.

use super::ring::Ring;
use crate::geometry::P2;
use crate::network::Network;
use crate::network::kerb::border;
use crate::scenery::Terrain;

/// Heights of the ground under a network and in its blocks. Bridge decks do not count as ground.
pub fn terrain(network: &Network, rings: &[Ring], hills_m: f64) -> Terrain {
    let mut terrain = Terrain::default();
    if network.is_level() && hills_m == 0.0 && rings.iter().all(|ring| ring.ponds.is_empty()) {
        return terrain;
    }
    for road in &network.roads {
        let kerb = road.profile.kerb_m();
        for (from, to) in road.on_ground() {
            for pair in road.stations_between(from, to).windows(2) {
                let at = |s: f64, t: f64| lifted(road.path.beside(s, t), road.elevation.at(s));
                terrain.polygon(&[
                    at(pair[0], -kerb),
                    at(pair[1], -kerb),
                    at(pair[1], kerb),
                    at(pair[0], kerb),
                ]);
            }
        }
    }
    for junction in 0..network.junctions.len() {
        let border: Vec<[f64; 3]> = border(network, junction)
            .into_iter()
            .map(|p| lifted(p, network.junctions[junction].height_m))
            .collect();
        terrain.polygon(&border);
    }
    for ring in rings {
        add_block(&mut terrain, ring);
    }
    terrain
}

fn add_block(terrain: &mut Terrain, ring: &Ring) {
    let n = ring.kerb_m.len();
    let back = |i: usize| lifted(ring.back_m[i], ring.height_m[i]);
    for i in (0..n).filter(|&i| !ring.seam[i]) {
        let k = (i + 1) % n;
        terrain.polygon(&[
            lifted(ring.kerb_m[i], ring.height_m[i]),
            lifted(ring.kerb_m[k], ring.height_m[k]),
            back(k),
            back(i),
        ]);
    }
    for triangle in &ring.ground.triangles {
        terrain
            .polygon(&triangle.map(|i| lifted(ring.ground.points_m[i], ring.ground.heights_m[i])));
    }
}

fn lifted(p: P2, z_m: f64) -> [f64; 3] {
    [p.x, p.y, z_m]
}
