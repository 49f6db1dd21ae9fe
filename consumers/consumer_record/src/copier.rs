//! Writes a new recording of records from others. It is called OUT.part until it is finished.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use mcap::records::{Channel, MessageHeader, SchemaHeader};
use mcap::{Attachment, Writer};
use schema_recording::write::{ChunkCompression, options, part_path};

/// Which input an id belongs to, and the id.
type Id = (usize, u16);

/// A recording that is made of others.
pub(crate) struct Copier {
    writer: Writer<BufWriter<File>>,
    part: PathBuf,
    target: PathBuf,
    schemas: HashMap<Id, u16>,
    channels: HashMap<Id, u16>,
    /// Messages so far.
    pub(crate) n_messages: u64,
}

impl Copier {
    /// Creates `target.part`.
    ///
    /// # Errors
    /// If one of the two exists already or cannot be made.
    pub(crate) fn create(target: &Path) -> anyhow::Result<Copier> {
        let part = part_path(target);
        if target.exists() {
            bail!(
                "{} exists already; choose another name or remove it first",
                target.display()
            );
        }
        let file = File::options()
            .write(true)
            .create(true)
            .truncate(true)
            .open(&part)
            .with_context(|| format!("cannot create {}", part.display()))?;
        Ok(Copier {
            writer: options(ChunkCompression::Lz4)
                .create(BufWriter::with_capacity(1 << 20, file))?,
            part,
            target: target.to_path_buf(),
            schemas: HashMap::new(),
            channels: HashMap::new(),
            n_messages: 0,
        })
    }

    pub(crate) fn schema(
        &mut self,
        input: usize,
        header: &SchemaHeader,
        data: &[u8],
    ) -> anyhow::Result<()> {
        if header.id != 0 {
            let id = self
                .writer
                .add_schema(&header.name, &header.encoding, data)?;
            self.schemas.insert((input, header.id), id);
        }
        Ok(())
    }

    /// Takes a channel over; one whose schema is missing is left out.
    pub(crate) fn channel(&mut self, input: usize, channel: &Channel) -> anyhow::Result<()> {
        let schema = match channel.schema_id {
            0 => Some(0),
            id => self.schemas.get(&(input, id)).copied(),
        };
        if let Some(schema) = schema {
            let id = self.writer.add_channel(
                schema,
                &channel.topic,
                &channel.message_encoding,
                &channel.metadata,
            )?;
            self.channels.insert((input, channel.id), id);
        }
        Ok(())
    }

    /// Takes a message over, unless its channel was not.
    pub(crate) fn message(
        &mut self,
        input: usize,
        header: &MessageHeader,
        data: &[u8],
    ) -> anyhow::Result<()> {
        if let Some(id) = self.channels.get(&(input, header.channel_id)) {
            let header = MessageHeader {
                channel_id: *id,
                ..*header
            };
            self.writer.write_to_known_channel(&header, data)?;
            self.n_messages += 1;
        }
        Ok(())
    }

    pub(crate) fn attach(&mut self, attachment: &Attachment<'_>) -> anyhow::Result<()> {
        Ok(self.writer.attach(attachment)?)
    }

    pub(crate) fn metadata(
        &mut self,
        name: &str,
        pairs: &BTreeMap<String, String>,
    ) -> anyhow::Result<()> {
        Ok(self.writer.write_metadata(&mcap::records::Metadata {
            name: name.to_string(),
            metadata: pairs.clone(),
        })?)
    }

    /// Writes the summary, makes the file durable and gives it its name.
    ///
    /// # Errors
    /// If the disk refuses.
    pub(crate) fn finish(mut self) -> anyhow::Result<u64> {
        self.writer.finish()?;
        let file = self
            .writer
            .into_inner()
            .into_inner()
            .map_err(|error| error.into_error())?;
        file.sync_all()
            .with_context(|| format!("cannot write {} to disk", self.part.display()))?;
        std::fs::rename(&self.part, &self.target)
            .with_context(|| format!("cannot name {}", self.target.display()))?;
        Ok(self.n_messages)
    }
}
