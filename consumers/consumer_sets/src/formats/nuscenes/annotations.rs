//! nuScenes' annotations: one per body and keyframe, linked over time.

use std::collections::{BTreeMap, HashMap};

use nalgebra::Translation3;
use schema_frames::{FrameHeader, Modality, RadarDetection};
use serde_json::{Value, json};

use super::channels::Channel;
use super::tables::{Tables, pose_json, token};
use crate::classes;
use crate::formats::family::Cloud;
use consumer_truth::scenario::Scenario;
use consumer_truth::ticks::TickSet;
use consumer_truth::{Body, Camera, Images, PointCounts, bodies, box_truths};

/// Annotations whose successors are not known yet: the last one of each instance.
#[derive(Debug, Default)]
pub struct Annotations {
    open: BTreeMap<u32, Open>,
}

#[derive(Debug)]
struct Open {
    instance: String,
    category: String,
    first: String,
    n: u64,
    /// The last row, without its successor.
    row: Value,
}

impl Annotations {
    /// Adds a keyframe's annotations: of every body that a camera sees, or that a point of a lidar
    /// or radar lies in.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    #[allow(clippy::too_many_arguments, reason = "what a keyframe consists of")]
    pub fn add(
        &mut self,
        scenario: &Scenario,
        tick: &TickSet,
        sample: &str,
        clouds: &[(String, FrameHeader, Cloud)],
        channels: &[Channel],
        global_from_world: &Translation3<f64>,
        tables: &mut Tables,
    ) -> anyhow::Result<()> {
        let Some(world) = tick.world.as_deref() else {
            return Ok(());
        };
        let all = bodies(world, scenario.carrier_id);
        let lidar = clouds.iter().find(|(channel, ..)| channel == "LIDAR_TOP");
        let n_lidar = lidar.map_or_else(
            || vec![0; all.len()],
            |(_, header, cloud)| {
                let place = header.world_from_sensor.isometry();
                PointCounts::count(&cloud.points_m, None, &place, &all).in_box
            },
        );
        let n_radar = radar_points(tick, channels, &all);
        let visible = visible(tick, channels, &all);
        for (at, body) in all.iter().enumerate() {
            let seen = visible.as_ref().map(|visible| visible[at]);
            if n_lidar[at] == 0 && n_radar[at] == 0 && seen.is_none_or(|seen| seen == 0.0) {
                continue;
            }
            let id = body.id.to_string();
            let own = token(&["sample_annotation", &scenario.name, &id, sample]);
            let (translation, rotation) = pose_json(&(global_from_world * body.world_from_box));
            let [length, width, height] = body.size_m();
            let attributes: Vec<String> = classes::nuscenes_attribute(body)
                .map(|at| token(&["attribute", classes::NUSCENES_ATTRIBUTES[at].0]))
                .into_iter()
                .collect();
            let instance = token(&["instance", &scenario.name, &id]);
            let mut row = json!({
                "token": own, "sample_token": sample, "instance_token": instance,
                "visibility_token": seen.map_or("", level), "attribute_tokens": attributes,
                "translation": translation, "size": [width, length, height], "rotation": rotation,
                "prev": "", "num_lidar_pts": n_lidar[at], "num_radar_pts": n_radar[at],
            });
            match self.open.get_mut(&body.id) {
                Some(open) => {
                    row["prev"] = open.row["token"].clone();
                    let mut before = std::mem::replace(&mut open.row, row);
                    before["next"] = json!(own);
                    tables.write("sample_annotation", &before)?;
                    open.n += 1;
                }
                None => {
                    let name = classes::NUSCENES[usize::from(classes::nuscenes(body))];
                    let category = token(&["category", name]);
                    self.open.insert(
                        body.id,
                        Open {
                            instance,
                            category,
                            first: own,
                            n: 1,
                            row,
                        },
                    );
                }
            }
        }
        Ok(())
    }

    /// Writes the last annotation of each instance, and the instances.
    ///
    /// # Errors
    /// A sentence if the disk refuses.
    pub fn finish(&mut self, tables: &mut Tables) -> anyhow::Result<()> {
        for mut open in std::mem::take(&mut self.open).into_values() {
            open.row["next"] = json!("");
            tables.write("sample_annotation", &open.row)?;
            tables.write("instance", &json!({
                "token": open.instance, "category_token": open.category, "nbr_annotations": open.n,
                "first_annotation_token": open.first, "last_annotation_token": open.row["token"],
            }))?;
        }
        Ok(())
    }
}

/// nuScenes' four levels of the share that all cameras together see.
fn level(share: f64) -> &'static str {
    match share {
        low if low < 0.4 => "1",
        low if low < 0.6 => "2",
        low if low < 0.8 => "3",
        _ => "4",
    }
}

/// Share of each body that the cameras see together: pixels of its hulls that nothing covers over
/// all pixels of its hulls, in all images; 0 if no pixel shows it. `None` without instance images.
fn visible(tick: &TickSet, channels: &[Channel], all: &[Body]) -> Option<Vec<f64>> {
    let mut sums = vec![(0u64, 0u64, 0u64); all.len()];
    let mut any = false;
    for channel in channels
        .iter()
        .filter(|channel| channel.modality == "camera")
    {
        let Some(frame) = tick.frame(&channel.sensor, Modality::Instance) else {
            continue;
        };
        any = true;
        let ids: Vec<u32> = frame.elements();
        let size = (frame.header.width, frame.header.height);
        let depth = tick.frame(&channel.sensor, Modality::Depth);
        let depth: Option<Vec<f32>> = depth
            .filter(|depth| (depth.header.width, depth.header.height) == size)
            .map(|depth| depth.elements());
        let images = Images {
            instance: Some(&ids),
            depth: depth.as_deref(),
        };
        for truth in box_truths(&Camera::of(&frame.header), all, images) {
            let Some(seen) = truth.seen else { continue };
            let (pixels, hull, covered) = &mut sums[truth.body];
            *pixels += seen.pixels;
            *hull += truth.hull_pixels;
            *covered += seen.covered_pixels;
        }
    }
    let share = |(pixels, hull, covered): (u64, u64, u64)| match (pixels, hull) {
        (0, _) => 0.0,
        // All of its pixels stick out of its box.
        (_, 0) => 1.0,
        _ => 1.0 - covered as f64 / hull as f64,
    };
    any.then(|| sums.into_iter().map(share).collect())
}

fn radar_points(tick: &TickSet, channels: &[Channel], all: &[Body]) -> Vec<u32> {
    let mut counts = vec![0; all.len()];
    for channel in channels
        .iter()
        .filter(|channel| channel.modality == "radar")
    {
        let Some(frame) = tick.frame(&channel.sensor, Modality::Radar) else {
            continue;
        };
        let detections = frame.elements::<RadarDetection>();
        let points: Vec<[f32; 3]> = detections.iter().map(super::radar::point_m).collect();
        let place = frame.header.world_from_sensor.isometry();
        let counted = PointCounts::count(&points, None, &place, all).in_box;
        counts
            .iter_mut()
            .zip(counted)
            .for_each(|(sum, n)| *sum += n);
    }
    counts
}

/// Labels of lidarseg, a byte per point; `None` for a cloud without ids.
pub fn point_labels(scenario: &Scenario, tick: &TickSet, cloud: &Cloud) -> Option<Vec<u8>> {
    let (ids, point_classes) = (cloud.ids.as_ref()?, cloud.classes.as_ref()?);
    let all = tick
        .world
        .as_deref()
        .map_or_else(Vec::new, |world| bodies(world, scenario.carrier_id));
    let categories: HashMap<u32, u8> = all
        .iter()
        .map(|body| (body.id, classes::nuscenes(body)))
        .collect();
    let label = |(id, class): (&u32, &u8)| match categories.get(id) {
        Some(category) => *category,
        None if *id == scenario.carrier_id && *id != 0 => 31,
        None => classes::of(*class).lidarseg,
    };
    Some(ids.iter().zip(point_classes).map(label).collect())
}
