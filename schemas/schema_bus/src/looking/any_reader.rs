//! Reading a topic of any types as bytes: those of programs that do not use our headers.

use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::service::Service as _;
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as Pattern;

use crate::contract::error::BusError;
use crate::looking::introspect::{AnyTopic, open_as_it_is};
use crate::place::iceoryx_error::{other_error, reader_error, receive_error, service_error};
use crate::place::node::{BusNode, Service};
use crate::place::service::hint;

/// The reading end of a topic whose types are not known here.
#[derive(Debug)]
pub struct AnyReader {
    port: Subscriber<Service, [CustomPayloadMarker], CustomHeaderMarker>,
    service: AnyTopic,
    header: String,
    header_bytes: usize,
    payload: String,
}

impl AnyReader {
    pub(crate) fn open(node: &BusNode, topic: &str) -> Result<AnyReader, BusError> {
        let (full, name) = node.service_name(topic)?;
        let details = Service::details(&name, node.config(), MessagingPattern::PublishSubscribe)
            .map_err(|e| service_error("look at", &full, &e))?;
        let Some(details) = details else {
            return Err(BusError::NoSuchTopic {
                topic: full,
                hint: hint(node, topic),
            });
        };
        let Pattern::PublishSubscribe(config) = details.static_details.messaging_pattern() else {
            return Err(other_error("read", &full, &"it is no topic"));
        };
        let types = config.message_type_details();
        let service = open_as_it_is(node.iceoryx().service_builder(&name), types)
            .ok_or_else(|| other_error("open", &full, &"it ended, or is another user's"))?;
        let port = service
            .subscriber_builder()
            .create()
            .map_err(|e| reader_error(&full, config.max_subscribers(), e))?;
        Ok(AnyReader {
            port,
            service,
            header: types.user_header.type_name().to_string(),
            header_bytes: types.user_header.size(),
            payload: types.payload.type_name().to_string(),
        })
    }

    /// Type name of the samples' header; `()` without one.
    pub fn header_type(&self) -> &str {
        &self.header
    }

    /// Type name of the payload's elements.
    pub fn payload_type(&self) -> &str {
        &self.payload
    }

    /// Takes the oldest sample that waits, if any.
    ///
    /// # Errors
    /// [`BusError::BorrowLimit`], [`BusError::Service`].
    #[expect(
        clippy::should_implement_trait,
        reason = "polled, like `FrameReader::next`"
    )]
    pub fn next(&mut self) -> Result<Option<AnySample>, BusError> {
        let sample = self.port.receive().map_err(|e| {
            let limit = self
                .service
                .static_config()
                .subscriber_max_borrowed_samples();
            receive_error(self.service.name().as_str(), limit, e)
        })?;
        Ok(sample.map(|sample| AnySample {
            sample,
            header_bytes: self.header_bytes,
        }))
    }
}

/// A sample in shared memory as bytes. Drop it soon: a reader may hold few.
#[derive(Debug)]
pub struct AnySample {
    sample: Sample<Service, [CustomPayloadMarker], CustomHeaderMarker>,
    header_bytes: usize,
}

impl AnySample {
    /// Bytes of the header; empty without one.
    pub fn header(&self) -> &[u8] {
        let start: *const CustomHeaderMarker = self.sample.user_header();
        // SAFETY: iceoryx2 places a header of the service's own type there, which has this size;
        // it stays for as long as the sample, and every pattern of bytes is valid.
        unsafe { std::slice::from_raw_parts(start.cast(), self.header_bytes) }
    }

    /// Bytes of the payload.
    pub fn payload(&self) -> &[u8] {
        let payload = self.sample.payload();
        // SAFETY: the marker is one byte, so address and length are those of the bytes, which stay
        // for as long as the sample; every pattern of bytes is valid.
        unsafe { std::slice::from_raw_parts(payload.as_ptr().cast(), payload.len()) }
    }
}
