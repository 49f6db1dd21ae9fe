//! Objects in an image as COCO and YOLO want them: one per actor or object of the map and category.

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::Modality;

use crate::classes;
use crate::exporter::{Format, missing};
use crate::options::Options;
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::TickSet;
use consumer_truth::{Body, BoxTruth, Camera, Images, Mask, bodies, box_truths, segments};

/// An object that some pixels show.
#[derive(Clone, Debug)]
pub struct Object {
    /// Object id: an actor's, or with bit 31 that of an object of the map.
    pub id: u32,
    /// COCO's id of its category.
    pub category: u8,
    /// Its pixels.
    pub mask: Mask,
    /// Its body, if it has a box in space, and the rest of the truth about it.
    pub body: Option<(Body, BoxTruth)>,
}

/// Cameras of a scenario that have colour and instance images.
///
/// # Errors
/// A sentence if there are none, or a camera that was asked for has none.
pub fn cameras<'a>(
    format: Format,
    scenario: &'a Scenario,
    options: &Options,
) -> anyhow::Result<Vec<&'a Sensor>> {
    let fits = |camera: &&Sensor| camera.has(Modality::Rgb) && camera.has(Modality::Instance);
    let cameras = scenario.cameras(&options.cameras)?;
    for camera in &cameras {
        if !options.cameras.is_empty() && !fits(camera) {
            return Err(launch_cli::wrong_usage(format!(
                "{} needs the modalities rgb and instance of camera {:?}; {} has {}",
                format.name(),
                camera.name,
                scenario.name,
                scenario.topic_list()
            )));
        }
    }
    let cameras: Vec<_> = cameras.into_iter().filter(fits).collect();
    if cameras.is_empty() {
        let needed = "a camera with the modalities rgb and instance";
        let any = [Modality::Rgb, Modality::Instance];
        return Err(missing(format, scenario, needed, &any));
    }
    Ok(cameras)
}

/// Whether a topic is one of such a camera, and read.
pub fn wants(format: Format, scenario: &Scenario, topic: &Topic, options: &Options) -> bool {
    use Modality::{Depth, Instance, Rgb, Semantic};
    let cameras = cameras(format, scenario, options).unwrap_or_default();
    matches!(topic.modality, Rgb | Instance | Semantic | Depth)
        && cameras.iter().any(|camera| camera.name == *topic.sensor)
}

/// Topics whose frames make a tick a keyframe: those of the first such camera.
pub fn keys(format: Format, scenario: &Scenario, options: &Options) -> Vec<Arc<str>> {
    let cameras = cameras(format, scenario, options).unwrap_or_default();
    let first = cameras.first();
    [Modality::Rgb, Modality::Instance]
        .into_iter()
        .filter_map(|modality| Some(first?.topic(modality)?.name.clone()))
        .collect()
}

/// Objects that a camera shows in a tick, by id and category; those with fewer pixels than
/// `min_pixels` are left out.
///
/// With a semantic image each pixel's class decides, so a motorcycle and its rider are two objects,
/// and objects of the map (parked cars, signals) are there too. Without one, classes are those of
/// the actors, and objects of the map are left out, because nothing tells what they are.
pub fn objects(scenario: &Scenario, tick: &TickSet, camera: &str, min_pixels: u64) -> Vec<Object> {
    let Some(frame) = tick.frame(camera, Modality::Instance) else {
        return Vec::new();
    };
    let width = frame.header.width;
    let ids: Vec<u32> = frame.elements();
    let classes: Option<Vec<u8>> = tick.frame(camera, Modality::Semantic).map(|f| f.elements());
    let depth: Option<Vec<f32>> = tick.frame(camera, Modality::Depth).map(|f| f.elements());
    let size = (width, frame.header.height);
    let same_size = |modality| {
        let other = tick.frame(camera, modality);
        other.is_none_or(|other| (other.header.width, other.header.height) == size)
    };
    let classes = classes.filter(|_| same_size(Modality::Semantic));
    let depth = depth.filter(|_| same_size(Modality::Depth));
    let world = tick.world.as_deref();
    let all = world.map_or_else(Vec::new, |world| bodies(world, scenario.carrier_id));
    let images = Images {
        instance: Some(&ids),
        depth: depth.as_deref(),
    };
    let truths = box_truths(&Camera::of(&frame.header), &all, images);
    let class_of_actor = |id: u32| {
        world
            .and_then(|world| world.record(id))
            .map(|record| record.class)
    };
    let mut found: BTreeMap<(u32, u8), (u64, [u32; 4])> = BTreeMap::new();
    for segment in segments(&ids, classes.as_deref(), width) {
        let class = segment.class.or_else(|| class_of_actor(segment.id));
        let Some(category) = class.and_then(|class| classes::of(class).coco) else {
            continue;
        };
        if segment.id == scenario.carrier_id {
            continue;
        }
        let b = segment.bounds;
        let (n, bounds) = found.entry((segment.id, category)).or_insert((0, b));
        *n += segment.n_pixels;
        *bounds = [
            bounds[0].min(b[0]),
            bounds[1].min(b[1]),
            bounds[2].max(b[2]),
            bounds[3].max(b[3]),
        ];
    }
    found
        .into_iter()
        .filter(|(_, (n_pixels, _))| *n_pixels >= min_pixels.max(1))
        .map(|((id, category), (_, bounds))| {
            let shows = |column: u32, row: u32| {
                let at = row as usize * width as usize + column as usize;
                let class = classes.as_ref().map(|classes| classes[at]);
                ids[at] == id && class.is_none_or(|class| classes::of(class).coco == Some(category))
            };
            let truth = truths.iter().find(|truth| all[truth.body].id == id);
            Object {
                id,
                category,
                mask: Mask::new(bounds, shows),
                body: truth.map(|truth| (all[truth.body].clone(), truth.clone())),
            }
        })
        .collect()
}

/// Name of an image, without ending: scenario, camera, number of the keyframe.
pub fn image_name(scenario: &Scenario, camera: &str, key: u64) -> String {
    format!("{}_{camera}_{key:06}", scenario.name)
}
