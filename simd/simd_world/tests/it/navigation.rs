//! The walkable mesh of generated towns has sound geometry, connected pavements, and ground where
//! it says there is some.

use std::collections::BTreeMap;

use schema_roads::walkable::{Ground, WalkMesh};
use schema_roads::{LaneKind, LanePosition, RoadMap};
use schema_types::Pose;
use schema_types::noise::Noise;
use simd_town::Town;
use simd_world::{MapData, World, WorldOptions};

fn roads(name: &str) -> RoadMap {
    RoadMap::parse(&Town::generate(name, 1).unwrap().open_drive).unwrap()
}

/// Connected component of each face, over neighbours whose ground passes the filter.
fn components(mesh: &WalkMesh, passes: impl Fn(Ground) -> bool) -> BTreeMap<usize, f64> {
    let mut of: Vec<Option<usize>> = vec![None; mesh.faces.len()];
    let mut area_m2: BTreeMap<usize, f64> = BTreeMap::new();
    for start in 0..mesh.faces.len() {
        if of[start].is_some() || !passes(mesh.faces[start].ground) {
            continue;
        }
        let mut open = vec![start];
        of[start] = Some(start);
        while let Some(face) = open.pop() {
            *area_m2.entry(start).or_default() += mesh.area_m2(face);
            for next in mesh.faces[face]
                .neighbours
                .iter()
                .flatten()
                .map(|next| *next as usize)
            {
                if of[next].is_none() && passes(mesh.faces[next].ground) {
                    of[next] = Some(start);
                    open.push(next);
                }
            }
        }
    }
    area_m2
}

#[test]
fn faces_are_convex_and_know_their_neighbours() {
    for name in Town::NAMES {
        let map = roads(name);
        let mesh = map.walkable(true);
        assert!(
            mesh.faces.len() > 200 && mesh.faces.len() < 0x7fff,
            "{name}: {} faces",
            mesh.faces.len()
        );
        for (idx, face) in mesh.faces.iter().enumerate() {
            let corners: Vec<[f64; 3]> = mesh.corners_m(idx).collect();
            let n = corners.len();
            assert!((3..=6).contains(&n) && face.neighbours.len() == n && mesh.area_m2(idx) > 0.0);
            for i in 0..n {
                let [a, b, c] = [corners[i], corners[(i + 1) % n], corners[(i + 2) % n]];
                let turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                assert!(turn > -1e-9, "{name}: face {idx} is not convex");
                if let Some(other) = face.neighbours[i] {
                    let other = &mesh.faces[other as usize];
                    let (from, to) = (face.corners[i], face.corners[(i + 1) % n]);
                    let m = other.corners.len();
                    let back = (0..m)
                        .find(|k| (other.corners[*k], other.corners[(k + 1) % m]) == (to, from))
                        .expect("both share the edge");
                    assert_eq!(other.neighbours[back], Some(idx as u32));
                }
            }
        }
    }
}

#[test]
fn pavements_have_the_area_that_the_map_says_and_hang_together_over_crosswalks() {
    for name in ["Town01", "Town10HD"] {
        let map = roads(name);
        let mesh = map.walkable(false);
        let of = |ground: Ground| {
            (0..mesh.faces.len())
                .filter(|face| mesh.faces[*face].ground == ground)
                .map(|face| mesh.area_m2(face))
                .sum::<f64>()
        };
        // The area of lanes less the margin that is kept clear; corners are added to it.
        let lanes_m2: f64 = map
            .lanes()
            .iter()
            .filter(|lane| lane.kind == LaneKind::Sidewalk)
            .map(|lane| {
                lane.length_m
                    * (map.width_m(LanePosition::new(lane.key, 0.5 * lane.length_m)) - 0.7)
            })
            .sum();
        let pavements_m2 = of(Ground::Sidewalk);
        assert!(
            (0.95..1.5).contains(&(pavements_m2 / lanes_m2)),
            "{name}: {pavements_m2} m² of mesh, {lanes_m2} m² of lanes"
        );
        assert!(of(Ground::Crosswalk) > 100.0 && of(Ground::Road) == 0.0);
        let parts = components(&mesh, |_| true);
        let largest = parts.values().fold(0.0f64, |a, b| a.max(*b));
        let whole: f64 = parts.values().sum();
        assert!(
            largest > 0.9 * whole,
            "{name}: the largest part has {largest} of {whole} m²"
        );
    }
}

#[test]
fn there_is_ground_where_the_mesh_says() {
    let town = Town::generate("Town10HD", 1).unwrap();
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::from(&town)).unwrap();
    let map = world.roads().unwrap().clone();
    let mesh = map.walkable(false);
    let pavements: Vec<usize> = (0..mesh.faces.len())
        .filter(|face| mesh.faces[*face].ground == Ground::Sidewalk)
        .collect();
    let draw = Noise::new(3, 1, 0);
    let mut placed = Vec::new();
    for i in 0..150 {
        let face = pavements[(draw.bits(i) % pavements.len() as u64) as usize];
        let [x, y, z] = mesh.middle_m(face);
        // Trees, poles and benches stand on pavements too.
        if let Ok(actor) = world.spawn(
            "walker.pedestrian.0001",
            Pose::from_xyz_yaw(x, y, z + 1.2, 0.0),
            None,
            "",
            &BTreeMap::new(),
        ) {
            placed.push((actor, [x, y]));
        }
    }
    assert!(placed.len() > 100, "{}", placed.len());
    (0..40).for_each(|_| world.step(50_000_000));
    let (n_placed, mut on_kerb) = (placed.len(), 0);
    let half_m = f64::from(world.record(placed[0].0).unwrap().half_box_m[2]);
    for (actor, [x, y]) in placed {
        let at = world.record(actor).unwrap().world_from_actor.translation_m;
        let lane = map.nearest(at, |lane| lane.kind.is_drivable()).unwrap();
        let over_road_m = at[2] - half_m - map.pose(lane).unwrap().translation.z;
        // A kerb's height above the road, and not displaced by anything.
        assert!(
            (at[0] - x).hypot(at[1] - y) < 0.02 && (0.02..0.25).contains(&over_road_m),
            "{at:?} stands {over_road_m} m over the road"
        );
        on_kerb += usize::from((0.1..0.25).contains(&over_road_m));
    }
    // The others stand where the kerb is lowered before a crosswalk.
    assert!(
        on_kerb * 4 > n_placed * 3,
        "{on_kerb} of {n_placed} stand at a kerb's height over the road"
    );
}

#[test]
fn people_stroll_in_every_town() {
    for name in Town::NAMES {
        let mut world = World::new(WorldOptions {
            seed: 3,
            ..WorldOptions::default()
        });
        world
            .load(&MapData::from(&Town::generate(name, 1).unwrap()))
            .unwrap();
        let mesh = world.roads().unwrap().walkable(false);
        let of = |ground: Ground| {
            (0..mesh.faces.len())
                .filter(|face| mesh.faces[*face].ground == ground)
                .map(|face| mesh.area_m2(face))
                .sum::<f64>()
        };
        let (pavements_m2, crosswalks_m2) = (of(Ground::Sidewalk), of(Ground::Crosswalk));
        // A village of 400 m of streets with 2.5 m of mesh on both sides, and a crosswalk at every
        // end of six streets.
        assert!(
            pavements_m2 > 2000.0 && crosswalks_m2 > 12.0 * 3.2 * 7.0,
            "{name}: {pavements_m2} and {crosswalks_m2} m²"
        );
        let walkers = world.spawn_walkers(20);
        let at = |world: &World| -> Vec<[f64; 3]> {
            walkers
                .iter()
                .map(|walker| {
                    world
                        .record(*walker)
                        .unwrap()
                        .world_from_actor
                        .translation_m
                })
                .collect()
        };
        let (mut last, mut ways) = (at(&world), vec![0.0f64; walkers.len()]);
        for _ in 0..60 {
            (0..20).for_each(|_| world.step(50_000_000));
            let now = at(&world);
            for (way, (a, b)) in ways.iter_mut().zip(now.iter().zip(&last)) {
                *way += (a[0] - b[0]).hypot(a[1] - b[1]);
            }
            last = now;
        }
        let n_strolled = ways.iter().filter(|way| **way > 20.0).count();
        assert!(
            walkers.len() == 20 && n_strolled >= 14,
            "{name}: {n_strolled} of {} got anywhere: {ways:?}",
            walkers.len()
        );
    }
}
