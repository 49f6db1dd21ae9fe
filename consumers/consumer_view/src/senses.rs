//! Sensors that make no images: clouds, radar, positions, motion, and events as marks on the time
//! line.

use std::collections::BTreeMap;

use bytemuck::{Pod, pod_read_unaligned};
use rerun::{RecordingStream, Rgba32, TextLogLevel};
use schema_frames::{
    CollisionEvent, FrameHeader, GnssSample, ImuSample, LaneCrossing, Modality, ObstacleEvent,
    RadarDetection,
};
use schema_types::Class;

use crate::images;
use crate::layout::Place;
use crate::look::Look;
use crate::rerun;

/// Speed along the ray that a detection shows in full colour, m/s.
const FULL_SPEED_MPS: f32 = 15.0;
/// How long the mark of an event stays in the world, simulated nanoseconds.
const MARK_NANOS: u64 = 1_000_000_000;
/// How often an obstacle that stays is told again, simulated nanoseconds.
const AGAIN_NANOS: u64 = 1_000_000_000;
/// Places of a position's trail.
const TRAIL_POINTS: usize = 1000;
/// Impulse whose arrow is one metre long, N·s.
const IMPULSE_OF_A_METRE: f64 = 2000.0;

/// What is remembered of sensors.
#[derive(Default)]
pub(crate) struct Senses {
    trails: BTreeMap<String, Vec<[f64; 2]>>,
    /// Marks in the world, and when they were made.
    marks: BTreeMap<String, u64>,
    /// By topic: the obstacle that was told last, and when.
    told: BTreeMap<String, (u32, u64)>,
    /// Curves whose names are logged.
    named: std::collections::BTreeSet<String>,
}

impl Senses {
    /// Shows a frame that is no image. `name` gives an actor's name by its id.
    pub(crate) fn show(
        &mut self,
        rec: &RecordingStream,
        look: &Look,
        place: &Place,
        header: &FrameHeader,
        payload: &[u8],
        name: &dyn Fn(u32) -> String,
    ) -> anyhow::Result<()> {
        match place.modality {
            Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns => {
                let (positions, colours) = images::cloud(header, payload, look.max_points);
                let colours = colours
                    .into_iter()
                    .map(|[r, g, b]| Rgba32::from_rgb(r, g, b));
                let points = rerun::Points3D::new(positions)
                    .with_colors(colours)
                    .with_radii([0.05]);
                Ok(rec.log(place.frame_path(), &points)?)
            }
            Modality::Radar => {
                let found: Vec<RadarDetection> = records(payload);
                let points = rerun::Points3D::new(found.iter().map(in_sensor))
                    .with_colors(found.iter().map(|it| speed_colour(it.velocity_mps)))
                    .with_labels(
                        found
                            .iter()
                            .map(|it| format!("{:.1} m, {:+.1} m/s", it.depth_m, it.velocity_mps)),
                    )
                    .with_show_labels(false)
                    .with_radii([0.12]);
                Ok(rec.log(place.frame_path(), &points)?)
            }
            Modality::Imu => self.imu(rec, place, payload),
            Modality::Gnss => self.gnss(rec, place, payload),
            Modality::Collision => {
                let met: Vec<CollisionEvent> = records(payload);
                for it in &met {
                    let impulse = length(it.impulse_in_world_ns);
                    let other = whom(it.other_id, it.class, name);
                    let line = format!("collision with {other}, {impulse:.0} N·s");
                    say(rec, place, TextLogLevel::ERROR, &line)?;
                }
                let path = format!("{}/marks/{}", crate::layout::WORLD, place.topic());
                let arrows = rerun::Arrows3D::from_vectors(met.iter().map(|it| {
                    it.impulse_in_world_ns
                        .map(|part| (part / IMPULSE_OF_A_METRE) as f32)
                }))
                .with_origins(met.iter().map(|it| it.point_in_world_m.map(|x| x as f32)))
                .with_colors([Rgba32::from_rgb(255, 60, 50)])
                .with_radii([0.12]);
                self.mark(rec, path, header, &arrows)
            }
            Modality::LaneInvasion => {
                let crossed: Vec<LaneCrossing> = records(payload);
                for it in &crossed {
                    let line = format!(
                        "crossed a {} {} line (road {}, lane {})",
                        colour_name(it.colour),
                        mark_name(it.mark),
                        it.road,
                        it.lane
                    );
                    say(rec, place, TextLogLevel::WARN, &line)?;
                }
                let path = format!("{}/marks/{}", crate::layout::WORLD, place.topic());
                let points = rerun::Points3D::new(crossed.iter().map(|it| it.crossing_in_world_m))
                    .with_colors([Rgba32::from_rgb(255, 200, 40)])
                    .with_radii([0.25]);
                self.mark(rec, path, header, &points)
            }
            Modality::Obstacle => {
                let Some(it) = records::<ObstacleEvent>(payload).first().copied() else {
                    return Ok(());
                };
                let before = self.told.get(&place.topic()).copied();
                let is_new = before.is_none_or(|(id, at)| {
                    id != it.object_id || header.sim_nanos.saturating_sub(at) >= AGAIN_NANOS
                });
                if is_new {
                    let other = whom(it.object_id, it.class, name);
                    let line = format!("{other} in the way, {:.1} m ahead", it.distance_m);
                    say(rec, place, TextLogLevel::WARN, &line)?;
                    let told = (it.object_id, header.sim_nanos);
                    self.told.insert(place.topic(), told);
                }
                let points = rerun::Points3D::new([it.contact_in_sensor_m])
                    .with_colors([Rgba32::from_rgb(255, 120, 40)])
                    .with_radii([0.2]);
                self.mark(rec, place.frame_path(), header, &points)
            }
            _ => Ok(()),
        }
    }

    /// Removes marks of events that are over.
    pub(crate) fn tidy(&mut self, rec: &RecordingStream, sim_nanos: u64) -> anyhow::Result<()> {
        let is_over = |made: &u64| sim_nanos.saturating_sub(*made) >= MARK_NANOS;
        let over = self.marks.iter().filter(|(_, made)| is_over(made));
        let over: Vec<String> = over.map(|(path, _)| path.clone()).collect();
        for path in over {
            rec.log(path.as_str(), &rerun::Clear::flat())?;
            self.marks.remove(&path);
        }
        Ok(())
    }

    fn mark(
        &mut self,
        rec: &RecordingStream,
        path: String,
        header: &FrameHeader,
        what: &impl rerun::AsComponents,
    ) -> anyhow::Result<()> {
        rec.log(path.as_str(), what)?;
        self.marks.insert(path, header.sim_nanos);
        Ok(())
    }

    fn imu(&mut self, rec: &RecordingStream, place: &Place, payload: &[u8]) -> anyhow::Result<()> {
        let Some(sample) = records::<ImuSample>(payload).first().copied() else {
            return Ok(());
        };
        let curves = [
            ("force", "m/s²", sample.specific_force_mps2),
            ("turn", "rad/s", sample.angular_velocity_radps),
        ];
        for (curve, unit, values) in curves {
            let path = place.curve_path(curve);
            if self.named.insert(path.clone()) {
                let colours = [[240, 80, 70], [90, 200, 110], [90, 160, 255]];
                let lines = rerun::SeriesLines::new()
                    .with_names(["x", "y", "z"].map(|axis| format!("{axis}, {unit}")))
                    .with_colors(colours.map(|[r, g, b]| Rgba32::from_rgb(r, g, b)));
                rec.log_static(path.as_str(), &lines)?;
            }
            rec.log(path, &rerun::Scalars::new(values))?;
        }
        Ok(())
    }

    fn gnss(&mut self, rec: &RecordingStream, place: &Place, payload: &[u8]) -> anyhow::Result<()> {
        let Some(fix) = records::<GnssSample>(payload).first().copied() else {
            return Ok(());
        };
        let at = [fix.latitude_deg, fix.longitude_deg];
        if !at.iter().all(|degrees| degrees.is_finite()) {
            return Ok(());
        }
        let path = place.geo_path();
        let point = rerun::GeoPoints::from_lat_lon([at])
            .with_colors([Rgba32::from_rgb(255, 170, 40)])
            .with_radii([rerun::Radius::new_ui_points(6.0)]);
        rec.log(path.as_str(), &point)?;
        let trail = self.trails.entry(path.clone()).or_default();
        // A tenth of a second of arc is three metres.
        let far = trail
            .last()
            .is_none_or(|last| (0..2).any(|i| (last[i] - at[i]).abs() > 0.1 / 3600.0));
        if far {
            trail.push(at);
            if trail.len() > TRAIL_POINTS {
                trail.remove(0);
            }
            let line =
                rerun::GeoLineStrings::from_lat_lon([rerun::components::GeoLineString::from_iter(
                    trail.iter().copied(),
                )])
                .with_colors([Rgba32::from_rgb(255, 120, 40)])
                .with_radii([rerun::Radius::new_ui_points(2.0)]);
            rec.log(format!("{path}/trail"), &line)?;
        }
        Ok(())
    }
}

fn say(rec: &RecordingStream, place: &Place, level: &str, line: &str) -> anyhow::Result<()> {
    let text = rerun::TextLog::new(format!("{}: {line}", place.camera())).with_level(level);
    Ok(rec.log(place.events_path(), &text)?)
}

fn records<T: Pod>(payload: &[u8]) -> Vec<T> {
    let all = payload.chunks_exact(size_of::<T>());
    all.map(pod_read_unaligned).collect()
}

fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// An actor by its name, scenery by its class.
fn whom(id: u32, class: u8, name: &dyn Fn(u32) -> String) -> String {
    match id {
        0 => Class(class)
            .info()
            .map_or_else(|| "scenery".to_owned(), |info| info.name.to_owned()),
        id => name(id),
    }
}

/// Place of a detection, metres in the sensor's axes.
fn in_sensor(it: &RadarDetection) -> [f32; 3] {
    let across = it.depth_m * it.altitude_rad.cos();
    [
        across * it.azimuth_rad.cos(),
        across * it.azimuth_rad.sin(),
        it.depth_m * it.altitude_rad.sin(),
    ]
}

/// Red what comes nearer, blue what goes away, white what keeps its distance.
fn speed_colour(velocity_mps: f32) -> Rgba32 {
    let share = (velocity_mps / FULL_SPEED_MPS).clamp(-1.0, 1.0);
    let faded = (255.0 * (1.0 - share.abs())) as u8;
    match share < 0.0 {
        true => Rgba32::from_rgb(255, faded, faded),
        false => Rgba32::from_rgb(faded, faded, 255),
    }
}

fn mark_name(mark: u8) -> &'static str {
    match mark {
        1 => "solid",
        2 => "broken",
        3 => "double solid",
        4 => "solid and broken",
        5 => "broken and solid",
        6 => "double broken",
        7 => "Botts' dots",
        8 => "grass",
        9 => "kerb",
        _ => "other",
    }
}

fn colour_name(colour: u8) -> &'static str {
    let names = [
        "white", "yellow", "blue", "green", "red", "orange", "violet",
    ];
    names.get(colour as usize).copied().unwrap_or("painted")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_detection_lies_where_its_angles_say() {
        let mut it: RadarDetection = bytemuck::Zeroable::zeroed();
        (it.depth_m, it.azimuth_rad) = (10.0, std::f32::consts::FRAC_PI_2);
        let [x, y, z] = in_sensor(&it);
        assert!(x.abs() < 1e-5 && (y - 10.0).abs() < 1e-5 && z == 0.0);
        it.altitude_rad = std::f32::consts::FRAC_PI_6;
        let [_, y, z] = in_sensor(&it);
        assert!((z - 5.0).abs() < 1e-5 && (y - 75f32.sqrt()).abs() < 1e-4);
    }

    #[test]
    fn what_comes_nearer_is_red() {
        assert_eq!(speed_colour(-30.0), Rgba32::from_rgb(255, 0, 0));
        assert_eq!(speed_colour(0.0), Rgba32::from_rgb(255, 255, 255));
        assert_eq!(speed_colour(15.0), Rgba32::from_rgb(0, 0, 255));
    }
}
