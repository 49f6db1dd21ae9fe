//! What a result says of itself before it has memory: its header, and the frames and results that it
//! answers.

use schema_frames::result::MAX_INPUTS;
use schema_frames::{FrameHeader, InputRecord, ResultHeader, ResultType, Space};
use schema_types::{MonoTime, Pose};

use crate::ports::frames::reader::Frame;
use crate::ports::results::reader::ResultSample;

/// What a result can answer: a frame, or another result.
pub trait Answerable {
    /// What a result that answers it takes over.
    fn answered(&self) -> Answered;
}

/// What a result takes over from an input.
#[derive(Clone, Copy, Debug)]
pub struct Answered {
    /// The record that names the input.
    pub input: InputRecord,
    /// Whether it is a sensor's frame.
    pub is_frame: bool,
    /// Its episode.
    pub episode: u32,
    /// The simulator's epoch; 0 without one.
    pub epoch: u64,
    /// `CLOCK_MONOTONIC` at which the oldest frame behind it was published; 0 without one.
    pub origin_mono_nanos: u64,
    /// [`Space`] number of a result; a frame leaves the space to the type of the result.
    pub space: Option<u32>,
    /// Pose of the sensor or of the result's space in the world.
    pub world_from_space: Pose,
    /// Intrinsics of the sensor's image, pixels.
    pub intrinsics_px: [f64; 4],
    /// Width and height of the image, pixels; 0 without one.
    pub size_px: (u32, u32),
}

impl Answered {
    /// What a result takes over from a result of `topic`, for those that have it elsewhere than on the
    /// bus.
    pub fn by_result(header: &ResultHeader, topic: &str, taken: MonoTime) -> Answered {
        Answered {
            input: InputRecord {
                tick: header.tick,
                seq: header.seq,
                sim_nanos: header.sim_nanos,
                epoch: header.writer_epoch,
                published_mono_nanos: header.published_mono_nanos,
                taken_mono_nanos: taken.0,
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
        }
    }

    /// What a result takes over from a frame of `topic`, for those that have it elsewhere than on the
    /// bus.
    pub fn by_frame(header: &FrameHeader, topic: &str, taken: MonoTime) -> Answered {
        Answered {
            input: InputRecord {
                tick: header.tick,
                seq: header.seq,
                sim_nanos: header.sim_nanos,
                epoch: header.epoch,
                published_mono_nanos: header.published_mono_nanos,
                taken_mono_nanos: taken.0,
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
        }
    }
}

impl Answerable for Answered {
    fn answered(&self) -> Answered {
        *self
    }
}

impl Answerable for Frame {
    fn answered(&self) -> Answered {
        Answered::by_frame(self.header(), self.topic(), self.taken())
    }
}

impl Answerable for ResultSample {
    fn answered(&self) -> Answered {
        Answered::by_result(self.header(), self.topic(), self.taken())
    }
}

/// The earlier of two moments; 0 is none.
fn oldest(kept: &mut u64, other: u64) {
    if other != 0 && (*kept == 0 || other < *kept) {
        *kept = other;
    }
}

/// A result without memory.
#[derive(Clone, Debug)]
pub struct ResultDraft {
    header: ResultHeader,
    inputs: Vec<InputRecord>,
    answers_frame: bool,
}

impl ResultDraft {
    /// A result of a type that says nothing yet.
    pub fn new(kind: ResultType) -> ResultDraft {
        ResultDraft {
            header: ResultHeader::new(kind),
            inputs: Vec::new(),
            answers_frame: false,
        }
    }

    /// The header as it is so far.
    pub fn header(&self) -> &ResultHeader {
        &self.header
    }

    /// The header, for space, pose and whatever the inputs do not say.
    pub fn header_mut(&mut self) -> &mut ResultHeader {
        &mut self.header
    }

    /// Its inputs so far.
    pub fn inputs(&self) -> &[InputRecord] {
        &self.inputs
    }

    /// Names a frame or a result that this one was computed from, and takes over its tick, times
    /// and, for results in image or sensor space, the sensor's pose and intrinsics. Inputs beyond
    /// the eighth are not named.
    pub fn answers(&mut self, input: &dyn Answerable) {
        let of = input.answered();
        // The first frame says where the sensor stood; without a frame, the first result does.
        let describes = match of.is_frame {
            true => !self.answers_frame,
            false => self.inputs.is_empty(),
        };
        self.answers_frame |= of.is_frame;
        let header = &mut self.header;
        if of.input.tick >= header.tick {
            (header.tick, header.sim_nanos) = (of.input.tick, of.input.sim_nanos);
            (header.episode, header.epoch) = (of.episode, of.epoch);
        }
        oldest(&mut header.origin_mono_nanos, of.origin_mono_nanos);
        oldest(&mut header.taken_mono_nanos, of.input.taken_mono_nanos);
        if describes && matches!(header.space(), Some(Space::Image | Space::Sensor)) {
            header.space = of.space.unwrap_or(header.space);
            header.world_from_space = of.world_from_space;
            header.intrinsics_px = of.intrinsics_px;
        }
        let has_image_size = matches!(
            header.kind(),
            Some(ResultType::Masks | ResultType::Keypoints)
        );
        if describes && has_image_size && of.size_px != (0, 0) {
            (header.width, header.height) = of.size_px;
        }
        self.add_input(of.input);
    }

    /// Names an input by its record alone, for one that is no longer in hand.
    pub fn add_input(&mut self, input: InputRecord) {
        if self.inputs.len() < MAX_INPUTS {
            self.inputs.push(input);
        }
    }

    /// Writes the number of inputs, and the length that comes from it, into the header.
    pub(crate) fn count_inputs(&mut self) {
        let (header, n) = (&mut self.header, self.inputs.len());
        header.n_inputs = n as u32;
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, n);
    }
}
