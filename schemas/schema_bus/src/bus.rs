//! One node per process: opens services by name, checks the schema before it joins one, and cleans
//! up after the dead.

use std::path::{Path, PathBuf};
use std::sync::Once;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use schema_frames::{SCHEMA_ATTRIBUTE, SCHEMA_VERSION};
use schema_types::MonoTime;

use crate::iceoryx_error::{Meaning, ServiceFailure as _, service_error};
use crate::names::{valid_domain, valid_topic};
use crate::qos::{EVENT_LISTENERS, EVENT_NOTIFIERS, MAX_NODES, Qos};
use crate::wire::{OnBus, Wire};
use crate::{BusError, names};

/// How long opening is tried again while other processes make or remove the service.
const SETTLE: Duration = Duration::from_secs(1);

/// Ports of this kind may move between threads; the price is an uncontended lock per call.
pub(crate) type Service = ipc_threadsafe::Service;
/// An open service of byte slices with header `H`.
pub(crate) type Slices<H> = publish_subscribe::PortFactory<Service, [u8], Wire<H>>;
/// An open event service.
pub(crate) type Events = event::PortFactory<Service>;

/// Where iceoryx2 keeps its files, for tests that must not meet other processes. By default this is
/// what iceoryx2 itself would use: `config/iceoryx2.toml` in the working directory, then the
/// user's, then the machine's configuration, then `/tmp/iceoryx2` and the prefix `iox2_`.
#[derive(Clone, Debug, Default)]
pub struct BusOptions {
    /// Folder of iceoryx2's bookkeeping.
    pub iceoryx_root: Option<PathBuf>,
    /// Start of the names of its files in `/dev/shm`.
    pub prefix: Option<String>,
}

/// A process's place on the bus.
#[derive(Debug)]
pub struct Bus {
    node: Node<Service>,
    domain: String,
}

impl Bus {
    /// Joins `domain` as `program`, a name for lists and messages.
    ///
    /// # Errors
    /// [`BusError::Domain`] for a name that cannot be part of a service name, [`BusError::Node`] if
    /// shared memory is not usable.
    pub fn open(domain: &str, program: &str) -> Result<Bus, BusError> {
        Self::open_with(domain, program, &BusOptions::default())
    }

    /// Like [`Bus::open`], with iceoryx2's files in a place of their own.
    ///
    /// # Errors
    /// As [`Bus::open`], and [`BusError::Option`] for an unusable root or prefix.
    pub fn open_with(domain: &str, program: &str, options: &BusOptions) -> Result<Bus, BusError> {
        static QUIET: Once = Once::new();
        // iceoryx2's warnings ("no config file was loaded", "dead node detected") would appear in
        // the output of every consumer.
        QUIET.call_once(|| set_log_level(LogLevel::Fatal));
        if !valid_domain(domain) {
            return Err(BusError::Domain {
                domain: domain.into(),
            });
        }
        let config = options.config()?;
        let name: String = program
            .chars()
            .filter(|c| c.is_ascii_graphic())
            .take(64)
            .collect();
        let failed = |cause: String| BusError::Node {
            program: program.into(),
            cause,
        };
        let name = NodeName::new(&name).map_err(|e| failed(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Service>()
            .map_err(|e| failed(format!("{e:?}")))?;
        Ok(Bus {
            node,
            domain: domain.into(),
        })
    }

    /// The domain.
    pub fn domain(&self) -> &str {
        &self.domain
    }

    /// Removes what killed processes left behind. Returns the number of these processes.
    pub fn clean_dead_nodes(&self) -> u64 {
        self.node.try_cleanup_dead_nodes().cleanups
    }

    /// Whether a living process publishes `topic`, a document such as [`names::WORLD_INFO`].
    /// Removes what killed processes left behind first.
    ///
    /// # Errors
    /// [`BusError`] if the service exists and cannot be opened.
    pub fn publisher_alive(&self, topic: &str) -> Result<bool, BusError> {
        self.clean_dead_nodes();
        match self.join::<schema_frames::DocumentHeader>(topic) {
            Ok(service) => Ok(service.dynamic_config().number_of_publishers() > 0),
            Err(BusError::NoSuchTopic { .. }) => Ok(false),
            Err(other) => Err(other),
        }
    }

    /// Whether the publish-subscribe topic exists. Much cheaper than a failed opening, whose error
    /// lists the topics that exist.
    pub fn exists(&self, topic: &str) -> bool {
        let Ok((_, name)) = self.service_name(topic) else {
            return false;
        };
        // If iceoryx2 cannot tell, opening the topic will, with a sentence that says why.
        Service::does_exist(&name, self.config(), MessagingPattern::PublishSubscribe)
            .unwrap_or(true)
    }

    /// Names of the programs that are running, on every domain that shares iceoryx2's files with
    /// this one.
    pub fn programs(&self) -> Vec<String> {
        let mut programs = Vec::new();
        // A directory of nodes that cannot be read means that there is none to list.
        let _ = Node::<Service>::list(self.config(), |state| {
            if let NodeState::Alive(view) = state
                && let Some(details) = view.details()
            {
                programs.push(details.name().as_str().to_string());
            }
            CallbackProgression::Continue
        });
        programs.sort();
        programs
    }

    pub(crate) fn config(&self) -> &Config {
        self.node.config()
    }

    pub(crate) fn node(&self) -> &Node<Service> {
        &self.node
    }

    /// The full name of `topic`: the domain, a slash and the topic.
    pub(crate) fn service_name(&self, topic: &str) -> Result<(String, ServiceName), BusError> {
        let bad = || BusError::Name {
            topic: topic.into(),
        };
        if !valid_topic(topic) {
            return Err(bad());
        }
        let full = format!("{}/{topic}", self.domain);
        let name = ServiceName::new(&full).map_err(|_| bad())?;
        Ok((full, name))
    }

    /// Makes the service, or joins the one that its readers kept alive.
    pub(crate) fn make<H: OnBus>(&self, topic: &str, qos: &Qos) -> Result<Slices<H>, BusError> {
        let (full, name) = self.service_name(topic)?;
        let advice = "stop all processes of this domain and start again";
        settle(|| {
            self.check_schema(&full, &name, MessagingPattern::PublishSubscribe, advice)?;
            self.node
                .service_builder(&name)
                .publish_subscribe::<[u8]>()
                .user_header::<Wire<H>>()
                .max_publishers(qos.publishers)
                .max_subscribers(qos.readers)
                .max_nodes(MAX_NODES)
                .subscriber_max_buffer_size(qos.buffer)
                .subscriber_max_borrowed_samples(qos.borrowed)
                .history_size(qos.history)
                .enable_safe_overflow(true)
                .open_or_create_with_attributes(&schema_attribute())
                .map_err(|e| service_error("open", &full, &e))
        })
    }

    /// Joins a service that exists.
    pub(crate) fn join<H: OnBus>(&self, topic: &str) -> Result<Slices<H>, BusError> {
        let (full, name) = self.service_name(topic)?;
        let advice = "rebuild the consumer";
        if !self.check_schema(&full, &name, MessagingPattern::PublishSubscribe, advice)? {
            return Err(BusError::NoSuchTopic {
                topic: full,
                hint: self.hint(topic),
            });
        }
        self.node
            .service_builder(&name)
            .publish_subscribe::<[u8]>()
            .user_header::<Wire<H>>()
            .open()
            .map_err(|e| {
                if e.meaning() == Meaning::Missing {
                    return BusError::NoSuchTopic {
                        topic: full.clone(),
                        hint: self.hint(topic),
                    };
                }
                service_error("open", &full, &e)
            })
    }

    /// Fails if the service carries another schema. Returns whether the service exists.
    pub(crate) fn check_schema(
        &self,
        full: &str,
        name: &ServiceName,
        pattern: MessagingPattern,
        advice: &'static str,
    ) -> Result<bool, BusError> {
        let details = match Service::details(name, self.config(), pattern) {
            Ok(details) => details,
            Err(e) => return Err(service_error("look at", full, &e)),
        };
        let Some(details) = details else {
            return Ok(false);
        };
        let key = attribute_key();
        let theirs = details
            .static_details
            .attributes()
            .key_value(&key, 0)
            .map(|value| value.to_string());
        match theirs {
            Some(version) if version == SCHEMA_VERSION.to_string() => Ok(true),
            theirs => Err(BusError::SchemaSkew {
                service: full.into(),
                theirs: theirs.unwrap_or_else(|| "none".into()),
                advice,
            }),
        }
    }

    /// The rest of the sentence "there is no topic …": which topics there are instead.
    fn hint(&self, wanted: &str) -> String {
        let topics = self.topics().unwrap_or_default();
        let names: Vec<&str> = topics.iter().map(|topic| topic.name.as_str()).collect();
        if names.is_empty() {
            return format!(
                ": nothing runs on domain {:?}; start the simulator with `gantry up`, or name its --domain",
                self.domain
            );
        }
        let last = wanted.rsplit('/').next().unwrap_or(wanted);
        let mut near: Vec<&str> = names
            .iter()
            .copied()
            .filter(|name| name.ends_with(last))
            .collect();
        if near.is_empty() {
            near = names;
        }
        near.truncate(12);
        format!("; there is {}", near.join(", "))
    }

    pub(crate) fn make_event(&self, topic: &str) -> Result<(String, Events), BusError> {
        let (full, name) = self.service_name(topic)?;
        let service = settle(|| {
            self.node
                .service_builder(&name)
                .event()
                .max_listeners(EVENT_LISTENERS)
                .max_notifiers(EVENT_NOTIFIERS)
                .max_nodes(MAX_NODES)
                .open_or_create()
                .map_err(|e| service_error("open the event", &full, &e))
        })?;
        Ok((full, service))
    }

    /// Whether the domain has a daemon: `world/info` has a living publisher. A second daemon
    /// refuses to start by this.
    ///
    /// # Errors
    /// As [`Bus::publisher_alive`].
    pub fn daemon_alive(&self) -> Result<bool, BusError> {
        self.publisher_alive(names::WORLD_INFO)
    }
}

/// Tries again while another process makes or removes the service, which happens when a daemon
/// restarts while its readers come and go.
pub(crate) fn settle<T>(mut open: impl FnMut() -> Result<T, BusError>) -> Result<T, BusError> {
    let deadline = Instant::now() + SETTLE;
    loop {
        match open() {
            Err(BusError::Service { .. }) if Instant::now() < deadline => {
                std::thread::sleep(Duration::from_millis(10))
            }
            done => return done,
        }
    }
}

fn attribute_key() -> iceoryx2::service::attribute::AttributeKey {
    SCHEMA_ATTRIBUTE
        .try_into()
        .expect("the attribute's name is shorter than iceoryx2's limit of 64")
}

pub(crate) fn schema_attribute() -> AttributeVerifier {
    let value = SCHEMA_VERSION.to_string();
    let value = value
        .as_str()
        .try_into()
        .expect("a number of at most five digits fits an attribute");
    AttributeVerifier::new()
        .require(&attribute_key(), &value)
        .expect("one attribute fits the set")
}

impl BusOptions {
    fn config(&self) -> Result<Config, BusError> {
        let mut config = Config::global_config().clone();
        if let Some(root) = &self.iceoryx_root {
            let text = root.to_string_lossy();
            let bad = |_| BusError::Option {
                what: "root",
                value: text.to_string(),
            };
            config
                .global
                .set_root_path(&iceoryx2::prelude::Path::new(text.as_bytes()).map_err(bad)?);
        }
        if let Some(prefix) = &self.prefix {
            let bad = |_| BusError::Option {
                what: "prefix",
                value: prefix.clone(),
            };
            config.global.prefix = FileName::new(prefix.as_bytes()).map_err(bad)?;
        }
        Ok(config)
    }
}

/// Writes `config/iceoryx2.toml` below `working_directory`. Every process that is started there, in
/// any language, then uses this root and prefix.
///
/// # Errors
/// [`BusError::File`].
pub fn write_private_config(
    working_directory: &Path,
    iceoryx_root: &Path,
    prefix: &str,
) -> Result<PathBuf, BusError> {
    let folder = working_directory.join("config");
    let path = folder.join("iceoryx2.toml");
    let text = format!(
        "[global]\nroot-path = {:?}\nprefix = {prefix:?}\n",
        iceoryx_root.to_string_lossy()
    );
    let write = || {
        std::fs::create_dir_all(&folder)?;
        std::fs::write(&path, text)
    };
    match write() {
        Ok(()) => Ok(path),
        Err(source) => Err(BusError::File { path, source }),
    }
}

/// `CLOCK_MONOTONIC` now, the clock of a frame's stamps.
pub fn mono_now() -> MonoTime {
    let now = nix::time::clock_gettime(nix::time::ClockId::CLOCK_MONOTONIC)
        .expect("Linux has a monotonic clock");
    MonoTime(now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}
