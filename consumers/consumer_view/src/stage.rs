//! Puts everything that is shown into one rerun recording: map, actors, sensors, plots.

use std::collections::{BTreeMap, BTreeSet};

use consumer_forms::palette;
use consumer_kit::KEPT_SNAPSHOTS;
use consumer_kit::items::ResultParts;
use rerun::components::ViewCoordinates;
use rerun::{RecordingStream, Rgba32};
use schema_frames::{
    ActorKind, ActorList, ActorRecord, BodyBox, FrameHeader, Modality, SensorKind, SnapshotHeader,
};
use schema_roads::MarkColour;
use schema_roads::RoadMap;
use schema_types::{Pose, class::CLASSES};

use crate::geo;
use crate::ids::Ids;
use crate::images;
use crate::layout::{self, Place};
use crate::look::Look;
use crate::pictures::{DEPTH_RANGE_M, Pictures};
use crate::rerun;
use crate::results::Results;
use crate::senses::Senses;
use crate::surface::{self, Surface};
use crate::traffic::{self, Traffic};

/// Distance between points of a lane line, metres.
const MAP_STEP_M: f64 = 2.0;
/// Class number of boxes whose class has no name.
const NO_CLASS: u16 = 0;
/// Thickness of the lines of actors' boxes over images, points of the screen.
const TRUTH_LINE: f32 = 1.0;
/// Pieces of the scale beside distances.
const SCALE_STEPS: usize = 48;

/// One recording and what it already contains.
pub struct Stage {
    rec: RecordingStream,
    /// Whether the window was divided.
    is_arranged: bool,
    places: BTreeSet<Place>,
    bodies: BTreeMap<u32, BodyBox>,
    labels: BTreeMap<u32, String>,
    rigs: BTreeMap<u32, String>,
    poses: Vec<(u64, BTreeMap<u32, Pose>)>,
    cameras: BTreeMap<String, [u64; 6]>,
    mounts: BTreeMap<String, Pose>,
    results: Results,
    pictures: Pictures,
    senses: Senses,
    traffic: Traffic,
    surfaces: BTreeMap<String, Surface>,
    /// Size of the image for which a scale was drawn.
    scales: BTreeMap<String, [u32; 2]>,
    /// Latitude and longitude of the world's origin, degrees.
    origin_deg: Option<(f64, f64)>,
    /// Tick and simulated time of the newest that is shown; results without a time are shown there.
    newest: (u64, u64),
}

impl Stage {
    /// Puts what never changes into a fresh recording.
    ///
    /// # Errors
    /// If the recording's other end refuses.
    pub fn new(rec: RecordingStream, look: Look) -> anyhow::Result<Stage> {
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
        Ok(Stage {
            rec,
            is_arranged: false,
            places: BTreeSet::new(),
            bodies: BTreeMap::new(),
            labels: BTreeMap::new(),
            rigs: BTreeMap::new(),
            poses: Vec::new(),
            cameras: BTreeMap::new(),
            mounts: BTreeMap::new(),
            results: Results::default(),
            pictures: Pictures::new(look),
            senses: Senses::default(),
            traffic: Traffic::default(),
            surfaces: BTreeMap::new(),
            scales: BTreeMap::new(),
            origin_deg: None,
            newest: (0, 0),
        })
    }

    /// The recording.
    pub fn recording(&self) -> &RecordingStream {
        &self.rec
    }

    fn arrange(&self) -> anyhow::Result<()> {
        let look = self.pictures.look();
        match look.arranges {
            true => layout::arrange(
                &self.rec,
                &self.places,
                self.results.views(),
                look.time_surface,
            ),
            false => Ok(()),
        }
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
        // The first window comes with the first topics: of several in one file, programs of rerun
        // may take any.
        if places != self.places || !self.is_arranged {
            self.is_arranged = true;
            // What is large of those that have gone: sensors come and go in thousands.
            for gone in self.places.difference(&places) {
                self.pictures.forget(&gone.frame_path());
                self.surfaces.remove(&gone.topic());
            }
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
            edges.extend([left, right]);
        }
        self.origin_deg = Some(map.geo_reference());
        self.draw_geo_lanes(&edges)?;
        let grey = Rgba32::from_rgb(95, 100, 110);
        self.rec.log_static(
            format!("{}/lanes", layout::MAP),
            &rerun::LineStrips3D::new(edges.iter().map(|edge| strip(edge)))
                .with_colors([grey])
                .with_radii([0.03]),
        )?;
        Ok(())
    }

    /// Puts the lanes on the map view, so that it says something without pictures from elsewhere.
    fn draw_geo_lanes(&self, edges: &[Vec<[f64; 3]>]) -> anyhow::Result<()> {
        let Some(origin_deg) = self.origin_deg else {
            return Ok(());
        };
        let located = |edge: &Vec<[f64; 3]>| {
            let points = edge.iter();
            let points = points.map(|[x, y, _]| geo::locate(origin_deg, [*x, *y]));
            rerun::components::GeoLineString::from_iter(points)
        };
        let lines = rerun::GeoLineStrings::from_lat_lon(edges.iter().map(located))
            .with_colors([Rgba32::from_rgb(120, 125, 140)])
            .with_radii([rerun::Radius::new_ui_points(1.0)]);
        Ok(self
            .rec
            .log_static(format!("{}/lanes", layout::GEO), &lines)?)
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
        self.traffic.show_lights(&self.rec, records, centre)?;
        self.senses.tidy(&self.rec, header.sim_nanos)?;
        for record in records {
            if let Some(rig) = self.rigs.get(&record.id) {
                self.rec.log(
                    format!("{}/{rig}", layout::WORLD),
                    &transform(&record.world_from_actor),
                )?;
                self.plot_vehicle(rig, record)?;
                let place_m = record.world_from_actor.translation_m;
                self.traffic.follow(&self.rec, rig, place_m)?;
                self.traffic.show_states(&self.rec, rig, record)?;
            }
        }
        Ok(())
    }

    fn box_colour(&self, record: &ActorRecord) -> Rgba32 {
        let [r, g, b] = if self.rigs.contains_key(&record.id) {
            [255, 170, 40]
        } else {
            palette::object(record.id)
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
        if place.modality.sensor_kind() == SensorKind::Camera {
            return self.show_image(&place, header, payload);
        }
        let labels = &self.labels;
        let name = |id: u32| labels.get(&id).cloned().unwrap_or_else(|| id.to_string());
        let look = self.pictures.look();
        self.senses
            .show(&self.rec, look, &place, header, payload, &name)
    }

    /// Takes in a frame that is not shown itself, because too many come: events, whose time surface
    /// holds all of them. `header` must have passed its check.
    pub fn pass(&mut self, topic: &str, header: &FrameHeader, payload: &[u8]) {
        let Some(place) = Place::new(topic).filter(|place| place.modality == Modality::Dvs) else {
            return;
        };
        if !self.pictures.look().time_surface {
            return;
        }
        if let Some(size) = images::image_size_px(header) {
            let begin_nanos = header.sim_nanos.saturating_sub(header.window_nanos);
            let surface = self.surfaces.entry(place.topic()).or_default();
            surface.take(size, begin_nanos, payload);
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
        let drawn = self
            .results
            .show(&self.rec, &self.rigs, &mut self.pictures, parts)?;
        if drawn {
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
        &mut self,
        place: &Place,
        header: &FrameHeader,
        payload: &[u8],
    ) -> anyhow::Result<()> {
        let path = place.frame_path();
        let size = [header.width, header.height];
        match place.modality {
            Modality::Instance => {
                let ids = Ids::read(size, &images::tight(header, payload));
                self.pictures.ids(&self.rec, &path, size, &ids)?;
                self.show_truth(place, header, &ids)
            }
            Modality::Dvs => {
                let Some(size) = images::image_size_px(header) else {
                    return Ok(());
                };
                let numbers = images::event_numbers(size, payload);
                let colours = &palette::EVENTS;
                self.pictures
                    .numbered(&self.rec, &path, size, colours, &numbers)?;
                self.pass(&place.topic(), header, payload);
                let Some(surface) = self.surfaces.get(&place.topic()) else {
                    return Ok(());
                };
                let numbers = surface.numbers(header.sim_nanos);
                let path = place.surface_path();
                self.pictures
                    .numbered(&self.rec, &path, size, &surface::colours(), &numbers)
            }
            modality => {
                self.pictures
                    .show(&self.rec, &path, modality, header, payload)?;
                Ok(())
            }
        }
    }

    /// Draws the boxes of the actors that a camera sees, from the pixels that show them, over its
    /// colour image; over its ids if it has none.
    fn show_truth(&self, place: &Place, header: &FrameHeader, ids: &Ids) -> anyhow::Result<()> {
        if !self.pictures.look().truth {
            return Ok(());
        }
        let colour = Place {
            modality: Modality::Rgb,
            ..place.clone()
        };
        let on = match self.places.contains(&colour) {
            true => colour.frame_path(),
            false => place.frame_path(),
        };
        let known = |extent: &&crate::ids::Extent| {
            extent.id != header.parent_id && self.labels.contains_key(&extent.id)
        };
        let seen: Vec<_> = ids.visible().filter(known).collect();
        let boxes = rerun::Boxes2D::from_mins_and_sizes(
            seen.iter().map(|it| it.min_px.map(|px| px as f32)),
            seen.iter()
                .map(|it| [0, 1].map(|axis| (it.max_px[axis] - it.min_px[axis]) as f32)),
        )
        .with_labels(seen.iter().map(|it| self.labels[&it.id].as_str()))
        .with_show_labels(false)
        .with_colors(seen.iter().map(|it| {
            let [r, g, b] = palette::object(it.id);
            Rgba32::from_rgb(r, g, b)
        }))
        .with_radii([rerun::Radius::new_ui_points(TRUTH_LINE)]);
        Ok(self.rec.log(format!("{on}/truth"), &boxes)?)
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
                traffic::colour_states(&self.rec, &place.rig)?;
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
        if place.modality == Modality::Depth
            && self.scales.insert(place.frame_path(), size) != Some(size)
        {
            self.draw_scale(place, size)?;
        }
        Ok(())
    }

    /// Draws the colours of distances in the lower part of their image, with room for words below.
    fn draw_scale(&self, place: &Place, size: [u32; 2]) -> anyhow::Result<()> {
        let [width, height] = size.map(|px| px as f32);
        let (left, length, y) = (width * 0.2, width * 0.6, height * 0.86);
        let at = |share: f32| [left + length * share, y];
        let ends = |step: usize| [step, step + 1].map(|step| at(step as f32 / SCALE_STEPS as f32));
        let colour = |step: usize| {
            let [r, g, b] = images::turbo((step as f32 + 0.5) / SCALE_STEPS as f32);
            Rgba32::from_rgb(r, g, b)
        };
        let bar = rerun::LineStrips2D::new((0..SCALE_STEPS).map(ends))
            .with_colors((0..SCALE_STEPS).map(colour))
            .with_radii([rerun::Radius::new_ui_points(4.0)])
            .with_draw_order(20.0);
        let path = format!("{}/scale", place.frame_path());
        self.rec.log_static(path.as_str(), &bar)?;
        let shares = [0.0, 0.5, 1.0];
        let words = shares.map(|share| format!("{:.0} m", share * DEPTH_RANGE_M));
        let marks = rerun::Points2D::new(shares.map(|share| at(share as f32)))
            .with_labels(words)
            .with_show_labels(true)
            .with_colors([Rgba32::from_rgb(255, 255, 255)])
            .with_radii([rerun::Radius::new_ui_points(1.5)])
            .with_draw_order(21.0);
        Ok(self.rec.log_static(format!("{path}/marks"), &marks)?)
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
