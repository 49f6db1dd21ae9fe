//! Frames and results that are not in shared memory, as something that a result can answer.

use schema_bus::{Answerable, Answered};
use schema_frames::{FrameHeader, InputRecord, ResultHeader};

/// What a result takes over from a frame or a result that was read from bytes. It counts as taken
/// when it was sent: a file is read without a clock.
pub struct FromBytes(Answered);

impl FromBytes {
    /// Of a frame of `topic`.
    pub fn frame(header: &FrameHeader, topic: &str) -> FromBytes {
        FromBytes(Answered {
            input: InputRecord {
                tick: header.tick,
                seq: header.seq,
                sim_nanos: header.sim_nanos,
                epoch: header.epoch,
                published_mono_nanos: header.published_mono_nanos,
                taken_mono_nanos: header.published_mono_nanos,
                ..InputRecord::new(topic)
            },
            is_frame: true,
            episode: header.episode,
            epoch: header.epoch,
            origin_mono_nanos: header.published_mono_nanos,
            space: None,
            world_from_space: header.world_from_sensor,
            intrinsics_px: header.intrinsics_px,
            size_px: (header.width, header.height),
        })
    }

    /// Of a result of `topic`.
    pub fn result(header: &ResultHeader, topic: &str) -> FromBytes {
        FromBytes(Answered {
            input: InputRecord {
                tick: header.tick,
                seq: header.seq,
                sim_nanos: header.sim_nanos,
                epoch: header.writer_epoch,
                published_mono_nanos: header.published_mono_nanos,
                taken_mono_nanos: header.published_mono_nanos,
                ..InputRecord::new(topic)
            },
            is_frame: false,
            episode: header.episode,
            epoch: header.epoch,
            origin_mono_nanos: header.origin_mono_nanos,
            space: Some(header.space),
            world_from_space: header.world_from_space,
            intrinsics_px: header.intrinsics_px,
            size_px: (header.width, header.height),
        })
    }
}

impl Answerable for FromBytes {
    fn answered(&self) -> Answered {
        self.0
    }
}
