//! Where things hang in rerun's tree, and how the window is divided among them.

use std::collections::{BTreeMap, BTreeSet};

use rerun::blueprint::components::PanelState;
use rerun::blueprint::{
    Blueprint, BlueprintPanel, ContainerLike, Grid, Horizontal, SelectionPanel, Spatial2DView, Spatial3DView, Tabs, TimePanel, TimeSeriesView, Vertical,
};
use schema_frames::{Modality, SensorKind};

/// Everything that stands in the world.
pub const WORLD: &str = "/world";
/// Lane lines.
pub const MAP: &str = "/world/map";
/// Boxes of the actors.
pub const ACTORS: &str = "/world/actors";
/// Curves over time.
pub const PLOTS: &str = "/plots";
/// What happened, in words.
pub const LOG: &str = "/logs";
/// Timeline of simulated time.
pub const SIM_TIME: &str = "sim_time";
/// Timeline of ticks.
pub const TICK: &str = "tick";

/// A topic `rig/sensor/modality` in the tree.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// `ego`.
    pub rig: String,
    /// `front`.
    pub sensor: String,
    /// The last segment.
    pub modality: Modality,
}

impl Place {
    /// `None` for a topic that is not a sensor's.
    pub fn new(topic: &str) -> Option<Place> {
        let mut parts = topic.split('/');
        let (rig, sensor, modality) = (parts.next()?, parts.next()?, parts.next()?);
        if parts.next().is_some() || rig.is_empty() || sensor.is_empty() {
            return None;
        }
        Some(Place { rig: rig.to_string(), sensor: sensor.to_string(), modality: Modality::from_name(modality)? })
    }

    /// `/world/ego`.
    pub fn rig_path(&self) -> String {
        format!("{WORLD}/{}", self.rig)
    }

    /// `/world/ego/front`.
    pub fn sensor_path(&self) -> String {
        format!("{WORLD}/{}/{}", self.rig, self.sensor)
    }

    /// `/world/ego/front/rgb`.
    pub fn frame_path(&self) -> String {
        format!("{}/{}", self.sensor_path(), self.modality.name())
    }

    /// `/plots/latency/ego/front/rgb`.
    pub fn latency_path(&self) -> String {
        format!("{PLOTS}/latency/{}/{}/{}", self.rig, self.sensor, self.modality.name())
    }
}

/// Views in this order per camera.
const CAMERA_ORDER: [Modality; 7] =
    [Modality::Rgb, Modality::Depth, Modality::Semantic, Modality::Instance, Modality::Flow, Modality::Dvs, Modality::Normals];

/// The window for the topics that are there: the world on the left, one view per camera and modality on the right, plots below.
pub fn blueprint(places: &BTreeSet<Place>) -> Blueprint {
    let mut right: Vec<ContainerLike> = Vec::new();
    let cameras = camera_grids(places);
    if !cameras.is_empty() {
        right.push(if cameras.len() == 1 { cameras.into_iter().next().expect("length is one") } else { Tabs::new(cameras).into() });
    }
    right.push(plots());
    let n = right.len();
    let shares = if n == 2 { vec![3.0, 1.3] } else { vec![1.0] };
    let root = Horizontal::new([world(places), Vertical::new(right).with_row_shares(shares).into()]).with_column_shares(vec![1.0, 1.25]);
    Blueprint::new(root)
        .with_auto_views(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(TimePanel::new().with_timeline(SIM_TIME).with_state(PanelState::Collapsed))
}

/// The 3D view. Depth stays out of it: its clouds hide the world and cost the most.
fn world(places: &BTreeSet<Place>) -> ContainerLike {
    let mut contents = vec![format!("+ {WORLD}/**")];
    for place in places.iter().filter(|place| place.modality.sensor_kind() == SensorKind::Camera && place.modality != Modality::Rgb) {
        contents.push(format!("- {}", place.frame_path()));
    }
    Spatial3DView::new("world").with_origin(WORLD).with_contents(contents).into()
}

/// One grid per camera.
fn camera_grids(places: &BTreeSet<Place>) -> Vec<ContainerLike> {
    let mut by_camera: BTreeMap<String, Vec<&Place>> = BTreeMap::new();
    for place in places.iter().filter(|place| place.modality.sensor_kind() == SensorKind::Camera) {
        by_camera.entry(format!("{}/{}", place.rig, place.sensor)).or_default().push(place);
    }
    let grid = |(camera, places): (String, Vec<&Place>)| -> ContainerLike {
        let order = |modality| CAMERA_ORDER.iter().position(|m| *m == modality).unwrap_or(CAMERA_ORDER.len());
        let mut places = places;
        places.sort_by_key(|place| order(place.modality));
        let views = places.iter().map(|place| -> ContainerLike {
            let name = format!("{camera} {}", place.modality.name());
            Spatial2DView::new(name).with_origin(place.sensor_path()).with_contents([format!("$origin/{}", place.modality.name())]).into()
        });
        Grid::new(views).with_name(camera.clone()).with_grid_columns(columns(places.len())).into()
    };
    by_camera.into_iter().map(grid).collect()
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
    let plot = |name: &str| -> ContainerLike { TimeSeriesView::new(name).with_origin(format!("{PLOTS}/{name}")).into() };
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
        for other in ["world/snapshot", "ego/front", "ego/front/rgb/gantry", "ego/front/heat", "//rgb"] {
            assert_eq!(Place::new(other), None, "{other}");
        }
    }
}
