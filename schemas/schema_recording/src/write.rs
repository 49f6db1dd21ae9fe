//! Writing a recording: `FILE.part`, which gets its name when it is finished.

use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};

use crate::messages::{Batch, Content};

/// Size at which a chunk is closed.
pub const CHUNK_BYTES: u64 = 4 << 20;

/// Compression of chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChunkCompression {
    /// None: fastest, largest.
    None,
    /// Fast.
    #[default]
    Lz4,
    /// Smaller, slower.
    Zstd,
}

impl ChunkCompression {
    fn mcap(self) -> Option<Compression> {
        match self {
            ChunkCompression::None => None,
            ChunkCompression::Lz4 => Some(Compression::Lz4),
            ChunkCompression::Zstd => Some(Compression::Zstd),
        }
    }
}

/// What was written.
#[derive(Clone, Debug, Default)]
pub struct Written {
    /// Messages per channel topic.
    pub messages: BTreeMap<String, u64>,
    /// Bytes of the file.
    pub file_bytes: u64,
}

/// An MCAP file under construction.
pub struct Recording {
    writer: Writer<BufWriter<File>>,
    /// The same file.
    handle: File,
    part: PathBuf,
    target: PathBuf,
    /// By topic: the contents it carries and their channels. Most topics carry one.
    channels: HashMap<String, Vec<(Content, u16)>>,
    counts: BTreeMap<String, u64>,
}

impl Recording {
    /// Creates `target.part`.
    ///
    /// # Errors
    /// If `target` or its part file exists already, or cannot be created.
    pub fn create(target: &Path, compression: ChunkCompression) -> anyhow::Result<Recording> {
        let part = part_path(target);
        if target.exists() {
            bail!(
                "{} exists already; choose another name or remove it first",
                target.display()
            );
        }
        if part.exists() {
            bail!(
                "{0} is left from a recording that did not finish; rescue it with `gantry-record recover {0} OUT.mcap`, or remove it",
                part.display()
            );
        }
        if let Some(folder) = target
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty())
        {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        }
        let file = OpenOptions::new().write(true).create_new(true).open(&part);
        let file = file.with_context(|| format!("cannot create {}", part.display()))?;
        let handle = file.try_clone()?;
        let writer = options(compression).create(BufWriter::with_capacity(1 << 20, file))?;
        Ok(Recording {
            writer,
            handle,
            part,
            target: target.to_path_buf(),
            channels: HashMap::new(),
            counts: BTreeMap::new(),
        })
    }

    /// Writes the messages of one frame, snapshot or document.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn write(&mut self, batch: &Batch) -> anyhow::Result<()> {
        for entry in &batch.entries {
            let channel_id = self.channel(&entry.topic, &entry.content)?;
            let header = MessageHeader {
                channel_id,
                sequence: batch.sequence,
                log_time: batch.log_nanos,
                publish_time: batch.publish_nanos,
            };
            self.writer.write_to_known_channel(&header, &entry.bytes)?;
            match self.counts.get_mut(&entry.topic) {
                Some(count) => *count = count.saturating_add(1),
                None => drop(self.counts.insert(entry.topic.clone(), 1)),
            }
        }
        Ok(())
    }

    fn channel(&mut self, topic: &str, content: &Content) -> anyhow::Result<u16> {
        let known = self.channels.get(topic).map_or(&[][..], Vec::as_slice);
        if let Some((_, id)) = known.iter().find(|(kind, _)| kind == content) {
            return Ok(*id);
        }
        let schema = content.schema();
        let schema_id = self
            .writer
            .add_schema(&schema.name, &schema.encoding, &schema.data)?;
        let id = self.writer.add_channel(
            schema_id,
            topic,
            &schema.message_encoding,
            &BTreeMap::new(),
        )?;
        let channels = self.channels.entry(topic.to_string()).or_default();
        channels.push((content.clone(), id));
        Ok(id)
    }

    /// Attaches a file.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn attach(
        &mut self,
        name: &str,
        media_type: &str,
        data: &[u8],
        log_nanos: u64,
    ) -> anyhow::Result<()> {
        Ok(self.writer.attach(&Attachment {
            log_time: log_nanos,
            create_time: log_nanos,
            name: name.to_string(),
            media_type: media_type.to_string(),
            data: data.into(),
        })?)
    }

    /// Writes a metadata record.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn metadata(&mut self, name: &str, pairs: &BTreeMap<String, String>) -> anyhow::Result<()> {
        Ok(self.writer.write_metadata(&Metadata {
            name: name.to_string(),
            metadata: pairs.clone(),
        })?)
    }

    /// Bytes of the file so far, less the chunk that is being filled.
    ///
    /// # Errors
    /// If the file cannot be looked at.
    pub fn bytes(&self) -> anyhow::Result<u64> {
        Ok(self.handle.metadata()?.len())
    }

    /// Another handle of the file, to bring it to the disk while it is written.
    ///
    /// # Errors
    /// If there can be no more open files.
    pub fn file(&self) -> anyhow::Result<File> {
        Ok(self.handle.try_clone()?)
    }

    /// Closes the chunk and hands everything to the operating system.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn flush(&mut self) -> anyhow::Result<()> {
        Ok(self.writer.flush()?)
    }

    /// Writes the summary, makes the file durable and gives it its name.
    ///
    /// # Errors
    /// If the disk refuses, or somebody made a file of that name meanwhile.
    pub fn finish(mut self) -> anyhow::Result<Written> {
        self.writer.finish()?;
        let file = self
            .writer
            .into_inner()
            .into_inner()
            .map_err(|error| error.into_error())?;
        file.sync_all()
            .with_context(|| format!("cannot write {} to disk", self.part.display()))?;
        let file_bytes = file.metadata()?.len();
        if self.target.exists() {
            bail!(
                "{} appeared while recording; the recording stays in {}",
                self.target.display(),
                self.part.display()
            );
        }
        std::fs::rename(&self.part, &self.target).with_context(|| {
            format!(
                "cannot rename {} to {}",
                self.part.display(),
                self.target.display()
            )
        })?;
        // The new name is on the disk only once its folder is.
        let folder = self.target.parent().filter(|it| !it.as_os_str().is_empty());
        File::open(folder.unwrap_or(Path::new(".")))
            .and_then(|folder| folder.sync_all())
            .with_context(|| format!("cannot write the name {} to disk", self.target.display()))?;
        Ok(Written {
            messages: self.counts,
            file_bytes,
        })
    }
}

/// Name of an unfinished file.
pub fn part_path(target: &Path) -> PathBuf {
    let mut name = target.as_os_str().to_os_string();
    name.push(".part");
    PathBuf::from(name)
}

/// Options of every file we write.
pub fn options(compression: ChunkCompression) -> WriteOptions {
    WriteOptions::new()
        .compression(compression.mcap())
        .compression_level(if compression == ChunkCompression::Zstd {
            1
        } else {
            0
        })
        .chunk_size(Some(CHUNK_BYTES))
        // A chunk is written in one go, behind its true header. A header that is written again when
        // its chunk is whole is a false one for a while, and whoever is killed then loses the chunk.
        .disable_seeking(true)
        .profile("")
        .library(concat!("gantry-record ", env!("CARGO_PKG_VERSION")))
}
