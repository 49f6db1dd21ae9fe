//! What must hold for every generated town, whatever the seed.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use nalgebra::{Point3, Vector3};
use sensor_core::Vertex;
use simd_town::{Town, TownError};
use triangles::check_triangles;

#[path = "../../../simd_body/tests/it/triangles.rs"]
mod triangles;

use crate::clear_lanes;

fn town(seed: u64) -> Town {
    Town::generate("Town10HD", seed).expect("the default town exists")
}

/// Every town there is.
fn towns(seed: u64) -> impl Iterator<Item = Town> {
    Town::NAMES
        .into_iter()
        .map(move |name| Town::generate(name, seed).expect("a name of the list"))
}

fn hash(town: &Town) -> u64 {
    let mut hasher = DefaultHasher::new();
    town.open_drive.hash(&mut hasher);
    for mesh in &town.assets.meshes {
        bytemuck::cast_slice::<Vertex, u8>(&mesh.vertices).hash(&mut hasher);
        mesh.indices.hash(&mut hasher);
    }
    for each in &town.assets.statics {
        (each.mesh, each.object).hash(&mut hasher);
        each.world_from_mesh
            .to_homogeneous()
            .iter()
            .for_each(|x| x.to_bits().hash(&mut hasher));
    }
    for mesh in &town.collision {
        mesh.vertices_m
            .iter()
            .flatten()
            .for_each(|x| x.to_bits().hash(&mut hasher));
    }
    town.spawn_points
        .iter()
        .for_each(|p| bytemuck::bytes_of(p).hash(&mut hasher));
    hasher.finish()
}

#[test]
fn same_seed_same_town_other_seed_other_town() {
    assert_eq!(hash(&town(5)), hash(&town(5)));
    assert_ne!(hash(&town(5)), hash(&town(6)));
}

#[test]
fn names_are_forgiving_and_unknown_ones_are_named() {
    assert_eq!(
        Town::generate("Carla/Maps/Town10HD_Opt", 1)
            .expect("long name")
            .name,
        "Town10HD"
    );
    let error = Town::generate("Town99", 1).expect_err("no such town");
    assert_eq!(
        error,
        TownError::Unknown {
            name: "Town99".to_owned()
        }
    );
    assert_eq!(
        error.to_string(),
        "map \"Town99\" not found; generated towns are Town01, Town02, Town03, Town04, Town05, Town06, Town07, Town08, Town09, Town10HD, Town11, Town12, Town13, Town15"
    );
}

#[test]
fn spawn_points_keep_their_distance() {
    for town in (0..4).flat_map(towns) {
        let (points, seed) = (&town.spawn_points, &town.name);
        assert!(points.len() >= 155, "{seed} has {}", points.len());
        for (i, a) in points.iter().enumerate() {
            for b in &points[..i] {
                let same_way = (a.isometry().rotation * Vector3::x())
                    .dot(&(b.isometry().rotation * Vector3::x()))
                    > 0.0;
                let d = a
                    .isometry()
                    .inverse_transform_point(&Point3::from(Vector3::from(b.translation_m)));
                // A bridge and what passes under it are different places.
                let apart = (a.translation_m[2] - b.translation_m[2]).abs() > 4.0;
                assert!(
                    !same_way
                        || apart
                        || d.x.abs() > 11.9
                        || d.y.abs() > 3.4
                        || d.coords.norm() > 12.0,
                    "{seed}: {a:?} {b:?}"
                );
            }
            assert!((-3.0..16.0).contains(&a.translation_m[2]), "{seed}: {a:?}");
        }
    }
}

#[test]
fn spawn_points_hover_over_the_road() {
    for town in towns(3) {
        let road = &town.collision[0];
        for point in town.spawn_points.iter().step_by(5) {
            let [x, y, z] = point.translation_m.map(|x| x as f32);
            let heights = road.triangles.iter().filter_map(|t| {
                let p = t.map(|i| road.vertices_m[i as usize]);
                let weight = |a: [f32; 3], b: [f32; 3]| {
                    (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
                };
                let w = [weight(p[1], p[2]), weight(p[2], p[0]), weight(p[0], p[1])];
                let area: f32 = w.iter().sum();
                w.iter()
                    .all(|&w| w >= 0.0)
                    .then(|| (0..3).map(|i| w[i] / area * p[i][2]).sum::<f32>())
            });
            let off = heights
                .map(|height| z - 0.3 - height)
                .fold(f32::INFINITY, |a, b| if b.abs() < a.abs() { b } else { a });
            assert!(off.abs() < 0.02, "{}: {point:?} is {off} m off", town.name);
        }
    }
}

#[test]
fn a_lorry_fits_on_every_spawn_point() {
    for town in towns(1) {
        let solid = town
            .collision
            .iter()
            .find(|c| c.name == "buildings and poles")
            .expect("solid things");
        for point in &town.spawn_points {
            let here = point.isometry();
            for corner in &solid.vertices_m {
                let local = here.inverse_transform_point(&Point3::from(
                    Vector3::from(*corner).cast::<f64>() + Vector3::from(town.origin_m),
                ));
                assert!(
                    local.x.abs() > 5.3 || local.y.abs() > 1.95 || !(-0.5..4.3).contains(&local.z),
                    "{}: {corner:?} stands in the way of {point:?}",
                    town.name
                );
            }
        }
    }
}

#[test]
fn every_triangle_has_class_object_and_a_normal_that_agrees() {
    for town in towns(1) {
        town.assets
            .meshes
            .iter()
            .for_each(|mesh| check_triangles(mesh));
        check_triangles(&town.light_head);
        let known: BTreeSet<u32> = town.objects.iter().map(|object| object.id.0).collect();
        assert_eq!(known.len(), town.objects.len());
        for each in &town.assets.statics {
            let mesh = town.assets.mesh(each.mesh);
            assert!(mesh.radius_m < 700.0);
            if each.object.0 != 0 {
                assert!(each.object.is_scenery() && known.contains(&each.object.0));
                continue;
            }
            assert!(
                mesh.vertices.iter().all(|v| known.contains(&v.object_id)),
                "{} has triangles of nobody",
                mesh.name
            );
        }
    }
}

#[test]
fn the_road_has_no_holes_and_nothing_lies_on_anything() {
    for town in towns(1) {
        // Vertical probes: exactly one of road, pavement or block surface at every point of the
        // town.
        let mut cells: BTreeMap<(i32, i32), Vec<[Vector3<f32>; 3]>> = BTreeMap::new();
        for mesh in town
            .collision
            .iter()
            .filter(|c| c.name != "buildings and poles")
        {
            for t in &mesh.triangles {
                let p = t.map(|i| Vector3::from(mesh.vertices_m[i as usize]));
                if (p[1] - p[0]).cross(&(p[2] - p[0])).z < 1e-4 {
                    continue;
                }
                let span = |axis: usize| {
                    let (low, high) = p.iter().fold((f32::MAX, f32::MIN), |(l, h), q| {
                        (l.min(q[axis]), h.max(q[axis]))
                    });
                    (low / 10.0).floor() as i32..=(high / 10.0).floor() as i32
                };
                for x in span(0) {
                    span(1).for_each(|y| cells.entry((x, y)).or_default().push(p));
                }
            }
        }
        let road = town.collision[0]
            .vertices_m
            .iter()
            .map(|&v| Vector3::from(v));
        let margin = Vector3::repeat(8.0);
        let low = road
            .clone()
            .reduce(|a, b| a.inf(&b))
            .expect("a town has roads")
            - margin;
        let high = road.reduce(|a, b| a.sup(&b)).expect("a town has roads") + margin;
        let (mut holes, mut doubles, mut places) = (0, 0, Vec::new());
        for i in 0..40_000 {
            let (x, y) = (
                low.x + (high.x - low.x) * ((i as f32 * 0.618_034) % 1.0),
                low.y + (high.y - low.y) * (i as f32 / 40_000.0),
            );
            let inside = |t: &&[Vector3<f32>; 3]| {
                (0..3).all(|k| {
                    let (a, b) = (t[k], t[(k + 1) % 3]);
                    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x) > 1e-3
                })
            };
            let near = |t: &&[Vector3<f32>; 3]| {
                (0..3).all(|k| {
                    let (a, b) = (t[k], t[(k + 1) % 3]);
                    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x) > -2e-2
                })
            };
            let cell = cells
                .get(&((x / 10.0).floor() as i32, (y / 10.0).floor() as i32))
                .map_or(&[][..], Vec::as_slice);
            let is_hole = !cell.iter().any(|t| near(&t));
            holes += usize::from(is_hole);
            // Under a bridge lies another surface, far below.
            let height = |t: &[Vector3<f32>; 3]| (t[0].z + t[1].z + t[2].z) / 3.0;
            let heights: Vec<f32> = cell.iter().filter(inside).map(height).collect();
            let near_another = |i: usize| heights[..i].iter().any(|h| (h - heights[i]).abs() < 1.2);
            let is_double = (0..heights.len()).any(near_another);
            doubles += usize::from(is_double);
            if is_hole || is_double {
                places.push((x, y));
            }
        }
        assert_eq!((holes, doubles), (0, 0), "{}: {places:?}", town.name);
    }
}

#[test]
fn a_street_view_stays_within_the_triangle_budget() {
    for town in towns(1) {
        let mut counts = Vec::new();
        for point in town.spawn_points.iter().step_by(9) {
            let eye = Vector3::from(point.translation_m) + Vector3::new(0.0, 0.0, 1.3);
            let forward = point.isometry().rotation * Vector3::x();
            let left = point.isometry().rotation * Vector3::y();
            let n: usize = (town.assets.statics.iter())
                .filter_map(|each| {
                    let mesh = town.assets.mesh(each.mesh);
                    let to = each.world_from_mesh
                        * Point3::from(Vector3::from(mesh.centre_m).cast::<f64>())
                        - Point3::from(eye);
                    let radius = f64::from(mesh.radius_m);
                    // A quarter turn of view.
                    let out = to.dot(&forward) < -radius
                        || to.dot(&left).abs() - to.dot(&forward) > radius * 2f64.sqrt();
                    let away = (to.norm() - radius) as f32;
                    let lod = mesh.lods.iter().find(|lod| away < lod.until_m)?;
                    (!out).then_some(lod.n_indices as usize / 3)
                })
                .sum();
            assert!(n < 60_000, "{}: {n} triangles from {point:?}", town.name);
            counts.push(n);
        }
        counts.sort_unstable();
        println!(
            "{}: median {}, most {}, from {} places",
            town.name,
            counts[counts.len() / 2],
            counts[counts.len() - 1],
            counts.len()
        );
    }
}

#[test]
fn every_light_of_the_map_has_heads_that_face_its_traffic() {
    for town in towns(1) {
        let in_map = town.open_drive.matches(r#"type="1000001""#).count();
        assert_eq!(town.lights.len(), in_map);
        assert!(in_map >= 9, "{} has {in_map} lights", town.name);
        for light in &town.lights {
            assert!(
                town.open_drive
                    .contains(&format!(r#"<control signalId="{}""#, light.signal_id))
            );
            assert!(!light.heads.is_empty());
        }
    }
}

#[test]
fn nothing_solid_stands_in_a_lane() {
    for town in towns(1).chain(towns(2)) {
        let roads = schema_roads::RoadMap::parse(&town.open_drive).unwrap();
        let found = clear_lanes::solids_in_lanes(&town, &roads);
        assert!(found.is_empty(), "{}: {found:#?}", town.name);
    }
}
