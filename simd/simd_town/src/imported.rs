//! A world for any road map: surfaces, kerbs, paint, ground, signals, houses and trees, derived
//! from the lanes alone.
//!
//! Everything is built in coordinates about the middle of the map and moved into place at the end,
//! so that maps far from the origin lose no precision.

mod builder;
mod cover;
mod fairing;
mod ground;
mod height_grid;
mod junction_heights;
mod objects;
mod options;
mod paint;
mod roadside;
mod signals;
mod surface;

use nalgebra::{Translation3, Vector3};
use schema_roads::{RoadMap, SectionSurface, SurfaceSteps};

use crate::meshes::signals::light_head;
use crate::town::{Town, TownError};
use builder::ImportBuilder;
use cover::Cover;
use height_grid::HeightGrid;
pub use options::ImportOptions;

/// Most points of all surfaces: about a thousand kilometres of streets.
const MAX_POINTS: usize = 8_000_000;

/// Width from which a map is large.
const LARGE_M: f64 = 3000.0;

/// The world of a map. `open_drive` is the text that `roads` was read from; the same text, seed and
/// options give the same bytes.
///
/// # Errors
/// [`TownError::TooLarge`].
pub fn import(
    name: &str,
    open_drive: &str,
    roads: &RoadMap,
    seed: u64,
    options: &ImportOptions,
) -> Result<Town, TownError> {
    let steps = SurfaceSteps {
        max_step_m: options.vertex_distance_m.clamp(0.5, 20.0),
        junction_extra_m: options.junction_extra_m.clamp(0.0, 5.0),
        max_points: MAX_POINTS,
        ..SurfaceSteps::default()
    };
    let mut sections = roads
        .surfaces(&steps)
        .map_err(|error| TownError::TooLarge {
            name: name.to_owned(),
            reason: error.to_string(),
        })?;
    let origin = origin(&sections);
    move_by(&mut sections, -origin);
    surface::name_kerbs(&mut sections);
    surface::raise_pavements(&mut sections);
    junction_heights::level(&mut sections);
    let cover = Cover::new(&sections);
    let ground = HeightGrid::new(&sections);
    let mut builder = ImportBuilder::new(roads, origin, seed, *options, cover, ground);
    surface::build(&mut builder, &sections);
    paint::build(&mut builder, &sections);
    ground::build(&mut builder);
    if is_large(&sections) {
        ground::backdrop(&mut builder);
    }
    objects::build(&mut builder);
    signals::build(&mut builder, &sections);
    if options.roadside {
        roadside::build(&mut builder, &sections);
    }
    let mut parts = builder.finish();
    parts.assets.streamed = is_large(&sections);
    if !options.visible {
        parts.assets.statics.clear();
    }
    let shift = Translation3::from(origin);
    for each in &mut parts.assets.statics {
        each.world_from_mesh = shift * each.world_from_mesh;
    }
    let moved = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| p[i] + origin[i]) };
    for object in &mut parts.objects {
        object.pose.translation_m = moved(object.pose.translation_m);
        object.box_pose.translation_m = moved(object.box_pose.translation_m);
    }
    parts
        .lamps
        .iter_mut()
        .for_each(|lamp| lamp.position_m = moved(lamp.position_m));
    for light in &mut parts.lights {
        light.pole.translation_m = moved(light.pole.translation_m);
        light
            .heads
            .iter_mut()
            .for_each(|head| *head = shift * *head);
    }
    Ok(Town {
        name: name.to_owned(),
        open_drive: open_drive.to_owned(),
        spawn_points: roads.spawn_points(),
        assets: parts.assets,
        objects: parts.objects,
        lamps: parts.lamps,
        lights: parts.lights,
        light_head: light_head(),
        collision: parts.collision,
        origin_m: origin.into(),
    })
}

/// Whether a map is so wide that sensors get the scenery near them only.
fn is_large(sections: &[SectionSurface]) -> bool {
    let points = || sections.iter().flat_map(|section| &section.centre_m);
    (0..2).any(|axis| {
        let (low, high) = points().fold((f64::MAX, f64::MIN), |(low, high), p| {
            (low.min(p[axis]), high.max(p[axis]))
        });
        high - low > LARGE_M
    })
}

/// The middle of all surfaces, in whole metres.
fn origin(sections: &[SectionSurface]) -> Vector3<f64> {
    let (mut low, mut high) = (
        Vector3::repeat(f64::INFINITY),
        Vector3::repeat(f64::NEG_INFINITY),
    );
    for point in sections.iter().flat_map(|section| {
        section
            .centre_m
            .iter()
            .chain(section.lanes.iter().flat_map(|lane| &lane.points_m))
    }) {
        let point = Vector3::from(*point);
        (low, high) = (low.inf(&point), high.sup(&point));
    }
    let middle = 0.5 * (low + high);
    if middle.iter().all(|x| x.is_finite()) {
        middle.map(f64::round)
    } else {
        Vector3::zeros()
    }
}

fn move_by(sections: &mut [SectionSurface], by: Vector3<f64>) {
    for section in sections {
        let lanes = section.lanes.iter_mut().flat_map(|lane| &mut lane.points_m);
        for point in section.centre_m.iter_mut().chain(lanes) {
            *point = (Vector3::from(*point) + by).into();
        }
    }
}
