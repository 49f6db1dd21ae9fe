//! Where things stand in rerun's tree of entities, and how the window is divided among them.

use std::collections::{BTreeMap, BTreeSet};

use rerun::blueprint::components::{BackgroundKind, PanelState};
use rerun::blueprint::{
    BarChartView, Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Grid, Horizontal,
    SelectionPanel, Spatial2DView, Spatial3DView, Tabs, TensorView, TextDocumentView, TextLogView,
    TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::archetypes::{Background, EyeControls3D};
use rerun::log::LogMsg;
use rerun::{RecordingStream, RecordingStreamBuilder, Rgba32};
use schema_bus::names;
use schema_frames::{Modality, SensorKind};

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
/// rig and following it.
///
/// # Errors
/// If the recording's other end refuses.
pub fn arrange(
    rec: &RecordingStream,
    places: &BTreeSet<Place>,
    results: &BTreeSet<ResultView>,
) -> anyhow::Result<()> {
    let mut left: Vec<ContainerLike> = Vec::new();
    let mut shares = Vec::new();
    let mut cameras = camera_grids(places);
    match cameras.len() {
        0 => {}
        1 => left.extend(cameras.pop()),
        _ => left.push(Tabs::new(cameras).into()),
    }
    shares.extend(left.first().map(|_| 3.0));
    if !results.is_empty() {
        left.push(result_grid(results));
        shares.push(if results.len() > 4 { 2.2 } else { 1.5 });
    }
    left.push(plots());
    shares.push(1.3);
    let carried = places.iter().filter(|place| !place.sensor.is_empty());
    let followed = carried.map(Place::rig_path).min();
    let world = world(places, followed.as_deref());
    let ContainerLike::View(view) = &world else {
        unreachable!("a Spatial3DView is a view")
    };
    let world_path = view.blueprint_path().to_string();
    let root = Horizontal::new([Vertical::new(left).with_row_shares(shares).into(), world])
        .with_column_shares(vec![1.35, 1.0]);
    let blueprint = Blueprint::new(root)
        .with_auto_views(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(
            TimePanel::new()
                .with_timeline(SIM_TIME)
                .with_state(PanelState::Collapsed),
        );
    send(rec, &blueprint, &world_path, followed.is_some())
}

/// Sends the blueprint together with the 3D view's eye and background. The blueprint types of this
/// rerun version cannot carry these two, so they are logged into the same blueprint store under the
/// view's path.
fn send(
    rec: &RecordingStream,
    blueprint: &Blueprint,
    world_path: &str,
    follow: bool,
) -> anyhow::Result<()> {
    let scratch = match rec.store_info() {
        Some(info) => RecordingStreamBuilder::new(info.application_id().clone()),
        None => RecordingStreamBuilder::new(APPLICATION),
    };
    let (scratch, storage) = scratch.memory()?;
    blueprint.send(
        &scratch,
        BlueprintActivation {
            make_active: true,
            make_default: true,
        },
    )?;
    scratch.flush_blocking()?;
    let messages = storage.take();
    let activation = messages.iter().find_map(|message| match message {
        LogMsg::BlueprintActivationCommand(command) => Some(command.clone()),
        _ => None,
    });
    let Some(activation) = activation else {
        return Ok(());
    };
    let mut messages: Vec<LogMsg> = messages
        .into_iter()
        .filter(|message| {
            *message.store_id() == activation.blueprint_id
                && !matches!(message, LogMsg::BlueprintActivationCommand(_))
        })
        .collect();
    let (extra, storage) =
        RecordingStreamBuilder::from_store_id(&activation.blueprint_id).memory()?;
    extra.set_time_sequence("blueprint", 0);
    extra.log(
        format!("{world_path}/Background"),
        &Background::new(BackgroundKind::SolidColor).with_color(Rgba32::from_rgb(22, 25, 30)),
    )?;
    if follow {
        let eye = EyeControls3D::new()
            .with_position(EYE_M)
            .with_look_target(LOOK_M)
            .with_eye_up([0.0, 0.0, 1.0]);
        extra.log(format!("{world_path}/EyeControls3D"), &eye)?;
    }
    extra.flush_blocking()?;
    messages.extend(
        storage
            .take()
            .into_iter()
            .filter(|message| matches!(message, LogMsg::ArrowMsg(..))),
    );
    rec.send_blueprint(messages, activation);
    Ok(())
}

/// Name of the application in rerun.
pub const APPLICATION: &str = "gantry";

/// The 3D view. It contains only the colour images of cameras: a depth image would become a cloud
/// that hides the world.
fn world(places: &BTreeSet<Place>, followed: Option<&str>) -> ContainerLike {
    let mut contents = vec![format!("+ {WORLD}/**")];
    for place in places.iter().filter(|place| {
        place.modality.sensor_kind() == SensorKind::Camera && place.modality != Modality::Rgb
    }) {
        contents.push(format!("- {}/**", place.frame_path()));
    }
    Spatial3DView::new("world")
        .with_origin(followed.unwrap_or(WORLD))
        .with_contents(contents)
        .into()
}

/// One grid per camera.
fn camera_grids(places: &BTreeSet<Place>) -> Vec<ContainerLike> {
    let mut by_camera: BTreeMap<String, Vec<&Place>> = BTreeMap::new();
    for place in places
        .iter()
        .filter(|place| place.modality.sensor_kind() == SensorKind::Camera)
    {
        by_camera.entry(place.camera()).or_default().push(place);
    }
    let grid = |(camera, places): (String, Vec<&Place>)| -> ContainerLike {
        let order = |modality| {
            CAMERA_ORDER
                .iter()
                .position(|m| *m == modality)
                .unwrap_or(CAMERA_ORDER.len())
        };
        let mut places = places;
        places.sort_by_key(|place| order(place.modality));
        let views = places.iter().map(|place| -> ContainerLike {
            let name = format!("{camera} {}", place.modality.name());
            Spatial2DView::new(name)
                .with_origin(place.sensor_path())
                .with_contents([format!("$origin/{}/**", place.modality.name())])
                .into()
        });
        Grid::new(views)
            .with_name(camera.clone())
            .with_grid_columns(columns(places.len()))
            .into()
    };
    by_camera.into_iter().map(grid).collect()
}

/// The views of results: beside one another while there are few, each behind a tab otherwise.
fn result_grid(results: &BTreeSet<ResultView>) -> ContainerLike {
    let is_line = |view: &&ResultView| view.kind == ViewKind::Lines;
    let mut views: Vec<ContainerLike> = results
        .iter()
        .filter(|view| !is_line(view))
        .map(result_view)
        .collect();
    if results.iter().any(|view| is_line(&view)) {
        views.push(TextLogView::new("texts").with_origin(LOG).into());
    }
    match views.len() {
        1..=MAX_BESIDE => {
            let columns = columns(views.len());
            Grid::new(views).with_grid_columns(columns).into()
        }
        _ => Tabs::new(views).into(),
    }
}

fn result_view(view: &ResultView) -> ContainerLike {
    let (topic, origin) = (view.topic.as_str(), format!("{RESULTS}/{}", view.topic));
    match view.kind {
        ViewKind::Picture => Spatial2DView::new(topic).with_origin(origin).into(),
        ViewKind::Tensor => TensorView::new(topic)
            .with_origin(origin)
            .with_contents(["$origin"])
            .into(),
        ViewKind::Histogram => BarChartView::new(format!("{topic} histogram"))
            .with_origin(format!("{origin}/histogram"))
            .into(),
        ViewKind::Series | ViewKind::Lines => TimeSeriesView::new(topic).with_origin(origin).into(),
        ViewKind::Page => TextDocumentView::new(topic).with_origin(origin).into(),
    }
}

fn columns(n_views: usize) -> u32 {
    if n_views <= 1 {
        1
    } else if n_views <= 4 {
        2
    } else {
        3
    }
}

fn plots() -> ContainerLike {
    let plot = |name: &str| -> ContainerLike {
        TimeSeriesView::new(name)
            .with_origin(format!("{PLOTS}/{name}"))
            .into()
    };
    Horizontal::new([plot("speed"), plot("control"), plot("latency")]).into()
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
