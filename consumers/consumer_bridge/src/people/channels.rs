//! Channels of the server, each offered when its first message comes or before.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Context as _;
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema};
use schema_recording::messages::{Content, Entry};

/// Channels by topic.
pub struct Channels {
    context: Arc<Context>,
    open: BTreeMap<String, (Content, Arc<RawChannel>)>,
}

impl Channels {
    /// None yet.
    pub fn new(context: Arc<Context>) -> Channels {
        Channels {
            context,
            open: BTreeMap::new(),
        }
    }

    /// The channel of a topic, offered if it is not yet, and anew if its messages have another type
    /// now.
    ///
    /// # Errors
    /// What Foxglove's library says.
    pub fn offer(&mut self, topic: &str, content: &Content) -> anyhow::Result<Arc<RawChannel>> {
        if let Some((known, channel)) = self.open.get(topic)
            && known == content
        {
            return Ok(channel.clone());
        }
        self.end(topic);
        let schema = content.schema();
        let channel = ChannelBuilder::new(topic)
            .message_encoding(schema.message_encoding)
            .schema(Schema::new(
                schema.name,
                schema.encoding,
                Cow::Owned(schema.data),
            ))
            .context(&self.context)
            .build_raw()
            .with_context(|| format!("cannot offer {topic} to Foxglove"))?;
        self.open
            .insert(topic.to_owned(), (content.clone(), channel.clone()));
        Ok(channel)
    }

    /// Sends a message to those who subscribe.
    ///
    /// # Errors
    /// As [`Channels::offer`].
    pub fn send(&mut self, entry: &Entry, sim_nanos: u64) -> anyhow::Result<()> {
        let channel = self.offer(&entry.topic, &entry.content)?;
        if channel.has_sinks() {
            channel.log_with_meta(
                &entry.bytes,
                PartialMetadata {
                    log_time: Some(sim_nanos),
                },
            );
        }
        Ok(())
    }

    /// Takes a topic back.
    pub fn end(&mut self, topic: &str) {
        if let Some((_, channel)) = self.open.remove(topic) {
            channel.close();
        }
    }
}
