//! Puts everything that is shown into one rerun recording: map, actors, sensors, plots.

use std::collections::{BTreeMap, BTreeSet};

use consumer_kit::KEPT_SNAPSHOTS;
use consumer_kit::items::ResultParts;
use rerun::components::{Colormap, ViewCoordinates};
use rerun::{ChannelDatatype, ColorModel, RecordingStream, Rgba32};
use schema_frames::{
    ActorKind, ActorList, ActorRecord, BodyBox, FrameHeader, ImuSample, Modality, SensorKind,
    SnapshotHeader,
};
use schema_roads::MarkColour;
use schema_roads::RoadMap;
use schema_types::{Pose, class::CLASSES};

use crate::images;
use crate::layout::{self, Place};
use crate::results::Results;

/// Depth that is shown in the last colour of the colour map, metres.
const DEPTH_RANGE_M: f64 = 60.0;
/// Distance between points of a lane line, metres.
const MAP_STEP_M: f64 = 2.0;
/// Class number of boxes whose class has no name.
const NO_CLASS: u16 = 0;

/// One recording and what it already contains.
pub struct Stage {
    rec: RecordingStream,
    places: BTreeSet<Place>,
    bodies: BTreeMap<u32, BodyBox>,
    labels: BTreeMap<u32, String>,
    rigs: BTreeMap<u32, String>,
    poses: Vec<(u64, BTreeMap<u32, Pose>)>,
    cameras: BTreeMap<String, [u64; 6]>,
    mounts: BTreeMap<String, Pose>,
    results: Results,
    /// Tick and simulated time of the newest that is shown; results without a time are shown there.
    newest: (u64, u64),
}

impl Stage {
    /// Puts what never changes into a fresh recording.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn new(rec: RecordingStream) -> anyhow::Result<Stage> {
        let classes = CLASSES.iter().enumerate().map(|(number, info)| {
            let [r, g, b] = info.rgb;
            rerun::ClassDescription::from((number as u16, info.name, Rgba32::from_rgb(r, g, b)))
        });
        rec.log_static("/", &rerun::AnnotationContext::new(classes))?;
        rec.log_static(layout::WORLD, &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
        for (path, name, colour) in SERIES {
            let path = format!("{}/{path}", layout::PLOTS);
            rec.log_static(
                path,
                &rerun::SeriesLines::new()
                    .with_names([*name])
                    .with_colors([Rgba32::from_rgb(colour[0], colour[1], colour[2])]),
            )?;
        }
        let stage = Stage {
            rec,
            places: BTreeSet::new(),
            bodies: BTreeMap::new(),
            labels: BTreeMap::new(),
            rigs: BTreeMap::new(),
            poses: Vec::new(),
            cameras: BTreeMap::new(),
            mounts: BTreeMap::new(),
            results: Results::default(),
            newest: (0, 0),
        };
        stage.arrange()?;
        Ok(stage)
    }

    /// The recording.
    pub fn recording(&self) -> &RecordingStream {
        &self.rec
    }

    fn arrange(&self) -> anyhow::Result<()> {
        layout::arrange(&self.rec, &self.places, self.results.views())
    }

    /// Sets the sensor topics that exist; lays the window out again if they changed.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn set_topics<'a>(
        &mut self,
        topics: impl IntoIterator<Item = &'a str>,
    ) -> anyhow::Result<()> {
        let places: BTreeSet<Place> = topics.into_iter().filter_map(Place::new).collect();
        if places != self.places {
            self.places = places;
            self.arrange()?;
        }
        Ok(())
    }

    /// Shows the map's lane lines; if the map cannot be read, the log says so.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn set_map(&mut self, open_drive: &str) -> anyhow::Result<()> {
        let map = match RoadMap::parse(open_drive) {
            Ok(map) => map,
            Err(error) => {
                return self.say(
                    rerun::TextLogLevel::WARN,
                    &format!("the map cannot be drawn: {error}"),
                );
            }
        };
        let marks = map.mark_lines(MAP_STEP_M);
        let strips = marks.iter().map(|mark| strip(&mark.points));
        let colours = marks.iter().map(|mark| match mark.colour {
            MarkColour::Yellow => Rgba32::from_rgb(230, 190, 60),
            _ => Rgba32::from_rgb(200, 200, 205),
        });
        self.rec.log_static(
            format!("{}/marks", layout::MAP),
            &rerun::LineStrips3D::new(strips)
                .with_colors(colours)
                .with_radii([0.06]),
        )?;
        let mut edges = Vec::new();
        for lane in map.lanes().iter().filter(|lane| lane.kind.is_drivable()) {
            let (left, right) = map.boundaries(lane.key, MAP_STEP_M);
            edges.push(strip(&left));
            edges.push(strip(&right));
        }
        let grey = Rgba32::from_rgb(95, 100, 110);
        self.rec.log_static(
            format!("{}/lanes", layout::MAP),
            &rerun::LineStrips3D::new(edges)
                .with_colors([grey])
                .with_radii([0.03]),
        )?;
        Ok(())
    }

    /// Takes over who is there.
    pub fn set_actors(&mut self, list: &ActorList) {
        self.bodies = list
            .actors
            .iter()
            .map(|actor| (actor.id, actor.body_box))
            .collect();
        let name = |actor: &schema_frames::ActorInfo| {
            if actor.role == "ego_vehicle" {
                "ego".to_string()
            } else {
                format!(
                    "{} {}",
                    actor.type_id.trim_start_matches("vehicle."),
                    actor.id
                )
            }
        };
        self.labels = list
            .actors
            .iter()
            .map(|actor| (actor.id, name(actor)))
            .collect();
    }

    /// Writes a line into the log view.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn say(&self, level: &str, sentence: &str) -> anyhow::Result<()> {
        Ok(self.rec.log(
            layout::LOG,
            &rerun::TextLog::new(sentence).with_level(level),
        )?)
    }

    fn set_clock(&mut self, tick: u64, sim_nanos: u64) {
        self.newest = self.newest.max((tick, sim_nanos));
        self.rec.set_time_sequence(layout::TICK, tick as i64);
        self.rec
            .set_time(layout::SIM_TIME, std::time::Duration::from_nanos(sim_nanos));
    }

    /// Keeps the poses of a snapshot for frames of that tick; shows nothing.
    pub fn remember(&mut self, header: &SnapshotHeader, records: &[ActorRecord]) {
        if self.poses.iter().any(|(tick, _)| *tick == header.tick) {
            return;
        }
        self.poses.push((
            header.tick,
            records
                .iter()
                .map(|record| (record.id, record.world_from_actor))
                .collect(),
        ));
        if self.poses.len() > KEPT_SNAPSHOTS {
            self.poses.remove(0);
        }
    }

    /// Shows the actors, the rigs and the curves of the rigs' vehicles.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn show_snapshot(
        &mut self,
        header: &SnapshotHeader,
        records: &[ActorRecord],
    ) -> anyhow::Result<()> {
        self.set_clock(header.tick, header.sim_nanos);
        let bodies: Vec<&ActorRecord> = records.iter().filter(|record| has_body(record)).collect();
        let centre = |record: &ActorRecord| {
            let body = self
                .bodies
                .get(&record.id)
                .map_or([0.0, 0.0, record.half_box_m[2]], |body| body.centre_m);
            vec3(
                (record.world_from_actor.isometry() * nalgebra::Point3::from(body.map(f64::from)))
                    .coords
                    .into(),
            )
        };
        let boxes = rerun::Boxes3D::from_centers_and_half_sizes(
            bodies.iter().map(|r| centre(r)),
            bodies.iter().map(|r| r.half_box_m),
        )
        .with_quaternions(bodies.iter().map(|r| {
            rerun::Quaternion::from_xyzw(r.world_from_actor.rotation_xyzw.map(|x| x as f32))
        }))
        .with_class_ids(bodies.iter().map(|r| {
            if (r.class as usize) < CLASSES.len() {
                r.class as u16
            } else {
                NO_CLASS
            }
        }))
        .with_labels(bodies.iter().map(|r| {
            self.labels
                .get(&r.id)
                .cloned()
                .unwrap_or_else(|| r.id.to_string())
        }))
        .with_show_labels(false)
        .with_colors(bodies.iter().map(|r| self.box_colour(r)));
        self.rec.log(layout::ACTORS, &boxes)?;
        for record in records {
            if let Some(rig) = self.rigs.get(&record.id) {
                self.rec.log(
                    format!("{}/{rig}", layout::WORLD),
                    &transform(&record.world_from_actor),
                )?;
                self.plot_vehicle(rig, record)?;
            }
        }
        Ok(())
    }

    fn box_colour(&self, record: &ActorRecord) -> Rgba32 {
        let [r, g, b] = if self.rigs.contains_key(&record.id) {
            [255, 170, 40]
        } else {
            images::id_colour(record.id)
        };
        Rgba32::from_rgb(r, g, b)
    }

    fn plot_vehicle(&self, rig: &str, record: &ActorRecord) -> anyhow::Result<()> {
        let first = self.rigs.values().next().is_some_and(|name| name == rig);
        let path = |curve: &str| {
            if first {
                format!("{}/{curve}", layout::PLOTS)
            } else {
                format!("{}/{curve}/{rig}", layout::PLOTS)
            }
        };
        self.scalar(&path("speed/speed_mps"), record.speed_mps())?;
        if let Some(vehicle) = record.vehicle() {
            self.scalar(&path("speed/limit_mps"), vehicle.speed_limit_mps as f64)?;
            self.scalar(&path("control/steer"), vehicle.steer_ratio as f64)?;
            self.scalar(&path("control/throttle"), vehicle.throttle_ratio as f64)?;
            self.scalar(&path("control/brake"), vehicle.brake_ratio as f64)?;
        }
        Ok(())
    }

    fn scalar(&self, path: &str, value: f64) -> anyhow::Result<()> {
        Ok(self.rec.log(path, &rerun::Scalars::single(value))?)
    }

    /// Shows one frame. `header` must have passed its check; `latency_nanos` is the time from its
    /// publication to us.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn show_frame(
        &mut self,
        topic: &str,
        header: &FrameHeader,
        payload: &[u8],
        latency_nanos: u64,
    ) -> anyhow::Result<()> {
        let Some(place) = Place::new(topic) else {
            return Ok(());
        };
        self.set_clock(header.tick, header.sim_nanos);
        self.scalar(&place.latency_path(), latency_nanos as f64 * 1e-6)?;
        self.place_sensor(&place, header)?;
        self.results.see(&place, header);
        match place.modality.sensor_kind() {
            SensorKind::Camera => self.show_image(&place, header, payload),
            SensorKind::Lidar => {
                let (positions, colours) = images::cloud(header, payload);
                let colours = colours
                    .into_iter()
                    .map(|[r, g, b]| Rgba32::from_rgb(r, g, b));
                Ok(self.rec.log(
                    place.frame_path(),
                    &rerun::Points3D::new(positions)
                        .with_colors(colours)
                        .with_radii([0.05]),
                )?)
            }
            SensorKind::Imu => self.plot_imu(&place, payload),
            _ => Ok(()),
        }
    }

    /// Shows one result of a user's program at the time of what it answers. Its header must have
    /// passed its check; `age_nanos` is the time from the oldest frame behind it to us, or from its
    /// own publication without one.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn show_result(&mut self, parts: &ResultParts<'_>, age_nanos: u64) -> anyhow::Result<()> {
        let header = parts.header;
        let (tick, sim_nanos) = match (header.tick, header.sim_nanos) {
            (0, 0) => self.newest,
            stamped => stamped,
        };
        self.set_clock(tick, sim_nanos);
        self.scalar(&layout::latency_path(parts.topic), age_nanos as f64 * 1e-6)?;
        if self.results.show(&self.rec, &self.rigs, parts)? {
            self.arrange()?;
        }
        Ok(())
    }

    /// Removes what the newest result of a topic drew over images and in the world, because its
    /// writer has ended.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn clear_result(&mut self, topic: &str) -> anyhow::Result<()> {
        let (tick, sim_nanos) = self.newest;
        self.set_clock(tick, sim_nanos);
        self.results.clear(&self.rec, topic)
    }

    /// Keeps the views of those topics of results only.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn keep_results(&mut self, is_visible: impl Fn(&str) -> bool) -> anyhow::Result<()> {
        if self.results.keep(is_visible) {
            self.arrange()?;
        }
        Ok(())
    }

    /// Items of results that could not be drawn, by topic.
    pub fn bad_items(&self) -> &BTreeMap<String, u64> {
        self.results.bad_items()
    }

    fn show_image(
        &self,
        place: &Place,
        header: &FrameHeader,
        payload: &[u8],
    ) -> anyhow::Result<()> {
        let path = place.frame_path();
        let size = [header.width, header.height];
        match place.modality {
            Modality::Rgb => {
                let pixels = images::tight(header, payload);
                self.rec.log(
                    path,
                    &rerun::Image::from_color_model_and_bytes(
                        pixels,
                        size,
                        ColorModel::BGRA,
                        ChannelDatatype::U8,
                    ),
                )?;
            }
            Modality::Depth => {
                let image = rerun::DepthImage::from_data_type_and_bytes(
                    images::tight(header, payload),
                    size,
                    ChannelDatatype::F32,
                );
                self.rec.log(
                    path,
                    &image
                        .with_meter(1.0)
                        .with_colormap(Colormap::Turbo)
                        .with_depth_range([0.0, DEPTH_RANGE_M]),
                )?;
            }
            Modality::Semantic => {
                let format =
                    rerun::components::ImageFormat::segmentation(size, ChannelDatatype::U8);
                self.rec.log(
                    path,
                    &rerun::SegmentationImage::new(images::tight(header, payload), format),
                )?;
            }
            Modality::Instance => self.rec.log(
                path,
                &rerun::Image::from_rgb24(images::instance_rgb(header, payload), size),
            )?,
            Modality::Flow => {
                let full_px = images::flow_full_px(header, payload);
                self.rec.log(
                    path,
                    &rerun::Image::from_rgb24(images::flow_rgb(header, payload, full_px), size),
                )?;
            }
            Modality::Normals => self.rec.log(
                path,
                &rerun::Image::from_rgb24(images::normals_rgb(header, payload), size),
            )?,
            Modality::Dvs => {
                if let Some(size) = images::image_size_px(header) {
                    self.rec.log(
                        path,
                        &rerun::Image::from_rgb24(images::events_rgb(size, payload), size),
                    )?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn plot_imu(&self, place: &Place, payload: &[u8]) -> anyhow::Result<()> {
        let Some(bytes) = payload.get(..size_of::<ImuSample>()) else {
            return Ok(());
        };
        let sample: ImuSample = bytemuck::pod_read_unaligned(bytes);
        for (axis, force) in ["x", "y", "z"].iter().zip(sample.specific_force_mps2) {
            self.scalar(
                &format!(
                    "{}/imu/{}/{}/force_{axis}",
                    layout::PLOTS,
                    place.rig,
                    place.sensor
                ),
                force,
            )?;
        }
        Ok(())
    }

    /// Places the sensor in the tree: on its rig if the parent's pose at that tick is known, else
    /// in the world.
    fn place_sensor(&mut self, place: &Place, header: &FrameHeader) -> anyhow::Result<()> {
        let parent = self
            .pose_at(header.tick, header.parent_id)
            .filter(|_| header.parent_id != 0);
        if let Some(parent) = parent {
            if let std::collections::btree_map::Entry::Vacant(e) = self.rigs.entry(header.parent_id)
            {
                e.insert(place.rig.clone());
                self.rec.log(place.rig_path(), &transform(&parent))?;
            }
            let mount =
                Pose::from(parent.isometry().inverse() * header.world_from_sensor.isometry());
            self.mount(place, mount)?;
        } else if header.parent_id == 0 {
            self.mount(place, header.world_from_sensor)?;
        }
        self.lens(place, header)
    }

    fn pose_at(&self, tick: u64, actor: u32) -> Option<Pose> {
        let (_, poses) = self.poses.iter().rev().find(|(at, _)| *at == tick)?;
        poses.get(&actor).copied()
    }

    /// Logs a mount if it moved by more than rounding.
    fn mount(&mut self, place: &Place, pose: Pose) -> anyhow::Result<()> {
        let path = place.sensor_path();
        let same = |old: &Pose| {
            let moved = old.isometry().inverse() * pose.isometry();
            moved.translation.vector.norm() < 1e-4 && moved.rotation.angle() < 1e-4
        };
        if !self.mounts.get(&path).is_some_and(same) {
            self.rec.log(path.clone(), &transform(&pose))?;
            self.mounts.insert(path, pose);
        }
        Ok(())
    }

    /// Logs a camera's lens if it is new or has changed.
    fn lens(&mut self, place: &Place, header: &FrameHeader) -> anyhow::Result<()> {
        let Some(size) = images::image_size_px(header) else {
            return Ok(());
        };
        let [fx, fy, cx, cy] = header.intrinsics_px;
        if place.modality.sensor_kind() != SensorKind::Camera || !(fx > 0.0 && fy > 0.0) {
            return Ok(());
        }
        let path = place.sensor_path();
        let key = [
            fx.to_bits(),
            fy.to_bits(),
            cx.to_bits(),
            cy.to_bits(),
            size[0] as u64,
            size[1] as u64,
        ];
        if self.cameras.insert(path.clone(), key) != Some(key) {
            let lens = rerun::Pinhole::from_focal_length_and_resolution(
                [fx as f32, fy as f32],
                [size[0] as f32, size[1] as f32],
            )
            .with_principal_point([cx as f32, cy as f32])
            .with_camera_xyz(ViewCoordinates::FLU)
            .with_image_plane_distance(1.5);
            self.rec.log(path, &lens)?;
        }
        Ok(())
    }

    /// Sends small messages that wait for their batch to fill, so that curves and boxes keep up
    /// with images. Does not wait.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn hurry(&self) -> anyhow::Result<()> {
        Ok(self.rec.flush_async()?)
    }

    /// Waits until everything has left this process.
    ///
    /// # Errors
    /// If it does not within `timeout`.
    pub fn flush(&self, timeout: std::time::Duration) -> anyhow::Result<()> {
        Ok(self.rec.flush_with_timeout(timeout)?)
    }
}

/// Path, name and colour of each curve.
const SERIES: &[(&str, &str, [u8; 3])] = &[
    ("speed/speed_mps", "speed, m/s", [255, 170, 40]),
    ("speed/limit_mps", "limit, m/s", [130, 130, 140]),
    ("control/steer", "steer (left is up)", [90, 160, 255]),
    ("control/throttle", "throttle", [90, 200, 110]),
    ("control/brake", "brake", [240, 80, 70]),
];

fn has_body(record: &ActorRecord) -> bool {
    let kind = matches!(
        record.kind(),
        Some(ActorKind::Vehicle | ActorKind::Walker | ActorKind::Prop)
    );
    kind && record.half_box_m.iter().all(|half| *half > 0.0)
}

fn vec3(v: [f64; 3]) -> [f32; 3] {
    v.map(|x| x as f32)
}

fn strip(points: &[[f64; 3]]) -> rerun::LineStrip3D {
    rerun::LineStrip3D::from_iter(points.iter().map(|point| vec3(*point)))
}

fn transform(pose: &Pose) -> rerun::Transform3D {
    rerun::Transform3D::from_translation_rotation(
        vec3(pose.translation_m),
        rerun::Quaternion::from_xyzw(pose.rotation_xyzw.map(|x| x as f32)),
    )
}
