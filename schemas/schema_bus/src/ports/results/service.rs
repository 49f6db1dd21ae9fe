//! Topics of results as services: made by whoever comes first, joined as they are by the others.

use iceoryx2::prelude::*;

use schema_frames::{
    About, AboutError, RESULT_ATTRIBUTE, ResultHeader, ResultType, SCHEMA_ATTRIBUTE, SCHEMA_VERSION,
};

use crate::contract::error::BusError;
use crate::contract::names;
use crate::contract::qos::{MAX_NODES, Qos};
use crate::contract::wire::{OnBus as _, Wire};
use crate::memory::sizes::ResultTopic;
use crate::place::declared::{attribute_key, declared};
use crate::place::iceoryx_error::service_error;
use crate::place::node::BusNode;
use crate::place::service::{Slices, hint, settle};

/// A topic of results that exists for as long as this is kept, with or without a writer.
#[derive(Debug)]
pub struct ResultService {
    pub(crate) slices: Slices<ResultHeader>,
    pub(crate) topic: String,
    pub(crate) kind: ResultType,
}

/// Whether results of a kind may be described so; `full` names their topic.
///
/// # Errors
/// [`BusError::Description`].
pub(crate) fn check_about(full: &str, kind: ResultType, about: &About) -> Result<(), BusError> {
    let fault = |fault: AboutError| BusError::Description {
        topic: full.into(),
        fault: fault.to_string(),
    };
    about.check(kind).map_err(fault)
}

impl ResultService {
    /// Makes the topic, or joins it with the capacities that it has.
    pub(crate) fn make(
        node: &BusNode,
        topic: &str,
        spec: &ResultTopic,
    ) -> Result<ResultService, BusError> {
        let (full, name) = node.service_name(topic)?;
        if names::is_reserved(topic) {
            return Err(BusError::Reserved {
                topic: topic.into(),
            });
        }
        check_about(&full, spec.kind, &spec.about)?;
        let slices = make_or_join(node, &full, &name, spec.kind, &spec.qos)?;
        Ok(ResultService {
            slices,
            topic: topic.into(),
            kind: spec.kind,
        })
    }

    /// Makes or joins the service of a topic's results on a GPU.
    pub(crate) fn make_on_gpu(
        node: &BusNode,
        topic: &str,
        kind: ResultType,
        qos: &Qos,
    ) -> Result<ResultService, BusError> {
        let (full, name) = node.service_name(&names::gpu_topic(topic))?;
        Ok(ResultService {
            slices: make_or_join(node, &full, &name, kind, qos)?,
            topic: topic.into(),
            kind,
        })
    }

    /// Joins a topic that exists.
    pub(crate) fn join(node: &BusNode, topic: &str) -> Result<ResultService, BusError> {
        let (full, name) = node.service_name(topic)?;
        let missing = || BusError::NoSuchTopic {
            topic: full.clone(),
            hint: hint(node, topic),
        };
        let declared = declared(node, &full, &name)?.ok_or_else(missing)?;
        declared.expect_header(&full, ResultHeader::NAME)?;
        declared.expect_schema(&full, "rebuild the reader")?;
        let kind = ResultType::from_name(&declared.result).ok_or_else(|| BusError::OtherKind {
            topic: full.clone(),
            theirs: format!("results of type {:?}", declared.result),
            wanted: format!("one of {}", ResultType::names()),
            advice: "rebuild the reader",
        })?;
        Ok(ResultService {
            slices: open(node, &full, &name)?,
            topic: topic.into(),
            kind,
        })
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Type of its results.
    pub fn kind(&self) -> ResultType {
        self.kind
    }

    /// Type of the results of a topic; `None` if it does not exist or has none.
    pub(crate) fn kind_of(node: &BusNode, topic: &str) -> Option<ResultType> {
        let (full, name) = node.service_name(topic).ok()?;
        let declared = declared(node, &full, &name).ok()??;
        ResultType::from_name(&declared.result).filter(|_| declared.header == ResultHeader::NAME)
    }

    /// Number of readers now.
    pub fn n_readers(&self) -> usize {
        self.slices.dynamic_config().number_of_subscribers()
    }
}

/// Makes the service, or joins it with the capacities that it has.
fn make_or_join(
    node: &BusNode,
    full: &str,
    name: &ServiceName,
    kind: ResultType,
    qos: &Qos,
) -> Result<Slices<ResultHeader>, BusError> {
    let wanted = kind.name();
    let advice = "publish under another name, or stop all processes that have it open";
    settle(node, || {
        if let Some(declared) = declared(node, full, name)? {
            declared.expect_result(full, wanted, advice)?;
            return open(node, full, name);
        }
        node.iceoryx()
            .service_builder(name)
            .publish_subscribe::<[u8]>()
            .user_header::<Wire<ResultHeader>>()
            .max_publishers(qos.publishers)
            .max_subscribers(qos.readers)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(qos.buffer)
            .subscriber_max_borrowed_samples(qos.borrowed)
            .history_size(qos.history)
            .enable_safe_overflow(true)
            .open_or_create_with_attributes(&attributes(kind))
            .map_err(|e| match service_error("open", full, &e) {
                // Somebody else made it in between; the next turn joins it as it is.
                BusError::Capacity { service, cause } => BusError::Service {
                    action: "open",
                    service,
                    cause,
                },
                other => other,
            })
    })
}

fn open(node: &BusNode, full: &str, name: &ServiceName) -> Result<Slices<ResultHeader>, BusError> {
    node.iceoryx()
        .service_builder(name)
        .publish_subscribe::<[u8]>()
        .user_header::<Wire<ResultHeader>>()
        .open()
        .map_err(|e| service_error("open", full, &e))
}

fn attributes(kind: ResultType) -> AttributeVerifier {
    let version = SCHEMA_VERSION.to_string();
    [
        (SCHEMA_ATTRIBUTE, version.as_str()),
        (RESULT_ATTRIBUTE, kind.name()),
    ]
    .into_iter()
    .fold(AttributeVerifier::new(), |attributes, (key, value)| {
        let value = value
            .try_into()
            .expect("numbers and type names are shorter than iceoryx2's limit of 256");
        attributes
            .require(&attribute_key(key), &value)
            .expect("two attributes fit the set of eight")
    })
}
