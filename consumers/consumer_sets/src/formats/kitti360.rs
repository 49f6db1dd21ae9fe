//! KITTI-360: rectified images, semantic and instance images, clouds, poses, calibration and boxes in
//! space.
//!
//! The vehicle's axes are KITTI-360's (x forward, y right, z down), the world is the map. Semantic
//! images hold label ids, instance images label · 1000 + number of the object within its class.

mod boxes;

use std::collections::HashMap;
use std::io::Write as _;
use std::sync::Arc;

use anyhow::Context as _;
use launch_cli::files::MAX_NOTES_BYTES;
use nalgebra::{Isometry3, Matrix4, UnitQuaternion, Vector3};
use schema_frames::Modality;
use serde_json::{Value, json};

use super::family::{
    Cloud, camera_pair, first_topic, matrix, numbers, projection, row34, with_intensities,
    world_from_carrier,
};
use crate::classes;
use crate::exporter::{DoneScenario, Exporter, Format, splits};
use crate::options::Options;
use crate::picture;
use crate::tree::{Job, PartFile, Tree};
use consumer_truth::bodies;
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::TickSet;

/// Writes KITTI-360.
pub struct Kitti360 {
    options: Options,
    n_here: u64,
    start_nanos: Option<u64>,
    instances: Instances,
    files: Option<Files>,
}

struct Files {
    poses: PartFile,
    cam0_to_world: PartFile,
    boxes: boxes::Boxes,
    /// Timestamps by folder.
    times: Vec<PartFile>,
}

/// Numbers of objects within their class, from 1.
#[derive(Debug, Default)]
struct Instances(HashMap<(u8, u32), u16>, HashMap<u8, u16>);

impl Instances {
    /// The number of an object; after 999 they begin again.
    fn number(&mut self, label: u8, id: u32) -> u16 {
        let Instances(known, last) = self;
        *known.entry((label, id)).or_insert_with(|| {
            let last = last.entry(label).or_insert(0);
            *last = *last % 999 + 1;
            *last
        })
    }
}

/// Name of a sequence.
fn sequence(index: u32) -> String {
    format!("2013_05_28_drive_{index:04}_sync")
}

/// KITTI-360's vehicle axes: x forward, y right, z down.
fn carrier_from_pose() -> Isometry3<f64> {
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    Isometry3::from_parts(Default::default(), half_turn)
}

fn lidar(scenario: &Scenario) -> Option<(&Sensor, &Topic)> {
    let any = [
        Modality::SemanticLidar,
        Modality::LidarReturns,
        Modality::Lidar,
    ];
    first_topic(scenario, &any)
}

impl Kitti360 {
    /// Nothing is written yet.
    pub fn new(options: &Options) -> Kitti360 {
        Kitti360 {
            options: options.clone(),
            n_here: 0,
            start_nanos: None,
            instances: Instances::default(),
            files: None,
        }
    }

    fn cameras<'a>(&self, scenario: &'a Scenario) -> anyhow::Result<Vec<&'a Sensor>> {
        camera_pair(Format::Kitti360, scenario, &self.options)
    }
}

impl Exporter for Kitti360 {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        self.cameras(scenario).map(drop)
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        use Modality::{Instance, Lidar, Rgb, Semantic};
        let cameras = self.cameras(scenario).unwrap_or_default();
        let of_camera = cameras.iter().any(|camera| camera.name == *topic.sensor);
        match topic.modality {
            Rgb | Semantic | Instance => of_camera,
            Lidar => true,
            _ => lidar(scenario).is_some_and(|(_, lidar)| lidar.name == topic.name),
        }
    }

    fn keys(&self, scenario: &Scenario) -> Vec<Arc<str>> {
        let cameras = self.cameras(scenario).unwrap_or_default();
        let colour = cameras
            .into_iter()
            .filter_map(|camera| camera.topic(Modality::Rgb));
        colour
            .chain(lidar(scenario).map(|(_, topic)| topic))
            .map(|topic| topic.name.clone())
            .collect()
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        _: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        (self.n_here, self.start_nanos) = (0, None);
        self.instances = Instances::default();
        let cameras = self.cameras(scenario)?;
        self.calibration(scenario, &cameras, tree)?;
        let sequence = sequence(scenario.index);
        let mut folders: Vec<String> = (0..cameras.len())
            .map(|at| format!("data_2d_raw/{sequence}/image_{at:02}"))
            .collect();
        if lidar(scenario).is_some() {
            folders.push(format!("data_3d_raw/{sequence}/velodyne_points"));
        }
        let times = folders
            .iter()
            .map(|folder| tree.begin(&format!("{folder}/timestamps.txt")));
        let split = &scenario.split;
        self.files = Some(Files {
            poses: tree.begin(&format!("data_poses/{sequence}/poses.txt"))?,
            cam0_to_world: tree.begin(&format!("data_poses/{sequence}/cam0_to_world.txt"))?,
            boxes: boxes::Boxes::begin(
                tree.begin(&format!("data_3d_bboxes/{split}/{sequence}.xml"))?,
            )?,
            times: times.collect::<anyhow::Result<_>>()?,
        });
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let (Some(_), Some(world)) = (tick.key, &tick.world) else {
            return Ok(());
        };
        let cameras = self.cameras(scenario)?;
        let sequence = sequence(scenario.index);
        let split = &scenario.split;
        let form = self.options.images;
        let name = format!("{:010}", self.n_here);
        let mut jobs = Vec::new();
        for (at, camera) in cameras.iter().enumerate() {
            let Some(frame) = tick.frame(&camera.name, Modality::Rgb) else {
                continue;
            };
            let folder = format!("data_2d_raw/{sequence}/image_{at:02}/data_rect");
            jobs.push(Job::new(
                format!("{folder}/{name}.{}", form.ending()),
                move || picture::colour(frame, form),
            ));
            let Some(semantic) = tick.frame(&camera.name, Modality::Semantic) else {
                continue;
            };
            let classes: Vec<u8> = semantic.elements();
            let labels: Vec<u8> = classes
                .iter()
                .map(|class| classes::of(*class).kitti360)
                .collect();
            let (width, height) = (semantic.header.width, semantic.header.height);
            let folder = format!("data_2d_semantics/{split}/{sequence}/image_{at:02}");
            if let Some(instance) = tick.frame(&camera.name, Modality::Instance) {
                let ids: Vec<u32> = instance.elements();
                let mut number =
                    |(label, id): (&u8, &u32)| match boxes::has_instances(*label) && *id != 0 {
                        true => {
                            let number = self.instances.number(*label, *id);
                            u16::from(*label)
                                .saturating_mul(1000)
                                .saturating_add(number)
                        }
                        false => u16::from(*label).saturating_mul(1000),
                    };
                let pixels: Vec<u16> = labels.iter().zip(&ids).map(&mut number).collect();
                jobs.push(Job::new(
                    format!("{folder}/instance/{name}.png"),
                    move || picture::gray16(&pixels, width, height),
                ));
                // Everything is certain.
                jobs.push(Job::new(
                    format!("{folder}/confidence/{name}.png"),
                    move || {
                        picture::gray8(&vec![255; width as usize * height as usize], width, height)
                    },
                ));
            }
            let colours: Vec<u8> = labels
                .iter()
                .flat_map(|label| boxes::colour(*label))
                .collect();
            jobs.push(Job::new(
                format!("{folder}/semantic_rgb/{name}.png"),
                move || picture::rgb8(&colours, width, height),
            ));
            jobs.push(Job::new(
                format!("{folder}/semantic/{name}.png"),
                move || picture::gray8(&labels, width, height),
            ));
        }
        if let Some(frame) =
            lidar(scenario).and_then(|(lidar, topic)| tick.frame(&lidar.name, topic.modality))
        {
            let cloud = with_intensities(Cloud::of(frame), frame, tick);
            let path = format!("data_3d_raw/{sequence}/velodyne_points/data/{name}.bin");
            jobs.push(Job::new(path, move || Ok(cloud.velodyne())));
        }
        tree.write_all(jobs)?;
        let colour = tick
            .frame(&cameras[0].name, Modality::Rgb)
            .context("the colour frame is gone")?;
        let world_from_pose = world_from_carrier(scenario, world) * carrier_from_pose();
        let world_from_camera =
            colour.header.world_from_sensor.isometry() * schema_types::space::sensor_from_camera();
        let now = tick.sim_nanos;
        let since = now.saturating_sub(*self.start_nanos.get_or_insert(now));
        let files = self.files.as_mut().expect("a scenario has begun");
        let cannot = "cannot write the poses of a scenario";
        let n = self.n_here;
        writeln!(files.poses, "{n} {}", row34(&matrix(&world_from_pose))).context(cannot)?;
        let whole = matrix(&world_from_camera).transpose();
        writeln!(
            files.cam0_to_world,
            "{n} {}",
            numbers(whole.iter().copied())
        )
        .context(cannot)?;
        for times in &mut files.times {
            writeln!(times, "{}", stamp(since)).context(cannot)?;
        }
        for body in bodies(world, scenario.carrier_id) {
            let label = classes::of(body.class).kitti360;
            if body.is_scenery() {
                files.boxes.note_still(&body, label, n);
                continue;
            }
            let number = self.instances.number(label, body.id);
            files.boxes.add(&body, label, number, n)?;
        }
        self.n_here = self.n_here.saturating_add(1);
        Ok(())
    }

    fn end(&mut self, _: &Scenario, _: &Tree) -> anyhow::Result<Value> {
        let files = self.files.take().expect("a scenario has begun");
        let number = &mut |label, id| self.instances.number(label, id);
        files.boxes.finish(number)?;
        files.times.into_iter().try_for_each(PartFile::finish)?;
        files.poses.finish()?;
        files.cam0_to_world.finish()?;
        Ok(json!({"frames": self.n_here}))
    }

    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()> {
        for split in splits(done) {
            let mut text = String::new();
            for (index, scenario) in done
                .iter()
                .enumerate()
                .filter(|(_, done)| done.split == split)
            {
                let sequence = sequence(index as u32);
                for frame in 0..scenario.n_ticks {
                    let image = format!(
                        "data_2d_raw/{sequence}/image_00/data_rect/{frame:010}.{}",
                        self.options.images.ending()
                    );
                    text += &format!(
                        "{image} data_2d_semantics/{split}/{sequence}/image_00/semantic/{frame:010}.png\n"
                    );
                }
            }
            let path = format!("data_2d_semantics/{split}/2013_05_28_drive_{split}_frames.txt");
            tree.write(&path, || Ok(text.into_bytes()))?;
        }
        Ok(())
    }
}

/// A line of timestamps.txt: a date of KITTI-360's form, whose clock begins with the sequence.
fn stamp(nanos: u64) -> String {
    let secs = nanos / 1_000_000_000;
    let (h, m, s) = (secs / 3600, secs / 60 % 60, secs % 60);
    format!(
        "2013-05-28 {h:02}:{m:02}:{s:02}.{:09}",
        nanos % 1_000_000_000
    )
}

impl Kitti360 {
    /// `calibration/`. All sequences of a set share it, so all scenarios must have the same.
    fn calibration(
        &self,
        scenario: &Scenario,
        cameras: &[&Sensor],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let first = cameras[0];
        let carrier_from_first = first.carrier_from_camera();
        let mut perspective = String::from("calib_time: 28-May-2013 00:00:00\ncorner_dist: 0.0\n");
        let mut to_pose = String::new();
        for at in 0..2 {
            // A single camera stands in for the second.
            let camera = cameras.get(at).unwrap_or(&first);
            let first_from_it = carrier_from_first.inverse() * camera.carrier_from_camera();
            let shift = Isometry3::from(first_from_it.translation);
            let (width, height) = (camera.first().width, camera.first().height);
            let size = format!("{width} {height}");
            let rect = projection(camera, &shift);
            let own = projection(camera, &Isometry3::identity());
            let three = |m: &Matrix4<f64>| numbers((0..9).map(|i| m[(i / 3, i % 3)]));
            let level = three(&Matrix4::identity());
            let t = -first_from_it.translation.vector;
            perspective += &format!(
                "S_{at:02}: {size}\nK_{at:02}: {}\nD_{at:02}: {}\nR_{at:02}: {level}\nT_{at:02}: {}\nS_rect_{at:02}: {size}\nR_rect_{at:02}: {level}\nP_rect_{at:02}: {}\n",
                three(&own),
                numbers([0.0; 5]),
                numbers(t.iter().copied()),
                row34(&rect),
            );
            let pose_from_camera = carrier_from_pose().inverse() * camera.carrier_from_camera();
            to_pose += &format!("image_{at:02}: {}\n", row34(&matrix(&pose_from_camera)));
        }
        // The side cameras of KITTI-360, which no rig here has; readers insist on their lines.
        for at in 2..4 {
            let pose_from_camera = carrier_from_pose().inverse() * carrier_from_first;
            to_pose += &format!("image_{at:02}: {}\n", row34(&matrix(&pose_from_camera)));
        }
        let mut files = vec![
            ("perspective.txt", perspective),
            ("calib_cam_to_pose.txt", to_pose),
        ];
        if let Some((lidar, _)) = lidar(scenario) {
            let velo_from_camera = lidar.carrier_from_sensor.inverse() * carrier_from_first;
            files.push((
                "calib_cam_to_velo.txt",
                row34(&matrix(&velo_from_camera)) + "\n",
            ));
        }
        for (name, text) in files {
            let path = format!("calibration/{name}");
            let there = launch_cli::files::read_text(&tree.path(&path), MAX_NOTES_BYTES);
            if there.is_ok_and(|there| there != text) {
                return Err(launch_cli::wrong_usage(format!(
                    "{} has another calibration than the scenarios before it, and kitti-360 has one for all; export it into a folder of its own",
                    scenario.name
                )));
            }
            tree.write(&path, || Ok(text.into_bytes()))?;
        }
        Ok(())
    }
}
