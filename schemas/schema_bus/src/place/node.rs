//! A process's node: its place on the bus, and the names it gives to services.

use std::path::{Path, PathBuf};
use std::sync::Once;

use iceoryx2::config::Config;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;

use crate::contract::error::BusError;
use crate::contract::names::{valid_domain, valid_topic};
use crate::memory::leftovers::{Cleaned, Guard, Leftovers};
use crate::memory::root::{Machine, SHM};
use crate::memory::shortage;
use crate::place::gpu_socket;
use crate::place::iceoryx_error::with_shortage;

/// Shared memory that iceoryx2's node takes, bytes; an upper bound.
const NODE_BYTES: u64 = 1 << 16;

/// Ports of this kind may move between threads; the price is an uncontended lock per call.
pub type Service = ipc_threadsafe::Service;

/// Where iceoryx2 keeps its files, for tests that must not meet other processes. By default this is
/// what iceoryx2 itself would use: `config/iceoryx2.toml` in the working directory, then the
/// user's, then the machine's configuration, then `/tmp/iceoryx2` and the prefix `iox2_`. If that
/// folder, or what lies in `/dev/shm` with it, is another user's, it is `iceoryx2` in
/// `XDG_RUNTIME_DIR` if that is this user's alone, else `/tmp/iceoryx2-UID`, and `iox2_UID_` instead;
/// of names that others have taken, the next one (`-1`, `-2` and so on).
#[derive(Clone, Debug, Default)]
pub struct BusOptions {
    /// Folder of iceoryx2's bookkeeping.
    pub iceoryx_root: Option<PathBuf>,
    /// Start of the names of its files in `/dev/shm`.
    pub prefix: Option<String>,
}

/// iceoryx2's node of this process, and the domain in which it opens services.
#[derive(Debug)]
pub(crate) struct BusNode {
    // It ends before the node does.
    _guard: Guard,
    node: Node<Service>,
    domain: String,
    leftovers: Leftovers,
}

impl BusNode {
    pub fn open(domain: &str, program: &str, options: &BusOptions) -> Result<BusNode, BusError> {
        static QUIET: Once = Once::new();
        // iceoryx2's warnings ("no config file was loaded", "dead node detected") would appear in
        // the output of every consumer.
        QUIET.call_once(|| set_log_level(LogLevel::Fatal));
        shortage::install();
        if !valid_domain(domain) {
            return Err(BusError::Domain {
                domain: domain.into(),
            });
        }
        let config = options.config(program)?;
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
        // Already making a node cleans up after others.
        let guard = Guard::start(&config)
            .map_err(|error| failed(format!("the system gives no thread ({error})")))?;
        let node = shortage::guarded("the bus", NODE_BYTES, || {
            NodeBuilder::new()
                .name(&name)
                .config(&config)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<Service>()
                .map_err(|e| failed(with_shortage(format!("{e:?}"))))
        })?;
        let node = BusNode {
            _guard: guard,
            node,
            domain: domain.into(),
            leftovers: Leftovers::default(),
        };
        // iceoryx2 has removed dead nodes where it could.
        node.sweep();
        Ok(node)
    }

    pub fn domain(&self) -> &str {
        &self.domain
    }

    /// Name of this program.
    pub fn program(&self) -> &str {
        self.node.name().as_str()
    }

    pub fn clean_dead_nodes(&self) -> u64 {
        let cleaned = self.node.try_cleanup_dead_nodes();
        let cleaned_up = Cleaned {
            has_dead: cleaned.failed_cleanups > 0,
            has_removed: cleaned.cleanups > 0,
        };
        self.leftovers.sweep(self.config(), cleaned_up);
        if cleaned.cleanups > 0 {
            gpu_socket::sweep(&self.root());
        }
        cleaned.cleanups
    }

    /// Removes what iceoryx2's cleaning of dead nodes leaves, which keeps services from being made.
    pub fn sweep(&self) {
        let unknown = Cleaned {
            has_dead: true,
            has_removed: true,
        };
        self.leftovers.sweep(self.config(), unknown);
    }

    pub fn exists(&self, topic: &str) -> bool {
        let Ok((_, name)) = self.service_name(topic) else {
            return false;
        };
        // If iceoryx2 cannot tell, opening the topic will, with a sentence that says why.
        Service::does_exist(&name, self.config(), MessagingPattern::PublishSubscribe)
            .unwrap_or(true)
    }

    /// Whether one of these nodes is that of a living process.
    pub fn is_any_alive(&self, nodes: &[u128]) -> bool {
        let mut is_alive = false;
        // A directory of nodes that cannot be read means that there is none.
        let _ = Node::<Service>::list(self.config(), |state| {
            is_alive |=
                matches!(&state, NodeState::Alive(view) if nodes.contains(&view.id().value()));
            CallbackProgression::Continue
        });
        is_alive
    }

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

    pub fn config(&self) -> &Config {
        self.node.config()
    }

    /// Folder of iceoryx2's bookkeeping.
    pub fn root(&self) -> PathBuf {
        PathBuf::from(self.config().global.root_path().to_string())
    }

    pub fn iceoryx(&self) -> &Node<Service> {
        &self.node
    }

    /// The full name of `topic`: the domain, a slash and the topic.
    pub fn service_name(&self, topic: &str) -> Result<(String, ServiceName), BusError> {
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
}

impl BusOptions {
    fn config(&self, program: &str) -> Result<Config, BusError> {
        let mut config = Config::global_config().clone();
        let root = config.global.root_path();
        let is_given =
            self.iceoryx_root.is_some() || *root != *Config::default().global.root_path();
        if !is_given {
            let machine = Machine {
                root: root.to_string().into(),
                prefix: config.global.prefix.to_string(),
                shm: SHM.into(),
                runtime: std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from),
            };
            let own = machine.own_place(nix::unistd::geteuid().as_raw());
            let own = own.map_err(|error| BusError::Node {
                program: program.into(),
                cause: error.to_string(),
            })?;
            if let Some(own) = own {
                return BusOptions {
                    iceoryx_root: Some(own.root),
                    prefix: Some(self.prefix.clone().unwrap_or(own.prefix)),
                }
                .config(program);
            }
        }
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
