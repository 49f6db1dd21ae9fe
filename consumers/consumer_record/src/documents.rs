//! The world's documents in a recording: each change is a message, and the map an attachment too.

use consumer_kit::{Domain, TopicId};
use schema_bus::{Document, mono_now, names};
use schema_frames::{ActorList, WorldInfo};

use crate::queue::Job;
use crate::sink::Sink;
use consumer_forms::foxglove::snapshots::{SnapshotConverter, document};

/// The documents that are recorded.
const DOCUMENTS: [&str; 5] = [
    names::WORLD_INFO,
    names::WORLD_ACTORS,
    names::WORLD_CATALOGUE,
    names::WORLD_MAP,
    names::WORLD_SPAWN_POINTS,
];

/// The run of the simulator that a file is about, and where its clock stands.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Run {
    /// Its epoch; 0 while none was met.
    pub(crate) epoch: u64,
    /// Time of the newest snapshot, nanoseconds.
    pub(crate) sim_nanos: u64,
}

impl Run {
    fn has(&self, found: &Document) -> bool {
        self.epoch == 0 || found.header.epoch == self.epoch
    }
}

/// The world's documents, followed for the whole recording.
pub(crate) struct Documents {
    followed: [(&'static str, TopicId); DOCUMENTS.len()],
    /// Epoch and revision of the map that is attached.
    attached: Option<(u64, u64)>,
}

impl Documents {
    pub(crate) fn follow(domain: &mut Domain) -> Documents {
        Documents {
            followed: DOCUMENTS.map(|name| (name, domain.follow_document(name))),
            attached: None,
        }
    }

    /// Prepares for a new file, which must hold the map again.
    pub(crate) fn begin_file(&mut self) {
        self.attached = None;
    }

    /// Records documents that have changed, or all of them.
    pub(crate) fn drain(
        &mut self,
        all: bool,
        domain: &mut Domain,
        run: Run,
        converter: &mut SnapshotConverter,
        sink: &mut Sink,
    ) -> anyhow::Result<()> {
        for (name, id) in self.followed {
            let changed = domain.take_document(id)?.is_some();
            let newest = domain.document(id).filter(|found| run.has(found));
            if let Some(found) = newest.filter(|_| changed || all) {
                record_document(name, found, run, converter, sink)?;
            }
        }
        self.attach_map(false, domain, run, sink)
    }

    /// Attaches the map once per revision. Its name is in `world/info`, which may arrive after the
    /// map; at the end it is called `map` if no name has arrived.
    pub(crate) fn attach_map(
        &mut self,
        at_the_end: bool,
        domain: &Domain,
        run: Run,
        sink: &mut Sink,
    ) -> anyhow::Result<()> {
        let Some(map) = self.newest(names::WORLD_MAP, domain, run) else {
            return Ok(());
        };
        let revision = (map.header.epoch, map.header.revision);
        if self.attached == Some(revision) {
            return Ok(());
        }
        let info = self
            .newest(names::WORLD_INFO, domain, run)
            .map(|info| info.json::<WorldInfo>())
            .transpose()?;
        let name = match &info {
            Some(info) => {
                let last = info.map.rsplit('/').next().unwrap_or("map");
                last.trim_end_matches(".xodr").to_string()
            }
            None if at_the_end => "map".to_string(),
            None => return Ok(()),
        };
        sink.push(Job::Attach {
            name: format!("{name}.xodr"),
            media_type: "application/xml",
            data: map.text.clone().into_bytes(),
            log_nanos: run.sim_nanos,
        })?;
        self.attached = Some(revision);
        Ok(())
    }

    fn newest<'a>(&self, wanted: &str, domain: &'a Domain, run: Run) -> Option<&'a Document> {
        let (_, id) = self.followed.iter().find(|(name, _)| *name == wanted)?;
        domain.document(*id).filter(|found| run.has(found))
    }
}

fn record_document(
    name: &'static str,
    found: &Document,
    run: Run,
    converter: &mut SnapshotConverter,
    sink: &mut Sink,
) -> anyhow::Result<()> {
    match name {
        names::WORLD_INFO => sink.push(world_metadata(&found.text))?,
        names::WORLD_ACTORS => converter.set_actors(&found.json::<ActorList>()?),
        _ => {}
    }
    let entries = vec![document(name, &found.header, &found.text)];
    let revision = found.header.revision;
    sink.put(&name.into(), revision, run.sim_nanos, mono_now().0, entries)
}

/// The members of `world/info`, each as text.
fn world_metadata(json: &str) -> Job {
    let members: serde_json::Map<String, serde_json::Value> =
        serde_json::from_str(json).unwrap_or_default();
    let text = |value: serde_json::Value| match value {
        serde_json::Value::String(text) => text,
        other => other.to_string(),
    };
    Job::Metadata {
        name: names::WORLD_INFO.to_string(),
        pairs: members
            .into_iter()
            .map(|(key, value)| (key, text(value)))
            .collect(),
    }
}
