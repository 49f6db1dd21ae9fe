//! Writes a new recording of records from others. Until it is finished it is called OUT.part, or
//! OUT.copy.part if there is an OUT.part, which may be what is copied.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufWriter, ErrorKind};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use mcap::records::{Channel, MessageHeader, SchemaHeader};
use mcap::{Attachment, Writer};
use schema_recording::write::{ChunkCompression, options, part_path};

/// Which input an id belongs to, and the id.
type Id = (usize, u16);

/// Most bytes of schemas and channels that a recording of others may have: its writer keeps them
/// until the end, and packed they can be any number.
pub const MAX_DESCRIBED_BYTES: usize = 64 << 20;

/// A recording that is made of others.
pub(crate) struct Copier {
    writer: Writer<BufWriter<File>>,
    part: PathBuf,
    target: PathBuf,
    schemas: HashMap<Id, u16>,
    channels: HashMap<Id, u16>,
    /// Bytes of schemas and channels so far.
    described_bytes: usize,
    /// Messages so far.
    pub(crate) n_messages: u64,
}

impl Copier {
    /// Creates the unfinished file.
    ///
    /// # Errors
    /// If `target` exists already, or there is no free name for the unfinished file.
    pub(crate) fn create(target: &Path) -> anyhow::Result<Copier> {
        if target.exists() {
            bail!(
                "{} exists already; choose another name or remove it first",
                target.display()
            );
        }
        let create = |part: &Path| File::options().write(true).create_new(true).open(part);
        let mut part = part_path(target);
        let mut made = create(&part);
        if matches!(&made, Err(error) if error.kind() == ErrorKind::AlreadyExists) {
            part = part_path(&target.with_added_extension("copy"));
            made = create(&part);
        }
        let file = made.with_context(|| {
            format!(
                "cannot create {}; if it is left from a copy that was broken off, remove it",
                part.display()
            )
        })?;
        Ok(Copier {
            writer: options(ChunkCompression::Lz4)
                .create(BufWriter::with_capacity(1 << 20, file))?,
            part,
            target: target.to_path_buf(),
            schemas: HashMap::new(),
            channels: HashMap::new(),
            described_bytes: 0,
            n_messages: 0,
        })
    }

    fn describe(&mut self, bytes: usize) -> anyhow::Result<()> {
        self.described_bytes = self.described_bytes.saturating_add(bytes);
        if self.described_bytes > MAX_DESCRIBED_BYTES {
            bail!(
                "its schemas and channels have more than {MAX_DESCRIBED_BYTES} bytes, as no recording has; what was copied so far stays in {}",
                self.part.display()
            );
        }
        Ok(())
    }

    pub(crate) fn schema(
        &mut self,
        input: usize,
        header: &SchemaHeader,
        data: &[u8],
    ) -> anyhow::Result<()> {
        // Every chunk of some writers repeats what it uses.
        if header.id != 0 && !self.schemas.contains_key(&(input, header.id)) {
            let parts = [header.name.len(), header.encoding.len(), data.len()];
            self.describe(parts.iter().sum())?;
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
        if let Some(schema) = schema
            && !self.channels.contains_key(&(input, channel.id))
        {
            let pairs = channel.metadata.iter();
            let texts = pairs.flat_map(|(key, value)| [key.len(), value.len()]);
            let names = [channel.topic.len(), channel.message_encoding.len()];
            self.describe(texts.chain(names).sum())?;
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
            self.n_messages = self.n_messages.saturating_add(1);
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
        drop(file);
        launch_cli::files::rename(&self.part, &self.target)
            .with_context(|| format!("cannot name {}", self.target.display()))?;
        Ok(self.n_messages)
    }
}
