//! How the window is divided, as rerun's viewer reads it: a tree of containers and views, logged as
//! a blueprint.
//!
//! Rerun's own builder logs into a recording in memory that keeps two threads for as long as the
//! program runs; this one hands the messages over and keeps nothing. Names of containers and views
//! hang on what they show, so that a view keeps its zoom and its eye when another topic comes.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use rerun::blueprint::components::{ContainerKind, PanelState};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::log::LogMsg;
use rerun::re_sdk_types::blueprint::archetypes as blueprints;
use rerun::sink::{LogSink, SinkFlushError};
use rerun::{AsComponents, RecordingStream, RecordingStreamBuilder};
use schema_types::noise::mix;

use crate::rerun;

/// A part of the window.
pub(crate) enum Part {
    /// Parts beside, above or behind one another.
    Group(Group),
    /// One view.
    View(View),
}

/// Parts beside, above or behind one another.
pub(crate) struct Group {
    pub(crate) kind: ContainerKind,
    pub(crate) name: Option<String>,
    pub(crate) parts: Vec<Part>,
    /// Shares of the height or the width; equal ones if empty.
    pub(crate) shares: Vec<f32>,
    /// Columns of a grid.
    pub(crate) columns: Option<u32>,
}

/// One view.
pub(crate) struct View {
    /// Rerun's name of its kind: `2D`, `TimeSeries`, ….
    pub(crate) class: &'static str,
    pub(crate) name: String,
    pub(crate) origin: String,
    /// What it shows, as rerun's queries; empty for all below its origin.
    pub(crate) contents: Vec<String>,
    /// Its settings by their names.
    pub(crate) properties: Vec<(&'static str, Box<dyn AsComponents>)>,
}

impl Part {
    /// A view of all below `origin`.
    pub(crate) fn view(
        class: &'static str,
        name: impl Into<String>,
        origin: impl Into<String>,
    ) -> Part {
        Part::showing(class, name, origin, [])
    }

    /// A view of `contents`.
    pub(crate) fn showing(
        class: &'static str,
        name: impl Into<String>,
        origin: impl Into<String>,
        contents: impl IntoIterator<Item = String>,
    ) -> Part {
        Part::View(View {
            class,
            name: name.into(),
            origin: origin.into(),
            contents: contents.into_iter().collect(),
            properties: Vec::new(),
        })
    }

    /// Parts in a container of this kind.
    pub(crate) fn group(kind: ContainerKind, parts: Vec<Part>) -> Part {
        Part::Group(Group {
            kind,
            name: None,
            parts,
            shares: Vec::new(),
            columns: None,
        })
    }

    /// Parts one of which is seen; one alone needs no tabs.
    pub(crate) fn tabs(mut parts: Vec<Part>) -> Part {
        match (parts.len(), parts.pop()) {
            (1, Some(only)) => only,
            (_, last) => {
                parts.extend(last);
                Part::group(ContainerKind::Tabs, parts)
            }
        }
    }

    /// With shares of the height or the width.
    pub(crate) fn with_shares(mut self, of: Vec<f32>) -> Part {
        if let Part::Group(group) = &mut self {
            group.shares = of;
        }
        self
    }

    /// With a name on its tab.
    pub(crate) fn with_name(mut self, name: String) -> Part {
        match &mut self {
            Part::Group(group) => group.name = Some(name),
            Part::View(view) => view.name = name,
        }
        self
    }

    /// With one of rerun's settings of its kind.
    pub(crate) fn with(mut self, name: &'static str, setting: impl AsComponents + 'static) -> Part {
        if let Part::View(view) = &mut self {
            view.properties.push((name, Box::new(setting)));
        }
        self
    }

    /// Logs it and what is in it; its path in the blueprint.
    fn log(&self, rec: &RecordingStream, place: &str) -> anyhow::Result<String> {
        match self {
            Part::View(view) => view.log(rec, place),
            Part::Group(group) => group.log(rec, place),
        }
    }
}

impl Group {
    fn log(&self, rec: &RecordingStream, place: &str) -> anyhow::Result<String> {
        let path = format!("container/{}", id(&format!("container {place}")));
        let mut contents = Vec::new();
        for (number, part) in self.parts.iter().enumerate() {
            contents.push(part.log(rec, &format!("{place}/{number}"))?);
        }
        let mut container = blueprints::ContainerBlueprint::new(self.kind)
            .with_contents(contents.iter().map(String::as_str));
        if let Some(name) = &self.name {
            container = container.with_display_name(name.as_str());
        }
        container = match self.kind {
            _ if self.shares.is_empty() => container,
            ContainerKind::Vertical => container.with_row_shares(self.shares.iter().copied()),
            _ => container.with_col_shares(self.shares.iter().copied()),
        };
        if let Some(columns) = self.columns {
            container = container.with_grid_columns(columns);
        }
        rec.log(path.as_str(), &container)?;
        Ok(path)
    }
}

impl View {
    fn log(&self, rec: &RecordingStream, place: &str) -> anyhow::Result<String> {
        // Two views of one name and origin differ in their places.
        let key = format!("view {} {} {} {place}", self.class, self.name, self.origin);
        let path = format!("view/{}", id(&key));
        let queries = match self.contents.as_slice() {
            [] => vec!["$origin/**"],
            contents => contents.iter().map(String::as_str).collect(),
        };
        rec.log(
            format!("{path}/ViewContents"),
            &blueprints::ViewContents::new(queries),
        )?;
        let view = blueprints::ViewBlueprint::new(self.class)
            .with_display_name(self.name.as_str())
            .with_space_origin(self.origin.as_str());
        rec.log(path.as_str(), &view)?;
        for (name, setting) in &self.properties {
            rec.log(format!("{path}/{name}"), setting.as_ref())?;
        }
        Ok(path)
    }
}

/// Sends a window to the viewer of `rec` and shows it. Only the time line `timeline` is named, as
/// the others of its panel are the user's.
///
/// # Errors
/// If the recording's other end refuses.
pub(crate) fn send(rec: &RecordingStream, root: &Part, timeline: &str) -> anyhow::Result<()> {
    // A recording that goes nowhere has no window.
    let Some(info) = rec.store_info() else {
        return Ok(());
    };
    let application = info.application_id().clone();
    let builder = RecordingStreamBuilder::new(application).blueprint();
    let (_, store, properties, batcher, hooks, _) = builder.into_args();
    let blueprint_id = store.store_id.clone();
    let sink = Collected::default();
    let messages = sink.messages.clone();
    let scratch = RecordingStream::new(store, properties, batcher, hooks, Box::new(sink))?;
    scratch.set_time_sequence("blueprint", 0);
    let root = root.log(&scratch, "root")?;
    let viewport = blueprints::ViewportBlueprint::new()
        .with_root_container(uuid_of(&root))
        .with_auto_layout(false)
        .with_auto_views(false);
    scratch.log("viewport", &viewport)?;
    for panel in ["blueprint_panel", "selection_panel"] {
        let collapsed = blueprints::PanelBlueprint::new().with_state(PanelState::Collapsed);
        scratch.log(panel, &collapsed)?;
    }
    let time = blueprints::TimePanelBlueprint::new()
        .with_timeline(timeline)
        .with_state(PanelState::Collapsed);
    scratch.log("time_panel", &time)?;
    scratch.flush_blocking()?;
    drop(scratch);
    let messages = std::mem::take(&mut *messages.lock());
    rec.send_blueprint(
        messages,
        BlueprintActivationCommand {
            blueprint_id,
            make_active: true,
            make_default: true,
        },
    );
    Ok(())
}

/// A name as rerun gives them (RFC 9562, version 8), which is the same for the same text.
fn id(text: &str) -> String {
    let number = |seed: u64| {
        let bytes = text.bytes();
        bytes.fold(mix(seed), |sum, byte| mix(sum ^ byte as u64))
    };
    let (a, b) = (number(1), number(2));
    let (first, second, third) = (a >> 32, (a >> 16) & 0xffff, a & 0xfff);
    let (fourth, fifth) = ((b >> 48) & 0x3fff | 0x8000, b & 0xffff_ffff_ffff);
    format!("{first:08x}-{second:04x}-8{third:03x}-{fourth:04x}-{fifth:012x}")
}

/// The sixteen bytes behind the last part of a path.
fn uuid_of(path: &str) -> rerun::datatypes::Uuid {
    let digits: Vec<u8> = path.rsplit('/').next().map_or_else(Vec::new, |name| {
        let digits = name.chars().filter_map(|c| c.to_digit(16));
        digits.map(|digit| digit as u8).collect()
    });
    let mut bytes = [0; 16];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = pair[0] << 4 | pair[1];
    }
    rerun::datatypes::Uuid { bytes }
}

/// Keeps what is logged until it is fetched.
#[derive(Default)]
struct Collected {
    messages: Arc<Mutex<Vec<LogMsg>>>,
}

impl LogSink for Collected {
    fn send(&self, message: LogMsg) {
        let mut messages = self.messages.lock();
        messages.push(message);
    }

    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn n_threads() -> usize {
        std::fs::read_dir("/proc/self/task").unwrap().count()
    }

    #[test]
    fn a_layout_leaves_no_thread_behind() {
        let (rec, _storage) = RecordingStreamBuilder::new("test").memory().unwrap();
        let lay = || {
            let views = vec![Part::view("2D", "a", "/a"), Part::view("3D", "b", "/b")];
            let root = Part::group(ContainerKind::Horizontal, views);
            send(&rec, &root, "tick").unwrap();
        };
        lay();
        let before = n_threads();
        (0..20).for_each(|_| lay());
        // Threads that have been told to end may take a moment, and tests beside this one have some.
        let deadline = std::time::Instant::now() + Duration::from_secs(20);
        while n_threads() > before + 12 {
            assert!(
                std::time::Instant::now() < deadline,
                "{} threads",
                n_threads()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    #[test]
    fn names_hang_on_what_is_named() {
        assert_eq!(id("a"), id("a"));
        assert_ne!(id("a"), id("b"));
        let bytes = uuid_of(&format!("container/{}", id("a"))).bytes;
        assert_eq!((bytes[6] >> 4, bytes[8] >> 6), (8, 2));
        let text: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(text, id("a").replace('-', ""));
    }
}
