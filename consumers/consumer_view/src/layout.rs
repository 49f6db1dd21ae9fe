//! Where things stand in rerun's tree of entities, and how the window is divided among them.

use std::collections::{BTreeMap, BTreeSet};

use rerun::blueprint::components::{BackgroundKind, ContainerKind};
use rerun::re_sdk_types::blueprint::archetypes::{Background, EyeControls3D, MapZoom};
use rerun::{RecordingStream, Rgba32};
use schema_bus::names;
use schema_frames::{Modality, SensorKind};

use crate::blueprint::{self, Part};
use crate::rerun;

/// Everything that stands in the world.
pub const WORLD: &str = "/world";
/// Lane lines.
pub const MAP: &str = "/world/map";
/// Boxes of the actors.
pub const ACTORS: &str = "/world/actors";
/// Curves over time.
pub const PLOTS: &str = "/plots";
/// What happened, in words, and texts of users' programs.
pub const LOG: &str = "/logs";
/// Results of users' programs that have views of their own.
pub const RESULTS: &str = "/results";
/// Places on Earth.
pub const GEO: &str = "/geo";
/// What event sensors saw, in words.
pub const EVENTS: &str = "/events";
/// What the rigs' vehicles are doing: lights, gear.
pub const STATES: &str = "/states";
/// Timeline of simulated time.
pub const SIM_TIME: &str = "sim_time";
/// Timeline of ticks.
pub const TICK: &str = "tick";

/// A topic `rig/sensor/modality` in the tree, or the spectator's, whose sensor has no name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// `ego`.
    pub rig: String,
    /// `front`; empty for the spectator.
    pub sensor: String,
    /// The last segment.
    pub modality: Modality,
}

impl Place {
    /// `None` for a topic that is not a sensor's.
    pub fn new(topic: &str) -> Option<Place> {
        if topic == names::SPECTATOR_RGB {
            return Some(Place {
                rig: names::rig_of(topic).to_owned(),
                sensor: String::new(),
                modality: Modality::Rgb,
            });
        }
        let mut parts = topic.split('/');
        let (rig, sensor, modality) = (parts.next()?, parts.next()?, parts.next()?);
        if parts.next().is_some() || rig.is_empty() || sensor.is_empty() {
            return None;
        }
        Some(Place {
            rig: rig.to_string(),
            sensor: sensor.to_string(),
            modality: Modality::from_name(modality)?,
        })
    }

    /// `ego/front/rgb`.
    pub fn topic(&self) -> String {
        format!("{}/{}", self.camera(), self.modality.name())
    }

    /// `ego/front`; the spectator's rig alone.
    pub fn camera(&self) -> String {
        match self.sensor.as_str() {
            "" => self.rig.clone(),
            sensor => format!("{}/{sensor}", self.rig),
        }
    }

    /// `/world/ego`.
    pub fn rig_path(&self) -> String {
        format!("{WORLD}/{}", self.rig)
    }

    /// `/world/ego/front`.
    pub fn sensor_path(&self) -> String {
        format!("{WORLD}/{}", self.camera())
    }

    /// `/world/ego/front/rgb`.
    pub fn frame_path(&self) -> String {
        format!("{}/{}", self.sensor_path(), self.modality.name())
    }

    /// `/world/ego/front/dvs/surface`: when each pixel changed last.
    pub fn surface_path(&self) -> String {
        format!("{}/surface", self.frame_path())
    }

    /// `/plots/force/ego/imu`: a curve that belongs to the sensor.
    pub fn curve_path(&self, curve: &str) -> String {
        format!("{PLOTS}/{curve}/{}", self.camera())
    }

    /// `/geo/ego/gnss`.
    pub fn geo_path(&self) -> String {
        format!("{GEO}/{}", self.camera())
    }

    /// `/events/ego/bumper/collision`.
    pub fn events_path(&self) -> String {
        format!("{EVENTS}/{}", self.topic())
    }

    /// `/plots/latency/ego/front/rgb`.
    pub fn latency_path(&self) -> String {
        latency_path(&self.topic())
    }
}

/// `/plots/latency/<topic>`.
pub fn latency_path(topic: &str) -> String {
    format!("{PLOTS}/latency/{topic}")
}

/// A view that a topic of results needs for itself.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ResultView {
    /// The topic without the domain.
    pub topic: String,
    /// What the view shows.
    pub kind: ViewKind,
}

/// Kind of a view of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ViewKind {
    /// An image, and what lies on it.
    Picture,
    /// A tensor that is no image.
    Tensor,
    /// How often which number occurs in a tensor.
    Histogram,
    /// Curves.
    Series,
    /// A text that each result replaces.
    Page,
    /// Texts, one line each; all topics share one view.
    Lines,
}

/// Most views of results beside one another; more are put behind tabs.
const MAX_BESIDE: usize = 9;

/// Order of a camera's modalities in its grid.
const CAMERA_ORDER: [Modality; 7] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Dvs,
    Modality::Normals,
];

/// Position of the eye and the point it looks at, in the axes of the followed rig, metres: behind
/// and above, as in a driving game.
const EYE_M: [f32; 3] = [-17.0, 0.0, 8.5];
const LOOK_M: [f32; 3] = [10.0, 0.0, 0.5];

/// Divides the window among the topics that exist: on the left one view per camera and modality,
/// below them the views of results and curves, on the right the world, seen from behind the first
/// rig and following it, and behind a tab the map.
///
/// # Errors
/// If the recording's other end refuses.
pub fn arrange(
    rec: &RecordingStream,
    places: &BTreeSet<Place>,
    results: &BTreeSet<ResultView>,
    time_surface: bool,
) -> anyhow::Result<()> {
    let mut left = Vec::new();
    let mut shares = Vec::new();
    let cameras = camera_grids(places, time_surface);
    if !cameras.is_empty() {
        left.push(Part::tabs(cameras));
        shares.push(3.0);
    }
    if !results.is_empty() {
        left.push(result_grid(results));
        shares.push(if results.len() > 4 { 2.2 } else { 1.5 });
    }
    left.push(plots(places));
    shares.push(1.3);
    let carried = places.iter().filter(|place| !place.sensor.is_empty());
    let followed = carried
        .min_by_key(|place| (place.rig != EGO, &place.rig))
        .map(Place::rig_path);
    let mut right = vec![world(places, followed.as_deref())];
    if places.iter().any(|place| place.modality == Modality::Gnss) {
        right.push(Part::view("Map", "map", GEO).with("MapZoom", MapZoom::new(17.0)));
    }
    let left = Part::group(ContainerKind::Vertical, left).with_shares(shares);
    let root = Part::group(ContainerKind::Horizontal, vec![left, Part::tabs(right)])
        .with_shares(vec![1.35, 1.0]);
    blueprint::send(rec, &root, SIM_TIME)
}

/// The rig that goes before others.
const EGO: &str = "ego";

/// Name of the application in rerun.
pub const APPLICATION: &str = "gantry";

/// The 3D view. It contains only the colour images of cameras: a depth image would become a cloud
/// that hides the world.
fn world(places: &BTreeSet<Place>, followed: Option<&str>) -> Part {
    let mut contents = vec![format!("+ {WORLD}/**")];
    for place in places.iter().filter(|place| {
        place.modality.sensor_kind() == SensorKind::Camera && place.modality != Modality::Rgb
    }) {
        contents.push(format!("- {}/**", place.frame_path()));
    }
    let background =
        Background::new(BackgroundKind::SolidColor).with_color(Rgba32::from_rgb(22, 25, 30));
    let view = Part::showing("3D", "world", followed.unwrap_or(WORLD), contents)
        .with("Background", background);
    if followed.is_none() {
        return view;
    }
    let eye = EyeControls3D::new()
        .with_position(EYE_M)
        .with_look_target(LOOK_M)
        .with_eye_up([0.0, 0.0, 1.0]);
    view.with("EyeControls3D", eye)
}

/// One grid per camera, those of the ego first.
fn camera_grids(places: &BTreeSet<Place>, time_surface: bool) -> Vec<Part> {
    let mut by_camera: BTreeMap<(bool, String), Vec<&Place>> = BTreeMap::new();
    for place in places
        .iter()
        .filter(|place| place.modality.sensor_kind() == SensorKind::Camera)
    {
        let key = (place.rig != EGO, place.camera());
        by_camera.entry(key).or_default().push(place);
    }
    let grid = |((_, camera), mut places): ((bool, String), Vec<&Place>)| {
        let order = |modality| CAMERA_ORDER.iter().position(|m| *m == modality);
        places.sort_by_key(|place| order(place.modality).unwrap_or(CAMERA_ORDER.len()));
        let view = |place: &&Place| picture_view(place, &camera, time_surface);
        let views = places.iter().map(view).collect();
        grid_of(views).with_name(camera.clone())
    };
    by_camera.into_iter().map(grid).collect()
}

/// The view of one modality; of events, their image and their time surface.
fn picture_view(place: &Place, camera: &str, time_surface: bool) -> Part {
    let name = format!("{camera} {}", place.modality.name());
    let all = format!("+ $origin/{}/**", place.modality.name());
    let of = |name: String, contents: Vec<String>| {
        Part::showing("2D", name, place.sensor_path(), contents)
    };
    if place.modality != Modality::Dvs || !time_surface {
        return of(name, vec![all]);
    }
    let surface = place.surface_path();
    let tab = of(format!("{name} time surface"), vec![format!("+ {surface}")]);
    Part::tabs(vec![tab, of(name, vec![all, format!("- {surface}")])])
}

fn grid_of(views: Vec<Part>) -> Part {
    let columns = columns(views.len());
    let mut grid = Part::group(ContainerKind::Grid, views);
    if let Part::Group(group) = &mut grid {
        group.columns = Some(columns);
    }
    grid
}

/// The views of results: beside one another while there are few, each behind a tab otherwise.
fn result_grid(results: &BTreeSet<ResultView>) -> Part {
    let is_line = |view: &&ResultView| view.kind == ViewKind::Lines;
    let mut views: Vec<Part> = results
        .iter()
        .filter(|view| !is_line(view))
        .map(result_view)
        .collect();
    if results.iter().any(|view| is_line(&view)) {
        views.push(Part::view("TextLog", "texts", LOG));
    }
    match views.len() {
        1..=MAX_BESIDE => grid_of(views),
        _ => Part::tabs(views),
    }
}

fn result_view(view: &ResultView) -> Part {
    let (topic, origin) = (view.topic.as_str(), format!("{RESULTS}/{}", view.topic));
    match view.kind {
        ViewKind::Picture => Part::view("2D", topic, origin),
        ViewKind::Tensor => Part::showing("Tensor", topic, origin, ["$origin".to_owned()]),
        ViewKind::Histogram => Part::view(
            "BarChart",
            format!("{topic} histogram"),
            format!("{origin}/histogram"),
        ),
        ViewKind::Series | ViewKind::Lines => Part::view("TimeSeries", topic, origin),
        ViewKind::Page => Part::view("TextDocument", topic, origin),
    }
}

fn columns(n_views: usize) -> u32 {
    match n_views {
        0..=1 => 1,
        2..=4 => 2,
        _ => 3,
    }
}

/// Curves beside one another; what is looked at more rarely is behind tabs.
fn plots(places: &BTreeSet<Place>) -> Part {
    let plot = |name: &str| Part::view("TimeSeries", name, format!("{PLOTS}/{name}"));
    let has = |modality: Modality| places.iter().any(|place| place.modality == modality);
    let mut rest = vec![
        plot("latency"),
        Part::view("StateTimeline", "states", STATES),
    ];
    if has(Modality::Imu) {
        rest.extend([plot("force"), plot("turn")]);
    }
    let lines = [format!("+ {EVENTS}/**"), format!("+ {LOG}/**")];
    rest.push(Part::showing("TextLog", "log", "/", lines));
    let parts = vec![plot("speed"), plot("control"), Part::tabs(rest)];
    Part::group(ContainerKind::Horizontal, parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_have_a_place_and_others_have_none() {
        let place = Place::new("ego/front/rgb").unwrap();
        assert_eq!(place.frame_path(), "/world/ego/front/rgb");
        assert_eq!(place.sensor_path(), "/world/ego/front");
        let spectator = Place::new("spectator/rgb").unwrap();
        assert_eq!(spectator.frame_path(), "/world/spectator/rgb");
        assert_eq!(spectator.topic(), "spectator/rgb");
        for other in [
            "world/snapshot",
            "ego/front",
            "ego/front/rgb/gantry",
            "ego/front/heat",
            "//rgb",
        ] {
            assert_eq!(Place::new(other), None, "{other}");
        }
    }
}
