//! The topics of a domain, for `gantry topic`, hints in errors, and the launcher's readiness check.

use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;
use iceoryx2::service::port_factory::publish_subscribe;
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as Pattern;

use schema_frames::control::ControlHeader;
use schema_frames::{
    DocumentHeader, FrameHeader, Modality, RESULT_ATTRIBUTE, ResultHeader, ResultType,
    SCHEMA_ATTRIBUTE, SnapshotHeader,
};

use crate::contract::error::BusError;
use crate::contract::names::{host_topic, is_gpu_topic};
use crate::contract::qos::Qos;
use crate::contract::wire::{OnBus, Wire};
use crate::place::declared::attribute_key;
use crate::place::iceoryx_error::service_error;
use crate::place::node::{BusNode, Service};

/// Kind of a topic, by the type name of its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum TopicKind {
    /// Sensor frames.
    Frames,
    /// World snapshots.
    Snapshot,
    /// A document.
    Document,
    /// Vehicle controls.
    Controls,
    /// Results of a user's program.
    Results,
    /// Anything else, for example acknowledgements, or a service of another program.
    Other,
}

/// One publish-subscribe topic of the domain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicDetails {
    /// Name without the domain.
    pub name: String,
    /// Kind.
    pub kind: TopicKind,
    /// Modality of a frame topic.
    pub modality: Option<Modality>,
    /// Type of a topic of results.
    pub result: Option<ResultType>,
    /// Number of writers now.
    pub publishers: usize,
    /// Number of readers now.
    pub subscribers: usize,
    /// Number of readers that are allowed.
    pub max_subscribers: usize,
    /// Longest payload that any of the writers can send, bytes; 0 without a writer.
    pub payload_bytes: usize,
    /// Its frames on a GPU; `None` if nobody asked for them.
    pub on_gpu: Option<GpuSide>,
    /// Schema version that it carries; empty for a service of another program.
    pub schema: String,
    /// Capacity.
    pub qos: Qos,
}

/// The service of a topic's frames on a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuSide {
    /// Number of writers that have memory for it now.
    pub publishers: usize,
    /// Number of readers now.
    pub subscribers: usize,
    /// Number of readers that are allowed.
    pub max_subscribers: usize,
}

/// All publish-subscribe topics of the domain by name.
pub(crate) fn topics(node: &BusNode) -> Result<Vec<TopicDetails>, BusError> {
    let mut topics = Vec::new();
    let start = format!("{}/", node.domain());
    let (schema_key, result_key) = (
        attribute_key(SCHEMA_ATTRIBUTE),
        attribute_key(RESULT_ATTRIBUTE),
    );
    Service::list(node.config(), |details| {
        let service = &details.static_details;
        if let (Some(name), Pattern::PublishSubscribe(qos)) = (
            service.name().as_str().strip_prefix(&start),
            service.messaging_pattern(),
        ) {
            let header = qos
                .message_type_details()
                .user_header
                .type_name()
                .to_string();
            let value = |key| {
                service
                    .attributes()
                    .key_value(key, 0)
                    .map(|value| value.to_string())
                    .unwrap_or_default()
            };
            let schema = value(&schema_key);
            topics.push(TopicDetails {
                kind: kind_of(&header),
                modality: name
                    .rsplit('/')
                    .next()
                    .and_then(Modality::from_name)
                    .filter(|_| header == FrameHeader::NAME),
                result: ResultType::from_name(&value(&result_key))
                    .filter(|_| header == ResultHeader::NAME),
                name: name.to_string(),
                publishers: 0,
                subscribers: 0,
                max_subscribers: qos.max_subscribers(),
                payload_bytes: 0,
                on_gpu: None,
                schema,
                qos: Qos {
                    readers: qos.max_subscribers(),
                    publishers: qos.max_publishers(),
                    buffer: qos.subscriber_max_buffer_size(),
                    borrowed: qos.subscriber_max_borrowed_samples(),
                    history: qos.history_size(),
                },
            });
        }
        CallbackProgression::Continue
    })
    .map_err(|e| service_error("list services of", node.domain(), &e))?;
    // The GPU's side of a topic is told with the topic.
    let (on_gpu, mut topics): (Vec<_>, Vec<_>) = topics
        .into_iter()
        .partition(|topic: &TopicDetails| is_gpu_topic(&topic.name));
    topics.iter_mut().for_each(|topic| count_ports(node, topic));
    for mut service in on_gpu {
        count_ports(node, &mut service);
        let name = host_topic(&service.name);
        if let Some(topic) = topics.iter_mut().find(|topic| topic.name == name) {
            topic.on_gpu = Some(GpuSide {
                publishers: service.publishers,
                subscribers: service.subscribers,
                max_subscribers: service.max_subscribers,
            });
        }
    }
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(topics)
}

/// Fills in the numbers of ports. A topic that has ended meanwhile keeps its zeros.
fn count_ports(node: &BusNode, topic: &mut TopicDetails) {
    match topic.kind {
        TopicKind::Frames => count_as::<FrameHeader>(node, topic),
        TopicKind::Snapshot => count_as::<SnapshotHeader>(node, topic),
        TopicKind::Document => count_as::<DocumentHeader>(node, topic),
        TopicKind::Controls => count_as::<ControlHeader>(node, topic),
        TopicKind::Results => count_as::<ResultHeader>(node, topic),
        TopicKind::Other => {}
    }
}

fn count_as<H: OnBus>(node: &BusNode, topic: &mut TopicDetails) {
    let Ok((_, name)) = node.service_name(&topic.name) else {
        return;
    };
    let opened: Result<publish_subscribe::PortFactory<Service, [u8], Wire<H>>, _> = node
        .iceoryx()
        .service_builder(&name)
        .publish_subscribe::<[u8]>()
        .user_header::<Wire<H>>()
        .open();
    let Ok(service) = opened else { return };
    let ports = service.dynamic_config();
    topic.publishers = ports.number_of_publishers();
    topic.subscribers = ports.number_of_subscribers();
    ports.list_publishers(|publisher| {
        topic.payload_bytes = topic.payload_bytes.max(publisher.max_slice_len);
        CallbackProgression::Continue
    });
}

/// Kind of the topics whose samples have a header of this type name.
pub(crate) fn kind_of(header: &str) -> TopicKind {
    match header {
        FrameHeader::NAME => TopicKind::Frames,
        SnapshotHeader::NAME => TopicKind::Snapshot,
        DocumentHeader::NAME => TopicKind::Document,
        ControlHeader::NAME => TopicKind::Controls,
        ResultHeader::NAME => TopicKind::Results,
        _ => TopicKind::Other,
    }
}
