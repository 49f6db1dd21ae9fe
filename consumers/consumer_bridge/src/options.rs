//! What is bridged, with whom, and how.

use std::net::SocketAddr;
use std::path::PathBuf;

use schema_bus::{BusOptions, names};
use schema_recording::pattern::matches;

use crate::coding::Rules;

/// Port on which bridges and routers of zenoh listen.
pub const PORT: u16 = 7447;

/// What is bridged, with whom, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// First part of every topic's name on this machine.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
    /// First part of every key: bridges of one network meet.
    pub network: String,
    /// zenoh's endpoints to listen on.
    pub listen: Vec<String>,
    /// zenoh's endpoints to connect to.
    pub connect: Vec<String>,
    /// zenoh's own configuration, to which the endpoints are added.
    pub zenoh_config: Option<PathBuf>,
    /// Patterns of topics that cross; none for all.
    pub topics: Vec<String>,
    /// Which way topics cross.
    pub direction: Direction,
    /// Whether requests and controls cross.
    pub control: bool,
    /// Whether lockstep participants of other machines are waited for.
    pub lockstep: bool,
    /// How topics are compressed that this bridge sends.
    pub compress: Rules,
    /// What of ROS 2 is spoken; `None`: nothing.
    pub ros2: Option<Ros2Options>,
    /// Where Foxglove connects; `None`: nowhere.
    pub foxglove: Option<SocketAddr>,
    /// Sites and names of this machine that Foxglove may come from and connect to, beside its own.
    pub foxglove_allow: Vec<String>,
    /// Interval at which counts are logged, seconds; `None` for at the end only.
    pub report_secs: Option<u64>,
}

/// What of ROS 2 is spoken.
#[derive(Clone, Copy, Debug)]
pub struct Ros2Options {
    /// `ROS_DOMAIN_ID`.
    pub domain_id: u32,
    /// Whether simulated time is published on `/clock`.
    pub clock: bool,
}

/// Which way topics cross.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// Both ways.
    #[default]
    Both,
    /// From this machine to others.
    Out,
    /// From others to this machine.
    In,
}

impl Direction {
    /// Whether topics of this machine go to others.
    pub fn exports(self) -> bool {
        self != Direction::In
    }

    /// Whether topics of others come to this machine.
    pub fn imports(self) -> bool {
        self != Direction::Out
    }
}

impl Options {
    /// Everything both ways, with the defaults of the program.
    pub fn new(domain: &str) -> Options {
        Options {
            domain: domain.to_string(),
            bus: BusOptions::default(),
            network: "gantry".to_string(),
            listen: Vec::new(),
            connect: Vec::new(),
            zenoh_config: None,
            topics: Vec::new(),
            direction: Direction::Both,
            control: true,
            lockstep: false,
            compress: Rules::default(),
            ros2: None,
            foxglove: None,
            foxglove_allow: Vec::new(),
            report_secs: None,
        }
    }

    /// Whether a topic may cross; the world always may.
    pub fn has(&self, topic: &str) -> bool {
        self.topics.is_empty()
            || names::rig_of(topic) == "world"
            || self.topics.iter().any(|pattern| matches(pattern, topic))
    }
}

/// An endpoint as zenoh writes it: `HOST:PORT`, `HOST` and `tcp/HOST` are accepted too.
///
/// # Errors
/// A sentence for what can be no endpoint.
pub fn endpoint(text: &str) -> Result<String, String> {
    let wrong = |what: &str| {
        Err(format!(
            "{text:?} is no endpoint: {what}; write tcp/HOST:PORT, for example tcp/192.168.1.7:{PORT}"
        ))
    };
    let (protocol, address) = text.split_once('/').unwrap_or(("tcp", text));
    if !["tcp", "tls"].contains(&protocol) {
        return wrong(&format!(
            "this build of zenoh speaks tcp and tls, not {protocol:?}"
        ));
    }
    let (address, settings) = match address.find(['#', '?']) {
        Some(at) => address.split_at(at),
        None => (address, ""),
    };
    if address.is_empty() || address.contains(char::is_whitespace) {
        return wrong("it names no host");
    }
    let is_bare_v6 = address.matches(':').count() > 1 && !address.starts_with('[');
    if is_bare_v6 {
        return wrong("an IPv6 address stands in brackets");
    }
    let port = match address.rsplit_once(':') {
        Some((_, port)) if !port.ends_with(']') => Some(port),
        _ => None,
    };
    match port {
        None => Ok(format!("{protocol}/{address}:{PORT}{settings}")),
        Some(port) if port.parse::<u16>().is_ok() => Ok(format!("{protocol}/{address}{settings}")),
        Some(port) => wrong(&format!("{port:?} is no port of 0 to 65535")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endpoints_may_leave_out_what_is_usual() {
        for (text, full) in [
            ("tcp/10.0.0.2:7448", "tcp/10.0.0.2:7448"),
            ("10.0.0.2", "tcp/10.0.0.2:7447"),
            ("host:1", "tcp/host:1"),
            ("tls/host", "tls/host:7447"),
            ("[::1]", "tcp/[::1]:7447"),
            ("tcp/[::1]:9#so_sndbuf=65000", "tcp/[::1]:9#so_sndbuf=65000"),
        ] {
            assert_eq!(endpoint(text).as_deref(), Ok(full));
        }
        for text in ["", "udp/a:1", "a:70000", "tcp/a:b", "::1", "tcp/"] {
            let error = endpoint(text).unwrap_err();
            assert!(error.contains("tcp/HOST:PORT"), "{text}: {error}");
        }
    }
}
