//! Who has which ports: the services of a domain with the processes behind them.
//!
//! Looking opens no port. A service is joined for the time of the look, so that its list of ports
//! can be read; that takes one of its 64 places for processes and none of its places for readers
//! and writers.

use std::collections::HashMap;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;
use iceoryx2::service::builder::Builder;
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::port_factory::{event, publish_subscribe, request_response};
use iceoryx2::service::static_config::StaticConfig;
use iceoryx2::service::static_config::message_type_details::{MessageTypeDetails, TypeDetail};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as Pattern;

use schema_frames::{AckRecord, RESULT_ATTRIBUTE, SCHEMA_ATTRIBUTE};

use crate::contract::error::BusError;
use crate::contract::qos::Qos;
use crate::contract::wire::OnBus as _;
use crate::looking::slot::Slot;
use crate::place::declared::attribute_key;
use crate::place::iceoryx_error::service_error;
use crate::place::node::{BusNode, Service};
use crate::place::origins::pid_of;
use crate::place::topics::{TopicKind, kind_of};

/// How a service passes data on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Exchange {
    /// Writers publish, readers subscribe.
    Topic,
    /// Clients ask (they are listed as writers), servers answer (as readers).
    Requests,
    /// Notifiers (writers) wake listeners (readers).
    WakeUps,
}

/// One end of a service in some process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Id of the process; `None` if it cannot be told.
    pub pid: Option<u32>,
    /// Name under which the program joined the bus; empty if it ended or belongs to another user.
    pub program: String,
    /// Name of the port; empty if it was given none.
    pub name: String,
    /// Longest payload that a writer can send, bytes; 0 for readers and wake-ups.
    pub max_payload_bytes: usize,
    /// iceoryx2's number of the port, unique on this machine.
    pub id: u128,
    /// iceoryx2's number of the process's node.
    pub(crate) node: u128,
    /// Slots of a writer's segment.
    pub(crate) n_slots: usize,
}

/// One service of the domain and its ports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServicePorts {
    /// Name without the domain.
    pub name: String,
    /// How it passes data on.
    pub exchange: Exchange,
    /// Type name of the header of its samples or requests; `()` or empty without one.
    pub header: String,
    /// Type name of their payload.
    pub payload: String,
    /// Schema version that it carries; empty for a service of another program.
    pub schema: String,
    /// Name of its type of results; empty if it carries none.
    pub result: String,
    /// Those who publish, ask or notify, by process.
    pub writers: Vec<Port>,
    /// Those who read, answer or listen, by process.
    pub readers: Vec<Port>,
    /// Writers that are allowed.
    pub max_writers: usize,
    /// Readers that are allowed.
    pub max_readers: usize,
    /// Capacity of a topic; `None` of services that are no topics.
    pub qos: Option<Qos>,
    /// Where a sample's parts lie in a writer's segment; `None` of services that are no topics.
    pub(crate) slot: Option<Slot>,
}

impl ServicePorts {
    /// Kind of the topic; `Other` of requests and wake-ups.
    pub fn kind(&self) -> TopicKind {
        match self.exchange {
            Exchange::Topic => kind_of(&self.header),
            Exchange::Requests | Exchange::WakeUps => TopicKind::Other,
        }
    }

    /// Whether its samples are lockstep acknowledgements, which have no header.
    pub fn carries_acks(&self) -> bool {
        self.exchange == Exchange::Topic && self.payload == AckRecord::NAME
    }
}

/// Names of the programs that are alive, by the number of their node.
type Programs = HashMap<u128, String>;

/// All services of the domain by name, topics before requests before wake-ups.
pub(crate) fn services(node: &BusNode) -> Result<Vec<ServicePorts>, BusError> {
    let start = format!("{}/", node.domain());
    let programs = programs(node);
    let mut found = Vec::new();
    Service::list(node.config(), |details| {
        let service = details.static_details;
        let name = service.name().as_str().strip_prefix(&start);
        if let Some(name) = name.map(str::to_owned) {
            found.extend(look(node, &programs, name, &service));
        }
        CallbackProgression::Continue
    })
    .map_err(|e| service_error("list services of", node.domain(), &e))?;
    found.sort_by(|a, b| (&a.name, a.exchange).cmp(&(&b.name, b.exchange)));
    Ok(found)
}

fn programs(node: &BusNode) -> Programs {
    let mut programs = Programs::new();
    // A directory of nodes that cannot be read means that there is none to list.
    let _ = Node::<Service>::list(node.config(), |state| {
        if let NodeState::Alive(view) = state
            && let Some(details) = view.details()
        {
            programs.insert(view.id().value(), details.name().as_str().to_owned());
        }
        CallbackProgression::Continue
    });
    programs
}

/// A service without its ports; `None` for iceoryx2's blackboards, which nothing of ours uses.
fn empty(name: String, service: &StaticConfig) -> Option<ServicePorts> {
    let attribute = |key| {
        let value = service.attributes().key_value(&attribute_key(key), 0);
        value.map(|value| value.to_string()).unwrap_or_default()
    };
    let (exchange, types, max_writers, max_readers) = match service.messaging_pattern() {
        Pattern::PublishSubscribe(of) => (
            Exchange::Topic,
            Some(of.message_type_details()),
            of.max_publishers(),
            of.max_subscribers(),
        ),
        Pattern::RequestResponse(of) => (
            Exchange::Requests,
            Some(of.request_message_type_details()),
            of.max_clients(),
            of.max_servers(),
        ),
        Pattern::Event(of) => (
            Exchange::WakeUps,
            None,
            of.max_notifiers(),
            of.max_listeners(),
        ),
        _ => return None,
    };
    let qos = match service.messaging_pattern() {
        Pattern::PublishSubscribe(of) => Some(Qos {
            readers: of.max_subscribers(),
            publishers: of.max_publishers(),
            buffer: of.subscriber_max_buffer_size(),
            borrowed: of.subscriber_max_borrowed_samples(),
            history: of.history_size(),
        }),
        _ => None,
    };
    let type_name = |part: fn(&MessageTypeDetails) -> &TypeDetail| {
        let name = types.map(|types| part(types).type_name().to_string());
        name.unwrap_or_default()
    };
    Some(ServicePorts {
        name,
        exchange,
        header: type_name(|types| &types.user_header),
        payload: type_name(|types| &types.payload),
        schema: attribute(SCHEMA_ATTRIBUTE),
        result: attribute(RESULT_ATTRIBUTE),
        writers: Vec::new(),
        readers: Vec::new(),
        max_writers,
        max_readers,
        qos,
        slot: types.filter(|_| exchange == Exchange::Topic).map(Slot::of),
    })
}

/// The service with its ports; without any if it has ended meanwhile or is another user's.
fn look(
    node: &BusNode,
    programs: &Programs,
    name: String,
    service: &StaticConfig,
) -> Option<ServicePorts> {
    let mut found = empty(name, service)?;
    let (writers, readers) = (&mut found.writers, &mut found.readers);
    let builder = || node.iceoryx().service_builder(service.name());
    // Every kind of port has its own list and its own names for the same three things.
    macro_rules! collect {
        ($ports:ident.$list:ident, $id:ident, $name:ident => $into:ident) => {
            $ports.$list(|port| {
                $into.push(port_of(
                    programs,
                    port.node_id,
                    port.$id.value(),
                    &port.$name,
                ));
                CallbackProgression::Continue
            })
        };
    }
    match service.messaging_pattern() {
        Pattern::PublishSubscribe(of) => {
            if let Some(open) = open_as_it_is(builder(), of.message_type_details()) {
                let ports = open.dynamic_config();
                ports.list_publishers(|port| {
                    writers.push(Port {
                        // The number that iceoryx2 keeps counts elements.
                        max_payload_bytes: port
                            .max_slice_len
                            .saturating_mul(of.message_type_details().payload.size()),
                        n_slots: port.number_of_samples,
                        ..port_of(
                            programs,
                            port.node_id,
                            port.publisher_id.value(),
                            &port.publisher_name,
                        )
                    });
                    CallbackProgression::Continue
                });
                collect!(ports.list_subscribers, subscriber_id, subscriber_name => readers);
            }
        }
        Pattern::RequestResponse(of) => {
            let types = [
                of.request_message_type_details(),
                of.response_message_type_details(),
            ];
            if let Some(open) = open_requests_as_they_are(builder(), types) {
                let ports = open.dynamic_config();
                collect!(ports.list_clients, client_id, client_name => writers);
                collect!(ports.list_servers, server_id, server_name => readers);
            }
        }
        Pattern::Event(_) => {
            let open: Option<event::PortFactory<Service>> = builder().event().open().ok();
            if let Some(open) = open {
                let ports = open.dynamic_config();
                collect!(ports.list_notifiers, notifier_id, notifier_name => writers);
                collect!(ports.list_listeners, listener_id, listener_name => readers);
            }
        }
        _ => return None,
    }
    for ports in [&mut found.writers, &mut found.readers] {
        ports.sort_by_key(|port| (port.pid, port.id));
    }
    Some(found)
}

fn port_of(programs: &Programs, node: UniqueNodeId, id: u128, name: &PortName) -> Port {
    Port {
        pid: pid_of(node),
        program: programs.get(&node.value()).cloned().unwrap_or_default(),
        name: name.as_str().to_owned(),
        max_payload_bytes: 0,
        id,
        node: node.value(),
        n_slots: 0,
    }
}

/// A topic of types that are not known here, whose samples are bytes.
pub(crate) type AnyTopic =
    publish_subscribe::PortFactory<Service, [CustomPayloadMarker], CustomHeaderMarker>;

/// Opens a topic as it is, whatever its types; `None` if that fails.
pub(crate) fn open_as_it_is(
    builder: Builder<Service>,
    types: &MessageTypeDetails,
) -> Option<AnyTopic> {
    let builder = builder
        .publish_subscribe::<[CustomPayloadMarker]>()
        .user_header::<CustomHeaderMarker>();
    // SAFETY: these calls ask that the types described are those of the memory that is read later.
    // The descriptions come from the service itself, so they are its own; and whoever receives
    // through it reads headers and payloads as plain bytes, of which every pattern is valid.
    let builder = unsafe {
        builder
            .__internal_set_payload_type_details(&types.payload)
            .__internal_set_user_header_type_details(&types.user_header)
            .__internal_skip_type_definition_verification()
    };
    builder.open().ok()
}

type AnyRequests = request_response::PortFactory<
    Service,
    [CustomPayloadMarker],
    CustomHeaderMarker,
    [CustomPayloadMarker],
    CustomHeaderMarker,
>;

fn open_requests_as_they_are(
    builder: Builder<Service>,
    [request, response]: [&MessageTypeDetails; 2],
) -> Option<AnyRequests> {
    let builder = builder
        .request_response::<[CustomPayloadMarker], [CustomPayloadMarker]>()
        .request_user_header::<CustomHeaderMarker>()
        .response_user_header::<CustomHeaderMarker>();
    // SAFETY: as for topics; here nothing is even received.
    let builder = unsafe {
        builder
            .__internal_set_request_payload_type_details(&request.payload)
            .__internal_set_request_header_type_details(&request.user_header)
            .__internal_set_response_payload_type_details(&response.payload)
            .__internal_set_response_header_type_details(&response.user_header)
            .__internal_skip_type_definition_verification()
    };
    builder.open().ok()
}
