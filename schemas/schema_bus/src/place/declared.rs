//! What a service that exists says about itself, asked before it is opened.

use iceoryx2::prelude::*;
use iceoryx2::service::Service as _;
use iceoryx2::service::attribute::AttributeKey;
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as Pattern;

use schema_frames::{
    DocumentHeader, FrameHeader, RESULT_ATTRIBUTE, ResultHeader, SCHEMA_ATTRIBUTE, SCHEMA_VERSION,
    SnapshotHeader, control::ControlHeader,
};

use crate::contract::error::BusError;
use crate::contract::wire::OnBus;
use crate::place::iceoryx_error::service_error;
use crate::place::node::{BusNode, Service};

/// What a service that exists says about itself.
pub(crate) struct Declared {
    /// Type name of its user header.
    pub header: String,
    /// Schema version; empty for a service of another program.
    pub schema: String,
    /// Name of its type of results; empty if it carries none.
    pub result: String,
}

impl Declared {
    /// Fails unless the service's samples have this user header.
    pub fn expect_header(&self, full: &str, wanted: &str) -> Result<(), BusError> {
        if self.header == wanted {
            return Ok(());
        }
        Err(BusError::OtherKind {
            topic: full.into(),
            theirs: carried(&self.header),
            wanted: carried(wanted),
            advice: "open it as what it is",
        })
    }

    /// Fails unless the service carries results of the type `wanted` in this version.
    pub fn expect_result(
        &self,
        full: &str,
        wanted: &str,
        advice: &'static str,
    ) -> Result<(), BusError> {
        if self.header != ResultHeader::NAME || self.result != wanted {
            return Err(BusError::OtherKind {
                topic: full.into(),
                theirs: match self.result.as_str() {
                    "" => carried(&self.header),
                    result => result.into(),
                },
                wanted: wanted.into(),
                advice,
            });
        }
        self.expect_schema(full, "rebuild the older of the two programs")
    }

    /// Fails unless the service carries this version.
    pub fn expect_schema(&self, full: &str, advice: &'static str) -> Result<(), BusError> {
        if self.schema == SCHEMA_VERSION.to_string() {
            return Ok(());
        }
        Err(BusError::SchemaSkew {
            service: full.into(),
            theirs: match self.schema.as_str() {
                "" => "none".into(),
                schema => schema.into(),
            },
            advice,
        })
    }
}

/// What a service with this user header carries, for a sentence.
fn carried(header: &str) -> String {
    match header {
        FrameHeader::NAME => "sensor frames".into(),
        SnapshotHeader::NAME => "snapshots".into(),
        DocumentHeader::NAME => "a document".into(),
        ControlHeader::NAME => "controls".into(),
        ResultHeader::NAME => "results".into(),
        other => format!("samples of another program ({other})"),
    }
}

/// Asks for what the publish-subscribe service declares; `None` if there is none.
pub(crate) fn declared(
    node: &BusNode,
    full: &str,
    name: &ServiceName,
) -> Result<Option<Declared>, BusError> {
    let details = Service::details(name, node.config(), MessagingPattern::PublishSubscribe)
        .map_err(|e| service_error("look at", full, &e))?;
    let Some(details) = details else {
        return Ok(None);
    };
    let service = &details.static_details;
    let Pattern::PublishSubscribe(config) = service.messaging_pattern() else {
        return Ok(None);
    };
    let attribute = |key: &str| {
        service
            .attributes()
            .key_value(&attribute_key(key), 0)
            .map(|value| value.to_string())
            .unwrap_or_default()
    };
    Ok(Some(Declared {
        header: config
            .message_type_details()
            .user_header
            .type_name()
            .to_string(),
        schema: attribute(SCHEMA_ATTRIBUTE),
        result: attribute(RESULT_ATTRIBUTE),
    }))
}

/// iceoryx2's form of an attribute's name.
pub(crate) fn attribute_key(name: &str) -> AttributeKey {
    name.try_into()
        .expect("the attributes' names are shorter than iceoryx2's limit of 64")
}
