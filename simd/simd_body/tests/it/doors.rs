//! Doors: shut doors equal the body's skin; an open door leaves a hole with an interior behind it.

use nalgebra::{Isometry3, Point3, Vector3};
use simd_body::{
    BodyStyle, Door, DoorMeshes, DoorMotion, VehicleShape, door_meshes, vehicle_meshes,
};

fn shapes() -> Vec<VehicleShape> {
    let shape = |style, half_m, wheel_radius_m, wheelbase_m| VehicleShape {
        style,
        half_m,
        wheel_radius_m,
        wheelbase_m,
    };
    vec![
        shape(BodyStyle::Saloon, [2.503, 1.049, 0.767], 0.34, 2.95),
        shape(BodyStyle::Hatch, [2.276, 1.049, 0.884], 0.31, 2.5),
        shape(BodyStyle::Suv, [2.783, 1.075, 1.023], 0.4, 3.07),
        shape(BodyStyle::Van, [2.958, 0.994, 1.280], 0.35, 3.66),
        shape(BodyStyle::Microbus, [2.221, 0.939, 0.994], 0.33, 2.4),
    ]
}

type Triangle = [Point3<f64>; 3];

/// Triangles of the finest level at a place.
fn triangles(mesh: &sensor_core::Mesh, at: &Isometry3<f64>) -> Vec<Triangle> {
    let lod = mesh.lods[0];
    let used = &mesh.indices[lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize];
    let corner = |i: &u32| at * Point3::from(mesh.vertices[*i as usize].position_m).cast::<f64>();
    used.chunks(3)
        .map(|ids| [corner(&ids[0]), corner(&ids[1]), corner(&ids[2])])
        .collect()
}

/// Distance to the nearest triangle whose outside the ray meets, as cameras see it.
fn hit_m(triangles: &[Triangle], from: Point3<f64>, direction: Vector3<f64>) -> f64 {
    let meets = |[a, b, c]: &Triangle| {
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(&ac);
        let towards = normal.dot(&direction);
        if towards >= 0.0 {
            return None;
        }
        let t = normal.dot(&(a - from)) / towards;
        let p = from + direction * t - a;
        let (d00, d01, d11, d20, d21) = (
            ab.dot(&ab),
            ab.dot(&ac),
            ac.dot(&ac),
            p.dot(&ab),
            p.dot(&ac),
        );
        let det = d00 * d11 - d01 * d01;
        let (v, w) = ((d11 * d20 - d01 * d21) / det, (d00 * d21 - d01 * d20) / det);
        (t > 0.0 && v >= -1e-7 && w >= -1e-7 && v + w <= 1.0 + 1e-7).then_some(t)
    };
    triangles
        .iter()
        .filter_map(meets)
        .fold(f64::INFINITY, f64::min)
}

fn with_doors(meshes: &DoorMeshes, opening: f64) -> Vec<Triangle> {
    let mut all = triangles(&meshes.body, &Isometry3::identity());
    for door in &meshes.doors {
        all.extend(triangles(&door.mesh, &door.vehicle_from_mesh(opening)));
    }
    all
}

/// The car with all doors shut, and some removed.
fn without(meshes: &DoorMeshes, is_off: impl Fn(&Door) -> bool) -> Vec<Triangle> {
    let mut all = triangles(&meshes.body, &Isometry3::identity());
    for door in meshes.doors.iter().filter(|door| !is_off(door)) {
        all.extend(triangles(&door.mesh, &door.vehicle_from_mesh(0.0)));
    }
    all
}

/// Rays from both sides through a grid over the car's flank.
fn rays(shape: &VehicleShape) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let [half_x, half_y, half_z] = shape.half_m;
    let mut rays = Vec::new();
    for side in [1.0, -1.0] {
        for k in 0..40 {
            for l in 0..16 {
                let x = half_x * (-0.9 + 1.8 * (f64::from(k) + 0.37) / 40.0);
                let z = 2.0 * half_z * (f64::from(l) + 0.41) / 16.0;
                rays.push((
                    Point3::new(x, side * (half_y + 1.0), z),
                    Vector3::new(0.0, -side, 0.0),
                ));
            }
        }
    }
    rays
}

#[test]
fn shut_doors_are_the_skin_of_the_body() {
    for shape in shapes() {
        let plain = triangles(&vehicle_meshes(&shape).body, &Isometry3::identity());
        let shut = with_doors(&door_meshes(&shape).unwrap(), 0.0);
        let mut n_hits = 0;
        for (from, direction) in rays(&shape) {
            let (a, b) = (
                hit_m(&plain, from, direction),
                hit_m(&shut, from, direction),
            );
            // The door's handle stands out of the skin by 2 cm.
            assert!(
                a == b || (a - b).abs() < 0.021,
                "{:?} at {from}: {a} m without doors, {b} m with doors shut",
                shape.style
            );
            n_hits += usize::from(a.is_finite());
        }
        assert!(n_hits > 700, "{n_hits}");
    }
}

#[test]
fn open_doors_show_an_interior_and_stand_out_of_the_body() {
    for shape in shapes() {
        let meshes = door_meshes(&shape).unwrap();
        let plain = triangles(&vehicle_meshes(&shape).body, &Isometry3::identity());
        let open_on = [true, false].map(|left| without(&meshes, |door| door.left == left));
        let mut n_holes = 0;
        for (from, direction) in rays(&shape) {
            let hollow = &open_on[usize::from(from.y < 0.0)];
            let (a, b) = (
                hit_m(&plain, from, direction),
                hit_m(hollow, from, direction),
            );
            n_holes += usize::from(b > a + 0.1);
            assert_eq!(a.is_finite(), b.is_finite(), "{:?} at {from}", shape.style);
        }
        assert!(n_holes > 120, "{:?}: {n_holes} rays go in", shape.style);
        for door in &meshes.doors {
            let farthest = |opening: f64| {
                let all = triangles(&door.mesh, &door.vehicle_from_mesh(opening));
                all.iter()
                    .flatten()
                    .map(|corner| corner.y.abs())
                    .fold(0.0, f64::max)
            };
            let outwards = if door.left { 1.0 } else { -1.0 };
            assert!(door.hinge_m[1] * outwards > 0.0);
            assert!(
                farthest(0.0) < shape.half_m[1],
                "shut doors stay within the box"
            );
            assert!(farthest(1.0) > farthest(0.0) + 0.05);
            match door.motion {
                DoorMotion::Hinged => assert!(farthest(1.0) > farthest(0.3) + 0.3),
                DoorMotion::Sliding(length_m) => {
                    let moved = door.vehicle_from_mesh(1.0).translation.x
                        - door.vehicle_from_mesh(0.0).translation.x;
                    assert!(length_m > 0.8 && moved < -0.8, "{length_m} {moved}");
                }
            }
        }
    }
}

/// Through one open door no ray passes through the body: lining, bulkheads, floor and the other
/// doors close it.
#[test]
fn the_interior_is_closed() {
    for shape in shapes() {
        let meshes = door_meshes(&shape).unwrap();
        for door in &meshes.doors {
            let hollow = without(&meshes, |other| other.hinge_m == door.hinge_m);
            // The middle of the opening, half way up to the belt.
            let mesh = triangles(&door.mesh, &door.vehicle_from_mesh(0.0));
            let corners: Vec<&Point3<f64>> = mesh.iter().flatten().collect();
            let mean = corners
                .iter()
                .fold(Vector3::zeros(), |sum, corner| sum + corner.coords)
                / corners.len() as f64;
            let side = if door.left { 1.0 } else { -1.0 };
            for k in 0..9 {
                for l in 0..5 {
                    let direction = Vector3::new(
                        -0.8 + 0.2 * f64::from(k),
                        -side,
                        -0.25 - 0.15 * f64::from(l),
                    )
                    .normalize();
                    let from = Point3::from(mean) - direction * 0.4;
                    let hit = hit_m(&hollow, from, direction);
                    assert!(
                        hit.is_finite(),
                        "{:?}: from {from} towards {direction}",
                        shape.style
                    );
                }
            }
        }
    }
}

#[test]
fn bodies_without_such_doors_have_none() {
    for style in [
        BodyStyle::Bus,
        BodyStyle::Lorry,
        BodyStyle::Motorcycle,
        BodyStyle::Bicycle,
    ] {
        assert!(
            door_meshes(&VehicleShape {
                style,
                half_m: [3.0, 1.0, 1.0],
                wheel_radius_m: 0.4,
                wheelbase_m: 3.0
            })
            .is_none()
        );
    }
}
