//! Services: made or joined by name, after a look at the schema they carry.

use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use schema_frames::{SCHEMA_ATTRIBUTE, SCHEMA_VERSION};

use crate::contract::error::BusError;
use crate::contract::qos::{EVENT_LISTENERS, EVENT_NOTIFIERS, MAX_NODES, Qos};
use crate::contract::wire::{OnBus, Wire};
use crate::memory::shortage;
use crate::place::declared::{attribute_key, declared};
use crate::place::iceoryx_error::{
    Meaning, ServiceFailure as _, is_being_removed, is_in_the_making, service_error,
};
use crate::place::node::{BusNode, Service};
use crate::place::topics::topics;

/// How long opening is tried again while other processes make or remove the service.
const SETTLE: Duration = Duration::from_secs(1);
/// The same while a process that lives is making it, which may be a starved or a stopped one, or while
/// it is being removed, which a killed process may have begun.
const SETTLE_MAKING: Duration = Duration::from_secs(10);

/// An open service of byte slices with header `H`.
pub(crate) type Slices<H> = publish_subscribe::PortFactory<Service, [u8], Wire<H>>;
/// An open event service.
pub(crate) type Events = event::PortFactory<Service>;

/// Makes the service, or joins the one that its readers kept alive.
pub(crate) fn make<H: OnBus>(
    node: &BusNode,
    topic: &str,
    qos: &Qos,
) -> Result<Slices<H>, BusError> {
    let (full, name) = node.service_name(topic)?;
    let advice = "stop all processes of this domain and start again";
    settle(node, || {
        check_schema(
            node,
            &full,
            &name,
            MessagingPattern::PublishSubscribe,
            advice,
        )?;
        node.iceoryx()
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
pub(crate) fn join<H: OnBus>(node: &BusNode, topic: &str) -> Result<Slices<H>, BusError> {
    let (full, name) = node.service_name(topic)?;
    let Some(declared) = declared(node, &full, &name)? else {
        return Err(BusError::NoSuchTopic {
            topic: full,
            hint: hint(node, topic),
        });
    };
    declared.expect_schema(&full, "rebuild the consumer")?;
    declared.expect_header(&full, H::NAME)?;
    node.iceoryx()
        .service_builder(&name)
        .publish_subscribe::<[u8]>()
        .user_header::<Wire<H>>()
        .open()
        .map_err(|e| {
            if e.meaning() == Meaning::Missing {
                return BusError::NoSuchTopic {
                    topic: full.clone(),
                    hint: hint(node, topic),
                };
            }
            service_error("open", &full, &e)
        })
}

/// The capacity that a service has, whoever made it.
pub(crate) fn capacity<H: OnBus>(service: &Slices<H>) -> Qos {
    let config = service.static_config();
    Qos {
        readers: config.max_subscribers(),
        publishers: config.max_publishers(),
        buffer: config.subscriber_max_buffer_size(),
        borrowed: config.subscriber_max_borrowed_samples(),
        history: config.history_size(),
    }
}

/// Whether the service exists and has a publisher.
pub(crate) fn is_published<H: OnBus>(node: &BusNode, topic: &str) -> Result<bool, BusError> {
    match join::<H>(node, topic) {
        Ok(service) => Ok(node.is_any_alive(&publishers(&service))),
        Err(BusError::NoSuchTopic { .. }) => Ok(false),
        Err(other) => Err(other),
    }
}

/// The nodes that have opened a service for writing, those of killed processes among them.
fn publishers<H: OnBus>(service: &Slices<H>) -> Vec<u128> {
    let mut nodes = Vec::new();
    service.dynamic_config().list_publishers(|details| {
        nodes.push(details.node_id.value());
        CallbackProgression::Continue
    });
    nodes
}

/// Fails if the service carries another schema. Returns whether the service exists.
pub(crate) fn check_schema(
    node: &BusNode,
    full: &str,
    name: &ServiceName,
    pattern: MessagingPattern,
    advice: &'static str,
) -> Result<bool, BusError> {
    let details = match Service::details(name, node.config(), pattern) {
        Ok(details) => details,
        Err(e) => return Err(service_error("look at", full, &e)),
    };
    let Some(details) = details else {
        return Ok(false);
    };
    let key = attribute_key(SCHEMA_ATTRIBUTE);
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
pub(crate) fn hint(node: &BusNode, wanted: &str) -> String {
    let topics = topics(node).unwrap_or_default();
    let names: Vec<&str> = topics.iter().map(|topic| topic.name.as_str()).collect();
    if names.is_empty() {
        return format!(
            ": nothing runs on domain {:?}; start the simulator with `gantry up`, or name its --domain",
            node.domain()
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

pub(crate) fn make_event(node: &BusNode, topic: &str) -> Result<(String, Events), BusError> {
    let (full, name) = node.service_name(topic)?;
    let service = settle(node, || {
        node.iceoryx()
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

/// Tries again while another process makes or removes the service, which happens when a daemon
/// restarts while its readers come and go, or was killed while it made it. iceoryx2 itself waits for
/// a service in the making for a moment, so the time counts from the first failure on. What a dead
/// process was making is swept away, so that a service which stays in the making has a live maker.
pub(crate) fn settle<T>(
    node: &BusNode,
    mut open: impl FnMut() -> Result<T, BusError>,
) -> Result<T, BusError> {
    let mut first_failed = None;
    let n_missed = shortage::n_missed();
    let is_short = || shortage::n_missed() != n_missed;
    loop {
        match open() {
            Err(BusError::Service { cause, .. })
                if first_failed.get_or_insert_with(Instant::now).elapsed() < patience(&cause)
                    && !is_short() =>
            {
                node.sweep();
                std::thread::sleep(Duration::from_millis(10));
            }
            done => return done,
        }
    }
}

fn patience(cause: &str) -> Duration {
    match is_in_the_making(cause) || is_being_removed(cause) {
        true => SETTLE_MAKING,
        false => SETTLE,
    }
}

pub(crate) fn schema_attribute() -> AttributeVerifier {
    let value = SCHEMA_VERSION.to_string();
    let value = value
        .as_str()
        .try_into()
        .expect("a number of at most five digits fits an attribute");
    AttributeVerifier::new()
        .require(&attribute_key(SCHEMA_ATTRIBUTE), &value)
        .expect("one attribute fits the set")
}
