//! Colour topics as video: one encoder a topic, a key frame at the first frame of every simulated
//! second.

use std::collections::BTreeMap;
use std::sync::Arc;

use consumer_forms::picture::PictureError;
use consumer_forms::picture::h264::{H264, Planes};
use foxglove::messages as fox;
use parking_lot::Mutex;
use schema_frames::FrameHeader;
use schema_recording::messages::{Content, Entry};

use consumer_forms::foxglove::frames::{TopicName, timestamp};

/// Name of H.264 in `foxglove.CompressedVideo` and `gantry.Frame`.
pub const H264_NAME: &str = "h264";

/// The streams of a recording; coding threads share them.
#[derive(Debug)]
pub struct Videos {
    qp: u8,
    streams: Mutex<BTreeMap<String, Arc<Mutex<Stream>>>>,
}

/// The video of one topic.
#[derive(Debug, Default)]
struct Stream {
    encoder: Option<(H264, [u32; 2])>,
    picture: Planes,
    /// Second of the newest frame.
    second: u64,
    is_refused: bool,
}

impl Videos {
    /// No stream yet; `qp` is the quantiser of every frame, see [`consumer_forms::picture::h264::QP`].
    pub fn new(qp: u8) -> Videos {
        Videos {
            qp,
            streams: Mutex::default(),
        }
    }

    /// The message of a colour image. A topic's images come one after the other, as the file holds
    /// them; `second` is the simulated second that the file is in. `None` if the topic cannot be
    /// video, which is said once.
    pub(crate) fn entry(
        &self,
        name: &TopicName,
        header: &FrameHeader,
        payload: &[u8],
        second: u64,
    ) -> Option<Entry> {
        let stream = self
            .streams
            .lock()
            .entry(name.channel.clone())
            .or_default()
            .clone();
        let mut stream = stream.lock();
        if stream.is_refused {
            return None;
        }
        match stream.encode(header, payload, second, self.qp) {
            Ok(data) => {
                let message = fox::CompressedVideo {
                    timestamp: Some(timestamp(header.sim_nanos)),
                    frame_id: name.optical_frame_id(),
                    data: data.into(),
                    format: H264_NAME.to_string(),
                };
                let content = Content::CompressedVideo;
                Some(Entry::foxglove(name.channel.clone(), content, &message))
            }
            Err(error) => {
                tracing::warn!(
                    channel = name.channel,
                    %error,
                    "kept as without --video, because it cannot be coded as video"
                );
                stream.is_refused = true;
                stream.encoder = None;
                None
            }
        }
    }
}

impl Stream {
    fn encode(
        &mut self,
        header: &FrameHeader,
        payload: &[u8],
        second: u64,
        qp: u8,
    ) -> Result<Vec<u8>, PictureError> {
        let size_px = [header.width, header.height];
        let known = self.encoder.take().filter(|(_, of)| *of == size_px);
        let is_new = known.is_none();
        let (encoder, _) = self.encoder.insert(match known {
            Some(known) => known,
            None => (H264::new(size_px, qp)?, size_px),
        });
        self.picture
            .set_bgra(size_px, header.row_stride as usize, payload);
        let is_key = is_new || second != self.second;
        self.second = second;
        let mut data = Vec::with_capacity(payload.len() / 32);
        encoder.encode(&self.picture, is_key, &mut data)?;
        Ok(data)
    }
}
