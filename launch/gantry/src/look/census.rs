//! Who is on the bus: topics with their types, and the processes that write and read them.

use std::collections::BTreeMap;

use anyhow::Context as _;
use schema_bus::{Bus, Exchange, Port, ServicePorts, TopicKind};
use schema_frames::Modality;
use serde::Serialize;

/// What a topic carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Sensor frames.
    Frames,
    /// Results of a user's program.
    Results,
    /// Snapshots of the world.
    Snapshot,
    /// A document.
    Document,
    /// Vehicle controls.
    Controls,
    /// Lockstep acknowledgements.
    Acks,
    /// Requests and their answers.
    Requests,
    /// Samples of another program.
    Other,
}

/// A process at one end of a topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Member {
    /// Process id; `None` if it cannot be told.
    pub pid: Option<u32>,
    /// Name under which it joined the bus, else the kernel's name of its program.
    pub name: String,
}

/// A topic, or the service of commands, with both ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Name without the domain.
    pub name: String,
    /// What it carries.
    pub kind: Kind,
    /// Its type in a word: `rgb`, `boxes2d`, `document`.
    pub type_name: String,
    /// Processes that write, each once.
    pub writers: Vec<Member>,
    /// Processes that read, each once.
    pub readers: Vec<Member>,
    /// The service itself.
    pub service: ServicePorts,
}

/// All of a domain.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// The domain.
    pub domain: String,
    /// Topics and the service of commands, by name.
    pub topics: Vec<Topic>,
    /// Processes that have any of the domain's services open, by pid; this one is not among them.
    pub processes: Vec<Member>,
}

impl Kind {
    fn of(service: &ServicePorts) -> Kind {
        match service.kind() {
            TopicKind::Frames => Kind::Frames,
            TopicKind::Results => Kind::Results,
            TopicKind::Snapshot => Kind::Snapshot,
            TopicKind::Document => Kind::Document,
            TopicKind::Controls => Kind::Controls,
            TopicKind::Other if service.exchange == Exchange::Requests => Kind::Requests,
            TopicKind::Other if service.carries_acks() => Kind::Acks,
            TopicKind::Other => Kind::Other,
        }
    }

    /// Name in tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Frames => "frames",
            Kind::Results => "results",
            Kind::Snapshot => "snapshot",
            Kind::Document => "document",
            Kind::Controls => "controls",
            Kind::Acks => "acks",
            Kind::Requests => "requests",
            Kind::Other => "other",
        }
    }

    /// Whether it goes from the programs to the simulator.
    pub fn is_control(self) -> bool {
        matches!(self, Kind::Controls | Kind::Acks | Kind::Requests)
    }
}

impl Topic {
    fn of(service: ServicePorts) -> Topic {
        let kind = Kind::of(&service);
        let last = service.name.rsplit('/').next().unwrap_or_default();
        let type_name = match kind {
            Kind::Frames => Modality::from_name(last).map_or("frames", Modality::name),
            Kind::Results if !service.result.is_empty() => &service.result,
            Kind::Other if service.header.is_empty() || service.header == "()" => &service.payload,
            Kind::Other => &service.header,
            kind => kind.name(),
        };
        Topic {
            type_name: type_name.to_owned(),
            kind,
            writers: members(&service.writers),
            readers: members(&service.readers),
            name: service.name.clone(),
            service,
        }
    }

    /// Longest payload that any of its writers can send, bytes.
    pub fn max_payload_bytes(&self) -> usize {
        let sizes = self
            .service
            .writers
            .iter()
            .map(|port| port.max_payload_bytes);
        sizes.max().unwrap_or(0)
    }

    /// Places for readers that are free.
    pub fn free_places(&self) -> usize {
        self.service
            .max_readers
            .saturating_sub(self.service.readers.len())
    }
}

impl Census {
    /// Takes it now. Looking opens no port, starts no rendering and takes no reader's place.
    pub fn take(bus: &Bus) -> anyhow::Result<Census> {
        let services = bus.services().context("cannot list the bus")?;
        Ok(Self::of(bus.domain(), services))
    }

    fn of(domain: &str, services: Vec<ServicePorts>) -> Census {
        let mut processes = BTreeMap::new();
        for port in services
            .iter()
            .flat_map(|of| of.writers.iter().chain(&of.readers))
        {
            if port.pid.is_some_and(|pid| pid != std::process::id()) {
                let member = member(port);
                processes.insert(member.pid, member);
            }
        }
        let is_topic = |service: &ServicePorts| service.exchange != Exchange::WakeUps;
        Census {
            domain: domain.to_owned(),
            topics: services
                .into_iter()
                .filter(is_topic)
                .map(Topic::of)
                .collect(),
            processes: processes.into_values().collect(),
        }
    }

    /// The topic with this name, with or without the domain.
    pub fn topic(&self, name: &str) -> Option<&Topic> {
        let start = format!("{}/", self.domain);
        let short = name.strip_prefix(&start).unwrap_or(name);
        self.topics.iter().find(|topic| topic.name == short)
    }
}

/// The sentence for a domain on which nothing runs.
pub fn nothing_runs(domain: &str) -> String {
    format!(
        "nothing is published on domain {domain:?}; start something with `gantry up`, or name another with --domain"
    )
}

fn member(port: &Port) -> Member {
    let kernel = || {
        let comm = std::fs::read_to_string(format!("/proc/{}/comm", port.pid?)).ok()?;
        Some(comm.trim().replace(char::is_control, "?"))
    };
    let name = match port.program.as_str() {
        "" => kernel().unwrap_or_else(|| "?".to_owned()),
        program => program.to_owned(),
    };
    Member {
        pid: port.pid,
        name,
    }
}

/// Every process once, by pid.
fn members(ports: &[Port]) -> Vec<Member> {
    let mut members: Vec<Member> = ports.iter().map(member).collect();
    members.sort();
    members.dedup_by_key(|member| member.pid);
    members
}

/// Names with how many processes have them: `detector ×2, gantry-view`.
pub fn names(members: &[Member]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for member in members {
        *counts.entry(&member.name).or_default() += 1;
    }
    let one = |(name, n): (&str, usize)| match n {
        1 => name.to_owned(),
        n => format!("{name} ×{n}"),
    };
    counts.into_iter().map(one).collect::<Vec<_>>().join(", ")
}
