//! nuScenes v1.0: tables in `v1.0-trainval/`, `samples/`, `sweeps/`, `maps/`, and `lidarseg/` if there
//! is a semantic lidar.
//!
//! Keyframes are at least half a second apart; every other frame is a sweep. The vehicle's axes are
//! those of its actor (on the ground between the axles, x forward), the lidar's and radars' are their
//! own (x forward), and calibrated_sensor says so. Ground coordinates are those of the map, moved so
//! that the mask's lower left corner is (0, 0). Timestamps are simulated microseconds.

mod annotations;
mod channels;
mod map_mask;
mod radar;
mod tables;

use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::Context as _;
use nalgebra::{Isometry3, Translation3};
use schema_frames::Modality;
use serde_json::{Value, json};

use super::family::{Cloud, with_intensities};
use crate::classes;
use crate::exporter::{DoneScenario, Exporter, Format, missing};
use crate::options::Options;
use crate::picture;
use crate::tree::{Job, Tree};
use annotations::Annotations;
use channels::{Channel, channels};
use consumer_truth::scenario::{Scenario, Sensor, Topic};
use consumer_truth::ticks::{TickFrame, TickSet};
use tables::{Record, Sweeps, TABLES, Tables, pose_json, token};

/// Folder of the tables; tools take it for their version.
const VERSION: &str = "v1.0-trainval";

/// Writes nuScenes.
pub struct NuScenes {
    options: Options,
    running: Option<Running>,
}

/// What is kept over a scenario.
struct Running {
    channels: Vec<Channel>,
    tables: Tables,
    sweeps: Sweeps,
    annotations: Annotations,
    /// Moves the world's origin to the mask's lower left corner.
    global_from_world: Translation3<f64>,
    has_labels: bool,
    /// Token and time of the last sample, and those before it.
    samples: Vec<(String, u64)>,
    n_samples: u64,
    first_sample: Option<String>,
    log: String,
}

impl NuScenes {
    /// Nothing is written yet.
    pub fn new(options: &Options) -> NuScenes {
        NuScenes {
            options: options.clone(),
            running: None,
        }
    }
}

/// Simulated microseconds.
fn micros(nanos: u64) -> u64 {
    nanos / 1000
}

impl Exporter for NuScenes {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        let channels = channels(scenario, &self.options)?;
        if !channels.iter().any(|channel| channel.name == "LIDAR_TOP") {
            let any = [
                Modality::Lidar,
                Modality::SemanticLidar,
                Modality::LidarReturns,
            ];
            return Err(missing(Format::Nuscenes, scenario, "a lidar", &any));
        }
        Ok(())
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        let Ok(channels) = channels(scenario, &self.options) else {
            return false;
        };
        let exported = channels.iter().any(|channel| channel.topic == topic.name);
        let of_camera = channels
            .iter()
            .any(|channel| *channel.sensor == *topic.sensor);
        let exact = matches!(topic.modality, Modality::Instance | Modality::Depth);
        exported || (exact && of_camera) || topic.modality == Modality::Lidar
    }

    fn keys(&self, scenario: &Scenario) -> Vec<Arc<str>> {
        let channels = channels(scenario, &self.options).unwrap_or_default();
        channels.into_iter().map(|channel| channel.topic).collect()
    }

    fn key_period_nanos(&self) -> u64 {
        500_000_000
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        done: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let channels = channels(scenario, &self.options)?;
        let mut tables = Tables::begin(scenario.index as usize, tree)?;
        let map = &scenario.info.map;
        let mask = map_mask::MapMask::of(scenario.opendrive.as_deref());
        if mask.is_blank() {
            tracing::warn!(
                scenario = scenario.name,
                "the recording holds no map that can be read, so the map's mask is blank"
            );
        }
        let origin = mask.origin_m();
        if done.iter().all(|done| done.state["map"] != json!(map)) {
            tree.write(&format!("maps/{}.png", token(&["map", map])), || mask.png())?;
        }
        let log = token(&["log", &scenario.name]);
        tables.write(
            "log",
            &json!({
                "token": log, "logfile": scenario.name, "vehicle": scenario.rig,
                "date_captured": "1970-01-01", "location": map,
            }),
        )?;
        for channel in &channels {
            let sensor = scenario
                .sensor(&channel.sensor)
                .context("a sensor is gone")?;
            tables.write("calibrated_sensor", &channel.calibration(scenario, sensor))?;
        }
        self.running = Some(Running {
            channels,
            tables,
            sweeps: Sweeps::default(),
            annotations: Annotations::default(),
            global_from_world: Translation3::new(-origin[0], -origin[1], 0.0),
            has_labels: false,
            samples: Vec::new(),
            n_samples: 0,
            first_sample: None,
            log,
        });
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let options = &self.options;
        let running = self.running.as_mut().expect("a scenario has begun");
        running.tick(scenario, tick, options, tree)
    }

    fn end(&mut self, scenario: &Scenario, _: &Tree) -> anyhow::Result<Value> {
        let mut running = self.running.take().expect("a scenario has begun");
        let (last, _) = running
            .samples
            .last()
            .cloned()
            .context("a scenario without samples")?;
        running.sweeps.assign(&last);
        running.sweeps.finish(&mut running.tables)?;
        running.annotations.finish(&mut running.tables)?;
        running.write_sample(scenario, String::new())?;
        let first = running.first_sample.clone().unwrap_or_default();
        running.tables.write(
            "scene",
            &json!({
                "token": token(&["scene", &scenario.name]), "log_token": running.log,
                "nbr_samples": running.n_samples, "first_sample_token": first,
                "last_sample_token": last, "name": scenario.name,
                "description": format!("{}, seed {}", scenario.info.map, scenario.info.seed),
            }),
        )?;
        running.tables.finish()?;
        let channels: Vec<_> = running
            .channels
            .iter()
            .map(|c| json!([c.name, c.modality]))
            .collect();
        Ok(json!({
            "map": scenario.info.map, "log": running.log, "channels": channels,
            "lidarseg": running.has_labels,
        }))
    }

    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()> {
        for table in TABLES {
            let is_optional = table == "lidarseg";
            if is_optional
                && done
                    .iter()
                    .all(|scenario| scenario.state["lidarseg"] != json!(true))
            {
                continue;
            }
            tables::join(table, done.len(), &format!("{VERSION}/{table}.json"), tree)?;
        }
        let write = |name: &str, rows: Vec<Value>| {
            let text = serde_json::to_string_pretty(&rows)?;
            tree.write(&format!("{VERSION}/{name}.json"), || Ok(text.into_bytes()))
        };
        let sensors: BTreeSet<(String, String)> = done
            .iter()
            .flat_map(|scenario| {
                scenario.state["channels"]
                    .as_array()
                    .cloned()
                    .unwrap_or_default()
            })
            .map(|pair| {
                let text = |at: usize| pair[at].as_str().unwrap_or_default().to_string();
                (text(0), text(1))
            })
            .collect();
        let sensors = sensors.into_iter().map(|(channel, modality)| {
            json!({"token": token(&["sensor", &channel]), "channel": channel, "modality": modality})
        });
        write("sensor", sensors.collect())?;
        let categories = classes::NUSCENES.iter().enumerate().map(|(index, name)| {
            json!({"token": token(&["category", name]), "name": name, "description": "", "index": index})
        });
        write("category", categories.collect())?;
        let attributes = classes::NUSCENES_ATTRIBUTES.iter().map(|(name, description)| {
            json!({"token": token(&["attribute", name]), "name": name, "description": description})
        });
        write("attribute", attributes.collect())?;
        let levels = [
            ("1", "v0-40"),
            ("2", "v40-60"),
            ("3", "v60-80"),
            ("4", "v80-100"),
        ];
        let visibilities = levels.iter().map(|(number, level)| {
            let range = &level[1..];
            json!({"token": number, "level": level, "description": format!("visibility of whole object is between {range}%")})
        });
        write("visibility", visibilities.collect())?;
        let maps: BTreeSet<&str> = done
            .iter()
            .filter_map(|scenario| scenario.state["map"].as_str())
            .collect();
        let maps = maps.into_iter().map(|map| {
            let own = done.iter().filter(|scenario| scenario.state["map"] == json!(map));
            let logs: Vec<&Value> = own.map(|scenario| &scenario.state["log"]).collect();
            let token = token(&["map", map]);
            json!({"token": token, "log_tokens": logs, "category": "semantic_prior", "filename": format!("maps/{token}.png")})
        });
        write("map", maps.collect())?;
        let mut splits = serde_json::Map::new();
        for scenario in done {
            let names = splits.entry(&scenario.split).or_insert_with(|| json!([]));
            names
                .as_array_mut()
                .expect("it was made as a list")
                .push(json!(scenario.name));
        }
        let text = serde_json::to_string_pretty(&splits)?;
        tree.write(&format!("{VERSION}/splits.json"), || Ok(text.into_bytes()))
    }
}

impl Running {
    fn tick(
        &mut self,
        scenario: &Scenario,
        tick: &TickSet,
        options: &Options,
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let is_key = tick.key.is_some();
        let sample = is_key.then(|| token(&["sample", &scenario.name, &tick.tick.to_string()]));
        let mut jobs = Vec::new();
        let mut clouds = Vec::new();
        for channel in &self.channels {
            let Some(frame) = tick
                .frames
                .iter()
                .find(|frame| frame.topic == channel.topic)
            else {
                continue;
            };
            let place = if is_key { "samples" } else { "sweeps" };
            let time = micros(frame.header.sim_nanos);
            let ending = channel.ending(options.images);
            let name = format!("{}__{}__{time:012}.{ending}", scenario.name, channel.name);
            let path = format!("{place}/{}/{name}", channel.name);
            let record_token = token(&[
                "sample_data",
                &scenario.name,
                &channel.name,
                &time.to_string(),
            ]);
            let cloud = (channel.modality == "lidar").then(|| lidar_cloud(tick, frame));
            match channel.modality {
                "camera" => {
                    let form = options.images;
                    jobs.push(Job::new(path.clone(), move || picture::colour(frame, form)));
                }
                "radar" => {
                    let bytes = radar::pcd(frame, tick.world.as_deref());
                    jobs.push(Job::new(path.clone(), move || Ok(bytes)));
                }
                _ => {
                    let bytes = five_floats(cloud.as_ref().expect("it was just made"));
                    jobs.push(Job::new(path.clone(), move || Ok(bytes)));
                }
            }
            if let Some(cloud) = &cloud
                && is_key
                && channel.name == "LIDAR_TOP"
                && let Some(labels) = annotations::point_labels(scenario, tick, cloud)
            {
                let path = format!("lidarseg/{VERSION}/{record_token}_lidarseg.bin");
                let row = json!({"token": record_token, "sample_data_token": record_token, "filename": path});
                self.tables.write("lidarseg", &row)?;
                jobs.push(Job::new(path, move || Ok(labels)));
                self.has_labels = true;
            }
            if let Some(cloud) = cloud {
                clouds.push((channel.name.clone(), frame.header, cloud));
            }
            let pose = self.ego_pose(scenario, channel, frame);
            let (translation, rotation) = pose_json(&pose);
            self.tables.write("ego_pose", &json!({
                "token": record_token, "timestamp": time, "rotation": rotation, "translation": translation,
            }))?;
            let image = channel.modality == "camera";
            self.sweeps.push(
                &channel.name,
                Record {
                    token: record_token.clone(),
                    sample: sample.clone(),
                    prev: String::new(),
                    next: None,
                    row: json!({
                        "token": record_token, "ego_pose_token": record_token,
                        "calibrated_sensor_token": channel.calibration_token(scenario),
                        "timestamp": time, "fileformat": if image { ending } else { "pcd" },
                        "is_key_frame": is_key,
                        "height": if image { frame.header.height } else { 0 },
                        "width": if image { frame.header.width } else { 0 },
                        "filename": path,
                    }),
                },
            );
        }
        if let Some(sample) = sample {
            self.sweeps.assign(&sample);
            self.annotations.add(
                scenario,
                tick,
                &sample,
                &clouds,
                &self.channels,
                &self.global_from_world,
                &mut self.tables,
            )?;
            self.write_sample(scenario, sample.clone())?;
            self.first_sample.get_or_insert_with(|| sample.clone());
            self.samples.push((sample, micros(tick.sim_nanos)));
            self.n_samples = self.n_samples.saturating_add(1);
        }
        self.sweeps.flush(&mut self.tables)?;
        tree.write_all(jobs)
    }

    /// Writes the row of the last sample, whose successor is known now.
    fn write_sample(&mut self, scenario: &Scenario, next: String) -> anyhow::Result<()> {
        let Some((token_of, time)) = self.samples.last().cloned() else {
            return Ok(());
        };
        let prev = match self.samples.len() {
            0 | 1 => String::new(),
            n => self.samples[n - 2].0.clone(),
        };
        self.tables.write(
            "sample",
            &json!({
                "token": token_of, "timestamp": time, "prev": prev, "next": next,
                "scene_token": token(&["scene", &scenario.name]),
            }),
        )?;
        let n_old = self.samples.len().saturating_sub(1);
        self.samples.drain(..n_old);
        Ok(())
    }

    /// Pose of the carrier when a frame was taken: exactly the one with which the calibration gives
    /// the frame's own pose.
    fn ego_pose(
        &self,
        scenario: &Scenario,
        channel: &Channel,
        frame: &TickFrame,
    ) -> Isometry3<f64> {
        let mount = scenario
            .sensor(&channel.sensor)
            .map_or_else(Isometry3::identity, mount);
        let world_from_carrier = frame.header.world_from_sensor.isometry() * mount.inverse();
        self.global_from_world * world_from_carrier
    }
}

/// Place of a sensor on what ego_pose is the pose of; a rig that stands still is its own vehicle at
/// the world's origin.
fn mount(sensor: &Sensor) -> Isometry3<f64> {
    sensor.carrier_from_sensor
}

/// The cloud of a frame, with intensities of a plain lidar if there is one at the same place.
fn lidar_cloud(tick: &TickSet, frame: &TickFrame) -> Cloud {
    let cloud = Cloud::of(frame);
    with_intensities(cloud, frame, tick)
}

/// `x y z intensity ring`, intensities from 0 to 255.
fn five_floats(cloud: &Cloud) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(cloud.points_m.len() * 20);
    for (at, [x, y, z]) in cloud.points_m.iter().enumerate() {
        let intensity = cloud.intensities[at] * 255.0;
        for value in [*x, *y, *z, intensity, f32::from(cloud.channels[at])] {
            bytes.extend(value.to_le_bytes());
        }
    }
    bytes
}
