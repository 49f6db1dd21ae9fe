//! MCAP files for other people's tools: a profile, schemas and messages that the caller encodes, as
//! an export to ROS 2 needs.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use mcap::Writer;
use mcap::records::MessageHeader;

use crate::messages::SchemaText;
use crate::write::{ChunkCompression, options};

/// An MCAP file under construction whose schemas are not ours.
pub struct BagFile<W: Write + Seek> {
    writer: Writer<W>,
}

/// A message to write: its channel, its number and its two times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BagMessage {
    /// Channel as [`BagFile::channel`] gave it.
    pub channel_id: u16,
    /// Number of the message on its channel.
    pub sequence: u32,
    /// Time it is filed under, nanoseconds.
    pub log_nanos: u64,
    /// Time its publisher sent it, nanoseconds.
    pub publish_nanos: u64,
}

impl<W: Write + Seek> BagFile<W> {
    /// Begins a file with a profile such as `ros2`.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn create(out: W, profile: &str, compression: ChunkCompression) -> anyhow::Result<Self> {
        let writer = options(compression)
            .profile(profile)
            .library(concat!("gantry ", env!("CARGO_PKG_VERSION")))
            .create(out)?;
        Ok(BagFile { writer })
    }

    /// Adds a channel with its schema; a schema that is there already is written once.
    ///
    /// # Errors
    /// If the disk refuses, or if there are more than 65 535 channels.
    pub fn channel(
        &mut self,
        topic: &str,
        schema: &SchemaText,
        metadata: &BTreeMap<String, String>,
    ) -> anyhow::Result<u16> {
        let id = self
            .writer
            .add_schema(&schema.name, &schema.encoding, &schema.data)?;
        Ok(self
            .writer
            .add_channel(id, topic, &schema.message_encoding, metadata)?)
    }

    /// Writes one message.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn write(&mut self, message: BagMessage, bytes: &[u8]) -> anyhow::Result<()> {
        let header = MessageHeader {
            channel_id: message.channel_id,
            sequence: message.sequence,
            log_time: message.log_nanos,
            publish_time: message.publish_nanos,
        };
        Ok(self.writer.write_to_known_channel(&header, bytes)?)
    }

    /// Writes the summary and hands back what was written to.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn finish(mut self) -> anyhow::Result<W> {
        self.writer.finish()?;
        Ok(self.writer.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::walk::{End, RecordWalk};

    #[test]
    fn a_file_has_its_profile_and_says_it_is_complete() {
        let out = Cursor::new(Vec::new());
        let mut bag = BagFile::create(out, "ros2", ChunkCompression::Zstd).unwrap();
        let schema = SchemaText {
            name: "std_msgs/msg/String".into(),
            encoding: "ros2msg".into(),
            data: b"string data\n".to_vec(),
            message_encoding: "cdr".into(),
        };
        let channel_id = bag.channel("/a", &schema, &BTreeMap::new()).unwrap();
        let message = BagMessage {
            channel_id,
            sequence: 1,
            log_nanos: 5,
            publish_nanos: 6,
        };
        bag.write(message, &[0, 1, 0, 0]).unwrap();
        let bytes = bag.finish().unwrap().into_inner();
        assert!(bytes.windows(4).any(|found| found == b"ros2"));
        let mut walk = RecordWalk::new(&bytes[..], bytes.len() as u64).unwrap();
        while walk.next_record().is_some() {}
        assert_eq!(walk.end(), End::Complete);
    }
}
