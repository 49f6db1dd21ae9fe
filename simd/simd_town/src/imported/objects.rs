//! Objects of the map: what the file places beside the road, by its type, its sizes or its outline.

use nalgebra::{Point3, Vector3};
use schema_roads::RoadObject;
use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshId};

use super::builder::ImportBuilder;
use super::paint::{PAINT_M, patch};
use crate::geometry::{P2, area, cross, flat, left};
use crate::meshes::{street_lamps, trees};
use crate::scenery::{ALL, Key, Layer};

/// Outlines with more corners are drawn without a lid.
const MAX_LID: usize = 24;

/// How an object of a type looks.
struct Look {
    class: Class,
    material: Material,
    rgb: [u8; 3],
    /// Height of an object for which the file states none.
    height_m: f64,
    /// Whether vehicles run into it.
    solid: bool,
}

fn look(kind: &str) -> Option<Look> {
    let of = |class, material, rgb, height_m, solid| {
        Some(Look {
            class,
            material,
            rgb,
            height_m,
            solid,
        })
    };
    match kind {
        "building" => of(
            Class::BUILDINGS,
            Material::Facade,
            [196, 178, 150],
            8.0,
            true,
        ),
        "barrier" | "jerseyBarrier" | "concreteBarrier" => {
            of(Class::WALLS, Material::Concrete, [160, 158, 152], 0.9, true)
        }
        "soundBarrier" | "wall" => of(Class::WALLS, Material::Concrete, [150, 146, 138], 3.0, true),
        "railing" | "guardRail" | "guardrail" => of(
            Class::GUARD_RAIL,
            Material::Metal,
            [150, 154, 158],
            0.8,
            true,
        ),
        "fence" => of(Class::FENCES, Material::Metal, [120, 124, 120], 1.6, true),
        "pole" | "streetlamp" | "streetLamp" | "delineator" | "lamp" => {
            of(Class::POLES, Material::Metal, [110, 114, 118], 4.0, true)
        }
        "gantry" => of(Class::POLES, Material::Metal, [110, 114, 118], 6.0, false),
        "vegetation" | "tree" | "bush" | "hedge" => of(
            Class::VEGETATION,
            Material::Foliage,
            [84, 108, 50],
            1.4,
            false,
        ),
        "trafficIsland" | "island" | "curb" => of(
            Class::SIDEWALKS,
            Material::Concrete,
            [170, 166, 158],
            0.12,
            true,
        ),
        "obstacle" | "none" | "" | "-1" => {
            of(Class::STATIC, Material::Matte, [150, 150, 146], 0.0, true)
        }
        "car" | "van" | "bus" | "trailer" | "bike" | "motorbike" | "train" | "tram"
        | "pedestrian" | "wind" => None,
        "patch" => of(Class::ROADS, Material::Asphalt, [62, 62, 64], 0.0, false),
        _ => of(Class::STATIC, Material::Matte, [150, 150, 146], 0.0, true),
    }
}

/// Every object of the map.
pub(super) fn build(builder: &mut ImportBuilder) {
    let roads = builder.roads;
    let mut trees: Option<Vec<MeshId>> = None;
    let mut lamp: Option<MeshId> = None;
    for (idx, object) in roads.objects().iter().enumerate() {
        if !object.pose.translation.vector.iter().all(|x| x.is_finite()) {
            continue;
        }
        let name = if object.name.is_empty() {
            object.kind.as_str()
        } else {
            object.name.as_str()
        };
        match object.kind.as_str() {
            "parkingSpace" => parking_space(builder, object, name),
            "roadMark" | "roadSurface" => paint(builder, object, name),
            "tree" | "vegetation" if object.outline.is_empty() => {
                let trees = trees.get_or_insert_with(|| {
                    (0..trees::N_KINDS)
                        .map(|kind| builder.assets.add_mesh(trees::tree(kind)))
                        .collect()
                });
                let mesh = trees[idx % trees.len()];
                let at = builder.local(object.pose.translation.vector.into());
                let tree = builder.stand(mesh, Class::VEGETATION, name, at, idx as f64);
                builder.post(tree, at, 0.17, 4.0);
            }
            "streetlamp" | "streetLamp" | "lamp" => {
                let mesh = *lamp
                    .get_or_insert_with(|| builder.assets.add_mesh(street_lamps::street_lamp()));
                let at = builder.local(object.pose.translation.vector.into());
                // The arm reaches over the road: to the side that its reference line is on.
                let yaw = object.pose.rotation * -Vector3::y();
                builder.street_lamp(mesh, name, at, yaw.y.atan2(yaw.x));
            }
            kind => {
                if let Some(look) = look(kind) {
                    solid(builder, object, name, &look);
                }
            }
        }
    }
}

/// Corners of the foot, counter-clockwise, each with the object's height there.
fn outline(
    builder: &ImportBuilder,
    object: &RoadObject,
    look: &Look,
) -> Option<Vec<([f64; 3], f64)>> {
    let mut corners: Vec<([f64; 3], f64)> = if object.outline.len() >= 3 {
        let corners = object.outline.iter();
        corners
            .map(|corner| (corner.point_m, corner.height_m))
            .collect()
    } else {
        let (half_x, half_y) = if object.radius_m > 0.0 {
            (object.radius_m, object.radius_m)
        } else {
            (0.5 * object.length_m, 0.5 * object.width_m)
        };
        if half_x <= 0.0 && half_y <= 0.0 {
            return None;
        }
        // A side without a stated length is thin.
        let (half_x, half_y) = (half_x.max(0.05), half_y.max(0.05));
        let n = if object.radius_m > 0.0 { 8 } else { 4 };
        let at = |k: usize| {
            let a = std::f64::consts::TAU * (k as f64 + 0.5) / n as f64;
            if n == 4 {
                (half_x * a.cos().signum(), half_y * a.sin().signum())
            } else {
                (half_x * a.cos(), half_y * a.sin())
            }
        };
        (0..n)
            .map(|k| {
                (
                    (object.pose * Point3::new(at(k).0, at(k).1, 0.0))
                        .coords
                        .into(),
                    object.height_m,
                )
            })
            .collect()
    };
    for (p, height) in &mut corners {
        *p = builder.local(*p);
        if *height <= 0.0 {
            *height = look.height_m;
        }
    }
    corners.dedup_by(|a, b| (flat(a.0) - flat(b.0)).norm() < 1e-3);
    if corners.len() > 1 && (flat(corners[0].0) - flat(corners[corners.len() - 1].0)).norm() < 1e-3
    {
        corners.pop();
    }
    let ring: Vec<P2> = corners.iter().map(|c| flat(c.0)).collect();
    if corners.len() < 3
        || !corners
            .iter()
            .all(|(p, h)| p.iter().all(|x| x.is_finite()) && h.is_finite())
    {
        return None;
    }
    if area(&ring) < 0.0 {
        corners.reverse();
    }
    Some(corners)
}

fn solid(builder: &mut ImportBuilder, object: &RoadObject, name: &str, look: &Look) {
    let Some(corners) = outline(builder, object, look) else {
        return;
    };
    if corners.iter().all(|(_, height)| *height < 0.02) {
        return;
    }
    let id = builder.object(look.class, name);
    let surface = Surface::new(look.class, look.material, look.rgb).of(id);
    let key = Key::at(Layer::Building, flat(corners[0].0));
    let top = |(p, height): ([f64; 3], f64)| [p[0], p[1], p[2] + height];
    // Feet reach a little into the ground, since outlines seldom follow it.
    let foot = |(p, _): ([f64; 3], f64)| [p[0], p[1], p[2] - 0.3];
    let n = corners.len();
    for i in 0..n {
        let (a, b) = (corners[i], corners[(i + 1) % n]);
        let (u, v) = (
            (flat(a.0) - flat(b.0)).norm() as f32,
            (a.1.max(b.1) + 0.3) as f32,
        );
        let quad = [foot(a), foot(b), top(b), top(a)];
        builder.chunks.polygon(
            key,
            ALL,
            surface,
            &quad,
            &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]],
        );
        if look.solid {
            builder.solid.polygon(id, &quad);
        }
    }
    lid(
        builder,
        key,
        surface,
        &corners.iter().map(|c| top(*c)).collect::<Vec<_>>(),
        look.solid,
    );
}

fn lid(builder: &mut ImportBuilder, key: Key, surface: Surface, corners: &[[f64; 3]], solid: bool) {
    if corners.len() > MAX_LID {
        return;
    }
    let ring: Vec<P2> = corners.iter().map(|c| flat(*c)).collect();
    for triangle in triangulate(&ring) {
        let corners = triangle.map(|i| corners[i]);
        builder.chunks.polygon(
            key,
            ALL,
            surface,
            &corners,
            &corners.map(|c| [c[0] as f32, c[1] as f32]),
        );
        if solid {
            builder.solid.polygon(surface.object, &corners);
        }
    }
}

/// Lines round a bay.
fn parking_space(builder: &mut ImportBuilder, object: &RoadObject, name: &str) {
    let look = Look {
        class: Class::ROAD_LINES,
        material: Material::Paint,
        rgb: [226, 226, 220],
        height_m: 0.0,
        solid: false,
    };
    let Some(corners) = outline(builder, object, &look) else {
        return;
    };
    let id = builder.object(Class::ROAD_LINES, name);
    let surface = Surface::new(look.class, look.material, look.rgb).of(id);
    let n = corners.len();
    for i in 0..n {
        let (a, b) = (flat(corners[i].0), flat(corners[(i + 1) % n].0));
        let Some(along) = (b - a).try_normalize(1e-6) else {
            continue;
        };
        let inward = left(along) * 0.1;
        let quad = [a, b, b + inward, a + inward];
        lie(builder, surface, &quad);
    }
}

/// A painted area.
fn paint(builder: &mut ImportBuilder, object: &RoadObject, name: &str) {
    let look = Look {
        class: Class::ROAD_LINES,
        material: Material::Paint,
        rgb: [226, 226, 220],
        height_m: 0.0,
        solid: false,
    };
    let Some(corners) = outline(builder, object, &look).filter(|c| c.len() <= MAX_LID) else {
        return;
    };
    let id: ObjectId = builder.object(Class::ROAD_LINES, name);
    let surface = Surface::new(look.class, look.material, look.rgb).of(id);
    let ring: Vec<P2> = corners.iter().map(|c| flat(c.0)).collect();
    for triangle in triangulate(&ring) {
        lie(builder, surface, &triangle.map(|i| ring[i]));
    }
}

fn lie(builder: &mut ImportBuilder, surface: Surface, ring: &[P2]) {
    let mut corners: Vec<[f64; 3]> = ring
        .iter()
        .map(|p| [p.x, p.y, builder.floor(*p) + PAINT_M + 0.002])
        .collect();
    let area: f64 = (0..ring.len())
        .map(|i| cross(ring[i], ring[(i + 1) % ring.len()]))
        .sum();
    if area < 0.0 {
        corners.reverse();
    }
    patch(builder, surface, &corners, 0..=0);
}

/// Cuts a simple polygon (counter-clockwise, few corners) into triangles: ear by ear.
fn triangulate(polygon: &[P2]) -> Vec<[usize; 3]> {
    let turn = |[a, b, c]: [usize; 3]| cross(polygon[b] - polygon[a], polygon[c] - polygon[a]);
    let mut left: Vec<usize> = (0..polygon.len()).collect();
    let mut triangles = Vec::new();
    while left.len() > 3 {
        let n = left.len();
        let corner = |k: usize| [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
        let is_ear = |k: usize| {
            let [a, b, c] = corner(k);
            let holds = |i: usize| {
                turn([a, b, i]) >= 0.0 && turn([b, c, i]) >= 0.0 && turn([c, a, i]) >= 0.0
            };
            turn([a, b, c]) > 1e-9 && !left.iter().any(|i| ![a, b, c].contains(i) && holds(*i))
        };
        // A corner without a turn adds no area; an outline that crosses itself has no ears left at
        // some point.
        let Some(k) = (0..n)
            .find(|k| is_ear(*k))
            .or_else(|| (0..n).find(|k| turn(corner(*k)).abs() <= 1e-9))
        else {
            break;
        };
        if turn(corner(k)) > 1e-9 {
            triangles.push(corner(k));
        }
        left.remove(k);
    }
    if let [a, b, c] = left[..] {
        triangles.push([a, b, c]);
    }
    triangles
}
