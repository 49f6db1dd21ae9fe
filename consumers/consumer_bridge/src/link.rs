//! The session of zenoh: where it listens and connects, and what it must not do unasked.

use anyhow::Context as _;
use zenoh::{Config, Session, Wait as _};

use crate::options::Options;

/// What is set unless a configuration file is given: nothing is found or offered by multicast, only
/// the named endpoints are used, and shared memory of zenoh's own stays off.
const DEFAULTS: [(&str, &str); 4] = [
    ("scouting/multicast/enabled", "false"),
    ("listen/endpoints", "[]"),
    // A bridge that is started first waits for the other for as long as it takes.
    ("connect/timeout_ms", "-1"),
    ("connect/exit_on_failure", "false"),
];
/// Longest pause between two attempts to connect, milliseconds.
const RETRY_MS: u32 = 1000;

/// Opens the session. It returns when the listeners are open; connecting goes on by itself.
///
/// # Errors
/// A sentence for a configuration file that cannot be read, and for an address that is taken.
pub fn open(options: &Options) -> anyhow::Result<Session> {
    let config = config(options)?;
    let session = zenoh::open(config).wait().map_err(|error| {
        anyhow::anyhow!(
            "cannot open the link ({}): {error}",
            match options.listen.is_empty() {
                true => "zenoh refuses its configuration".to_owned(),
                false => format!(
                    "is {} taken, for example by rmw_zenohd, or no address of this machine? --connect joins what listens there",
                    options.listen.join(", ")
                ),
            }
        )
    })?;
    Ok(session)
}

fn config(options: &Options) -> anyhow::Result<Config> {
    let mut config = match &options.zenoh_config {
        Some(path) => Config::from_file(path)
            .map_err(|error| anyhow::anyhow!("{error}"))
            .with_context(|| format!("{} is no configuration of zenoh", path.display()))?,
        None => {
            let mut config = Config::default();
            for (key, value) in DEFAULTS {
                set(&mut config, key, value)?;
            }
            // A router passes on what machines behind it say to each other; it also is the router
            // that nodes of ROS 2 look for.
            let mode = match options.listen.is_empty() {
                true => "peer",
                false => "router",
            };
            set(&mut config, "mode", &format!("\"{mode}\""))?;
            set(
                &mut config,
                "connect/retry",
                &format!(
                    "{{ period_init_ms: 200, period_max_ms: {RETRY_MS}, period_increase_factor: 2 }}"
                ),
            )?;
            config
        }
    };
    for (key, endpoints) in [
        ("listen/endpoints", &options.listen),
        ("connect/endpoints", &options.connect),
    ] {
        if !endpoints.is_empty() {
            let list = serde_json::to_string(endpoints).context("endpoints are text")?;
            set(&mut config, key, &list)?;
        }
    }
    Ok(config)
}

fn set(config: &mut Config, key: &str, value: &str) -> anyhow::Result<()> {
    config
        .insert_json5(key, value)
        .map_err(|error| anyhow::anyhow!("zenoh does not take {value} for {key}: {error}"))
}
