//! Front gardens: hedges, fences and low walls between house and pavement, with a path to the door.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::entrance;
use super::lot::Lot;
use crate::geometry::{P2, left};
use crate::network::KERB_HEIGHT_M;
use crate::plan::Houses;
use crate::random::Random;
use crate::scenery::{Builder, Key, Layer, MapLayer};

/// What stands at the edge of a garden.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Edging {
    Hedge,
    Fence,
    Wall,
}

/// Builds the front of one lot, and the door of the house that stands on it.
pub fn build(
    builder: &mut Builder<'_>,
    lot: &Lot,
    house: ObjectId,
    houses: Houses,
    random: &mut Random,
) {
    let f = lot.footprint_m;
    let (along, out) = ((f[1] - f[0]).normalize(), (f[0] - f[3]).normalize());
    let deep = if houses == Houses::Farms { 4.9 } else { 2.6 };
    let edging = random.pick(&[
        Edging::Hedge,
        Edging::Hedge,
        Edging::Fence,
        Edging::Fence,
        Edging::Wall,
    ]);
    let width = (f[1] - f[0]).norm();
    let gate = width * random.between(0.35, 0.65);
    let corner = |u: f64, d: f64| f[0] + along * u + out * d;
    let runs = [
        (corner(-1.0, deep), corner(gate - 0.7, deep)),
        (corner(gate + 0.7, deep), corner(width + 1.0, deep)),
        (corner(-1.0, 0.0), corner(-1.0, deep)),
        (corner(width + 1.0, deep), corner(width + 1.0, 0.0)),
    ];
    for (from, to) in runs {
        run(builder, edging, from, to);
    }
    // A path of slabs from the gate to the door.
    let object = builder.object_in(Some(MapLayer::Props), Class::SIDEWALKS, "garden_path");
    let slab = Surface::new(Class::SIDEWALKS, Material::Concrete, [150, 142, 130]).of(object);
    let lift = |p: P2, builder: &Builder<'_>| {
        [
            p.x,
            p.y,
            builder.chunks.terrain.at(p) + KERB_HEIGHT_M + 0.015,
        ]
    };
    let corners = [
        corner(gate - 0.55, deep + 0.2),
        corner(gate + 0.55, deep + 0.2),
        corner(gate + 0.55, 0.0),
        corner(gate - 0.55, 0.0),
    ];
    let corners = corners.map(|p| lift(p, builder));
    builder.chunks.sheet(Layer::Ground, 0..=1, slab, &corners);
    entrance::build(&mut builder.chunks, lot, gate, house);
}

/// Adds one straight piece of hedge, fence or wall.
fn run(builder: &mut Builder<'_>, edging: Edging, from: P2, to: P2) {
    let length = (to - from).norm();
    if length < 0.5 {
        return;
    }
    let (layer, class, name) = match edging {
        Edging::Hedge => (MapLayer::Foliage, Class::VEGETATION, "hedge"),
        Edging::Fence => (MapLayer::Walls, Class::FENCES, "fence"),
        Edging::Wall => (MapLayer::Walls, Class::WALLS, "wall"),
    };
    let object = builder.object_in(Some(layer), class, name);
    let key = Key::at(Layer::Small, 0.5 * (from + to));
    let (u, v) = ((to - from) / length, left((to - from) / length));
    let (za, zb) = (
        builder.chunks.terrain.at(from),
        builder.chunks.terrain.at(to),
    );
    let low = za.min(zb) + KERB_HEIGHT_M - 0.1;
    let top = za.max(zb) + KERB_HEIGHT_M;
    let bar = |from_m: f64, to_m: f64, half: f64| {
        [
            from + u * from_m - v * half,
            from + u * to_m - v * half,
            from + u * to_m + v * half,
            from + u * from_m + v * half,
        ]
    };
    match edging {
        Edging::Hedge => {
            let leaves = Surface::new(class, Material::Foliage, [64, 96, 44]).of(object);
            builder.chunks.prism(
                key,
                0..=2,
                leaves,
                &bar(0.0, length, 0.3),
                (low, top + 1.05),
            );
        }
        Edging::Wall => {
            let stone = Surface::new(class, Material::Concrete, [150, 128, 108]).of(object);
            let cap = Surface::new(class, Material::Concrete, [176, 172, 164]).of(object);
            builder.chunks.prism(
                key,
                0..=2,
                stone,
                &bar(0.0, length, 0.12),
                (low, top + 0.75),
            );
            builder.chunks.prism(
                key,
                0..=1,
                cap,
                &bar(-0.03, length + 0.03, 0.16),
                (top + 0.75, top + 0.82),
            );
        }
        Edging::Fence => {
            let wood = Surface::new(class, Material::Matte, [214, 208, 196]).of(object);
            let n = (length / 0.27) as usize;
            for k in 0..n {
                let s = (k as f64 + 0.5) * length / n as f64;
                for flip in [false, true] {
                    let (p, q) = (from + u * (s - 0.05), from + u * (s + 0.05));
                    let ends = if flip { (q, p) } else { (p, q) };
                    builder
                        .chunks
                        .wall(key, 0..=0, wood, ends, (low, top + 0.92), 0.0);
                }
            }
            for z in [0.28, 0.7] {
                builder.chunks.prism(
                    key,
                    0..=0,
                    wood,
                    &bar(0.0, length, 0.025),
                    (top + z, top + z + 0.07),
                );
            }
            for flip in [false, true] {
                let ends = if flip { (to, from) } else { (from, to) };
                builder
                    .chunks
                    .wall(key, 1..=2, wood, ends, (low, top + 0.9), 0.0);
            }
        }
    }
    builder
        .solid
        .prism(object, &bar(0.0, length, 0.12), (low, top + 0.8));
}
