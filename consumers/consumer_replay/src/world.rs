//! The documents of the world: as they were recorded, but for `world/info`, which says that this is a
//! replay.

use anyhow::Context as _;
use schema_bus::{Bus, DocumentPublisher, Gate, names};
use schema_frames::document::Weather;
use schema_frames::{StepMode, WorldInfo};
use schema_recording::read::RecordedDocument;

/// Documents that are sent as they were recorded, and what they hold if the file has none; a map
/// cannot be made up.
const OTHERS: [(&str, Option<&str>); 4] = [
    (names::WORLD_MAP, None),
    (names::WORLD_ACTORS, Some("{\"actors\":[]}")),
    (names::WORLD_CATALOGUE, Some("{\"entries\":[]}")),
    (names::WORLD_SPAWN_POINTS, Some("{\"points\":[]}")),
];

/// Writers of the documents.
#[derive(Debug)]
pub struct Documents {
    info: DocumentPublisher,
    /// Those of [`OTHERS`], in their order; none in a sealed world.
    others: Vec<DocumentPublisher>,
    is_sealed: bool,
    /// `world/info` as it was recorded.
    recorded: WorldInfo,
    sent: Option<WorldInfo>,
}

/// What `world/info` says about the replay itself.
#[derive(Debug)]
pub struct State<'a> {
    pub epoch: u64,
    pub tick: u64,
    pub gate: &'a Gate,
    pub mode: StepMode,
}

impl Documents {
    /// Opens the services; `world/info` last, because its publisher says "a world is here".
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn open(bus: &Bus, is_sealed: bool) -> anyhow::Result<Documents> {
        let open = |name: &str| {
            bus.document_publisher(name)
                .with_context(|| format!("cannot publish {name:?}"))
        };
        let others = OTHERS.iter().filter(|_| !is_sealed);
        let others = others.map(|(name, _)| open(name));
        Ok(Documents {
            others: others.collect::<anyhow::Result<_>>()?,
            info: open(names::WORLD_INFO)?,
            is_sealed,
            recorded: no_info(),
            sent: None,
        })
    }

    /// Sends the latest documents to readers that joined since the last call.
    pub fn greet(&self) {
        self.info.greet();
        self.others.iter().for_each(DocumentPublisher::greet);
    }

    /// Sends the documents that hold when an epoch begins, all of them.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn begin(&mut self, found: &[RecordedDocument], state: &State<'_>) -> anyhow::Result<()> {
        self.sent = None;
        for ((name, otherwise), other) in OTHERS.iter().zip(&mut self.others) {
            match found.iter().find(|document| *document.topic == **name) {
                Some(document) => send(other, document, state)?,
                None => {
                    if let Some(text) = otherwise {
                        other.send_revision(text, state.epoch, state.tick, 1)?;
                    }
                }
            }
        }
        if let Some(info) = found.iter().find(|of| *of.topic == *names::WORLD_INFO) {
            self.take_info(&info.text);
        }
        self.publish_info(state)
    }

    /// Sends a document that was recorded; other topics are passed over.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn send(&mut self, document: &RecordedDocument, state: &State<'_>) -> anyhow::Result<()> {
        if *document.topic == *names::WORLD_INFO {
            self.take_info(&document.text);
            return self.publish_info(state);
        }
        let mut known = OTHERS.iter().zip(&mut self.others);
        match known.find(|((name, _), _)| *document.topic == **name) {
            Some((_, other)) => send(other, document, state),
            None => Ok(()),
        }
    }

    fn take_info(&mut self, text: &str) {
        match serde_json::from_str(text) {
            Ok(info) => self.recorded = info,
            Err(error) => tracing::warn!(%error, "the recorded world/info cannot be read"),
        }
    }

    /// Sends `world/info` if it changed.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn publish_info(&mut self, state: &State<'_>) -> anyhow::Result<()> {
        let info = WorldInfo {
            source: "replay".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            epoch: state.epoch.to_string(),
            mode: state.mode,
            lockstep: state
                .gate
                .participants()
                .iter()
                .map(|participant| participant.name.clone())
                .collect(),
            // They are not recorded.
            batches: Vec::new(),
            ..self.recorded.clone()
        };
        let info = match self.is_sealed {
            true => info.sealed(),
            false => info,
        };
        if self.sent.as_ref() != Some(&info) {
            self.info.send_json(&info, state.epoch, state.tick)?;
            self.sent = Some(info);
        }
        Ok(())
    }

    /// Name of the map.
    pub fn map(&self) -> &str {
        &self.recorded.map
    }

    /// Sets the name of the map of a file that has no `world/info`.
    pub fn set_map(&mut self, name: &str) {
        self.recorded.map = name.to_string();
    }
}

/// Sends a document as it was recorded.
fn send(
    publisher: &mut DocumentPublisher,
    document: &RecordedDocument,
    state: &State<'_>,
) -> anyhow::Result<()> {
    let header = &document.header;
    publisher.send_revision(&document.text, state.epoch, header.tick, header.revision)?;
    Ok(())
}

/// What is said about the world of a file that says nothing.
fn no_info() -> WorldInfo {
    WorldInfo {
        source: String::new(),
        version: String::new(),
        epoch: String::new(),
        episode: 1,
        map: String::new(),
        seed: 0,
        mode: StepMode::FreeRunning,
        period_nanos: 50_000_000,
        episode_start_nanos: 0,
        lockstep: Vec::new(),
        weather: Weather::default(),
        adapter: String::new(),
        cpu_copies: 1,
        batches: Vec::new(),
        cameras: Vec::new(),
    }
}
