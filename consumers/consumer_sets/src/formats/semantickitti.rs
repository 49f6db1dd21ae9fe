//! SemanticKITTI: `sequences/NN/` with clouds, labels, poses and times, and the label map
//! `semantic-kitti.yaml`. The same sequences are KITTI odometry's, with `poses/NN.txt`.
//!
//! Poses are those of the first camera, or without one of the lidar, relative to the first frame.

mod yaml;

use std::collections::HashMap;
use std::io::Write as _;
use std::sync::Arc;

use anyhow::Context as _;
use nalgebra::Isometry3;
use schema_frames::Modality;
use serde_json::{Value, json};

use super::family::{Cloud, first_topic, matrix, projection, row34, with_intensities};
use crate::classes;
use crate::exporter::{DoneScenario, Exporter, Format, missing};
use crate::options::Options;
use crate::picture;
use crate::tree::{Job, PartFile, Tree};
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::{TickFrame, TickSet};
use consumer_truth::{Body, bodies};

/// Writes SemanticKITTI.
pub struct SemanticKitti {
    options: Options,
    n_here: u64,
    /// Instance numbers by object, from 1.
    instances: HashMap<u32, u16>,
    /// Pose of the reference at the first frame, and its time.
    first: Option<(Isometry3<f64>, u64)>,
    files: Option<Files>,
}

struct Files {
    poses: PartFile,
    times: PartFile,
}

/// Folder of a sequence.
fn folder(index: u32) -> String {
    format!("sequences/{index:02}")
}

/// Clouds whose points have labels.
const LABELLED: [Modality; 2] = [Modality::SemanticLidar, Modality::LidarReturns];

fn cloud_topic(scenario: &Scenario) -> Option<(&Sensor, &Topic)> {
    first_topic(scenario, &LABELLED)
}

impl SemanticKitti {
    /// Nothing is written yet.
    pub fn new(options: &Options) -> SemanticKitti {
        SemanticKitti {
            options: options.clone(),
            n_here: 0,
            instances: HashMap::new(),
            first: None,
            files: None,
        }
    }

    /// The camera of `image_2`, if there is one.
    fn camera<'a>(&self, scenario: &'a Scenario) -> anyhow::Result<Option<&'a Sensor>> {
        let cameras = scenario.cameras(&self.options.cameras)?;
        let mut cameras = cameras
            .into_iter()
            .filter(|camera| camera.has(Modality::Rgb));
        let first = cameras.clone().find(|camera| camera.name == "front");
        Ok(match self.options.cameras.is_empty() {
            true => first.or_else(|| cameras.next()),
            false => cameras.next(),
        })
    }
}

impl Exporter for SemanticKitti {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        self.camera(scenario)?;
        if cloud_topic(scenario).is_none() {
            let needed = "a semantic lidar (kind lidar with semantic = true or returns = true)";
            return Err(missing(Format::SemanticKitti, scenario, needed, &LABELLED));
        }
        Ok(())
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        let camera = self.camera(scenario).ok().flatten();
        let of_camera = camera.is_some_and(|camera| camera.name == *topic.sensor);
        (topic.modality == Modality::Rgb && of_camera)
            || topic.modality == Modality::Lidar
            || cloud_topic(scenario).is_some_and(|(_, lidar)| lidar.name == topic.name)
    }

    fn keys(&self, scenario: &Scenario) -> Vec<Arc<str>> {
        cloud_topic(scenario)
            .map(|(_, topic)| topic.name.clone())
            .into_iter()
            .collect()
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        _: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        self.n_here = 0;
        self.instances.clear();
        self.first = None;
        let folder = folder(scenario.index);
        let (lidar, _) = cloud_topic(scenario).context("the semantic lidar is gone")?;
        let camera = self.camera(scenario)?;
        let reference = reference(lidar, camera);
        let projection = camera.map_or_else(nalgebra::Matrix4::identity, |camera| {
            projection(camera, &Isometry3::identity())
        });
        let camera_from_lidar = reference.inverse() * lidar.carrier_from_sensor;
        let mut text = String::new();
        for number in 0..4 {
            text += &format!("P{number}: {}\n", row34(&projection));
        }
        text += &format!("Tr: {}\n", row34(&matrix(&camera_from_lidar)));
        tree.write(&format!("{folder}/calib.txt"), || Ok(text.into_bytes()))?;
        self.files = Some(Files {
            poses: tree.begin(&format!("{folder}/poses.txt"))?,
            times: tree.begin(&format!("{folder}/times.txt"))?,
        });
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        if tick.key.is_none() {
            return Ok(());
        }
        let (Some((lidar, topic)), Some(world)) = (cloud_topic(scenario), &tick.world) else {
            return Ok(());
        };
        let Some(frame) = tick.frame(&lidar.name, topic.modality) else {
            return Ok(());
        };
        let camera = self.camera(scenario)?;
        let cloud = with_intensities(Cloud::of(frame), frame, tick);
        let labels = self.labels(&cloud, &bodies(world, scenario.carrier_id));
        let name = format!("{:06}", self.n_here);
        let folder = folder(scenario.index);
        let mut jobs = vec![
            Job::new(format!("{folder}/velodyne/{name}.bin"), || {
                Ok(cloud.velodyne())
            }),
            Job::new(format!("{folder}/labels/{name}.label"), move || Ok(labels)),
        ];
        let form = self.options.images;
        let colour = camera.and_then(|camera| tick.frame(&camera.name, Modality::Rgb));
        if let Some(colour) = colour {
            let path = format!("{folder}/image_2/{name}.{}", form.ending());
            jobs.push(Job::new(path, move || picture::colour(colour, form)));
        }
        tree.write_all(jobs)?;
        self.write_pose(frame, lidar, camera)?;
        self.n_here = self.n_here.saturating_add(1);
        Ok(())
    }

    fn end(&mut self, scenario: &Scenario, tree: &Tree) -> anyhow::Result<Value> {
        let files = self.files.take().expect("a scenario has begun");
        files.poses.finish()?;
        files.times.finish()?;
        // KITTI odometry keeps them apart from the sequences.
        let of = format!("{}/poses.txt", folder(scenario.index));
        tree.link(&of, &format!("poses/{:02}.txt", scenario.index))?;
        Ok(json!({"frames": self.n_here}))
    }

    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()> {
        tree.write("semantic-kitti.yaml", || {
            Ok(yaml::label_map(done).into_bytes())
        })
    }
}

/// The carrier's coordinates of what poses are poses of.
fn reference(lidar: &Sensor, camera: Option<&Sensor>) -> Isometry3<f64> {
    camera.map_or(lidar.carrier_from_sensor, |camera| {
        camera.carrier_from_camera()
    })
}

impl SemanticKitti {
    /// Instance in the upper, class in the lower 16 bits. Actors and cars of the map have instances;
    /// numbers begin again after 65535.
    fn labels(&mut self, cloud: &Cloud, bodies: &[Body]) -> Vec<u8> {
        let (Some(ids), Some(classes)) = (&cloud.ids, &cloud.classes) else {
            return Vec::new();
        };
        let by_id: HashMap<u32, &Body> = bodies.iter().map(|body| (body.id, body)).collect();
        let mut bytes = Vec::with_capacity(ids.len() * 4);
        for (id, class) in ids.iter().zip(classes) {
            let label = classes::semantickitti(*class, by_id.get(id).copied());
            let is_thing = matches!(class, 12..=19);
            let instance = if is_thing && *id != 0 {
                let next = (self.instances.len() % 65535) as u16 + 1;
                *self.instances.entry(*id).or_insert(next)
            } else {
                0
            };
            bytes.extend((u32::from(instance) << 16 | u32::from(label)).to_le_bytes());
        }
        bytes
    }

    fn write_pose(
        &mut self,
        frame: &TickFrame,
        lidar: &Sensor,
        camera: Option<&Sensor>,
    ) -> anyhow::Result<()> {
        let lidar_from_reference = lidar.carrier_from_sensor.inverse() * reference(lidar, camera);
        let world_from_reference = frame.header.world_from_sensor.isometry() * lidar_from_reference;
        let now = frame.header.sim_nanos;
        let (first, start) = *self.first.get_or_insert((world_from_reference, now));
        let pose = first.inverse() * world_from_reference;
        let files = self.files.as_mut().expect("a scenario has begun");
        let cannot = "cannot write the poses of a scenario";
        writeln!(files.poses, "{}", row34(&matrix(&pose))).context(cannot)?;
        writeln!(
            files.times,
            "{:.9e}",
            now.saturating_sub(start) as f64 * 1e-9
        )
        .context(cannot)
    }
}
