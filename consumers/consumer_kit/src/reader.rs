//! Reads a topic of frames or of results, whichever it turns out to be.

use schema_bus::{Bus, BusError, Frame, FrameReader, ReaderCounts, ResultReader, ResultSample};

use crate::followed::Take;

/// The reading end of a topic that carries frames or results.
#[derive(Debug)]
pub enum SampleReader {
    /// It carries frames.
    Frames(FrameReader),
    /// It carries results.
    Results(ResultReader),
}

/// What was taken from it.
#[derive(Debug)]
pub enum Sample {
    /// A frame.
    Frame(Frame),
    /// A result.
    Result(ResultSample),
}

impl SampleReader {
    /// Opens `topic`.
    ///
    /// # Errors
    /// As [`Bus::frame_reader`] and [`Bus::result_reader`].
    pub fn open(bus: &Bus, topic: &str) -> Result<SampleReader, BusError> {
        match bus.frame_reader(topic) {
            Ok(reader) => Ok(SampleReader::Frames(reader)),
            // It exists, and carries something else.
            Err(error @ BusError::OtherKind { .. }) => match bus.result_reader(topic) {
                Ok(reader) => Ok(SampleReader::Results(reader)),
                Err(BusError::OtherKind { .. }) => Err(error),
                Err(other) => Err(other),
            },
            Err(other) => Err(other),
        }
    }

    /// The newest sample, or with [`Take::All`] the oldest that waits.
    ///
    /// # Errors
    /// As [`schema_bus::Reader::next`].
    pub fn take(&mut self, take: Take) -> Result<Option<Sample>, BusError> {
        Ok(match (self, take) {
            (SampleReader::Frames(reader), Take::All) => reader.next()?.map(Sample::Frame),
            (SampleReader::Frames(reader), Take::Newest) => reader.latest()?.map(Sample::Frame),
            (SampleReader::Results(reader), Take::All) => reader.next()?.map(Sample::Result),
            (SampleReader::Results(reader), Take::Newest) => reader.latest()?.map(Sample::Result),
        })
    }

    /// Counters so far.
    pub fn counts(&self) -> ReaderCounts {
        match self {
            SampleReader::Frames(reader) => reader.counts(),
            SampleReader::Results(reader) => reader.counts(),
        }
    }

    /// Whether a writer has the topic open now.
    pub fn has_writer(&self) -> bool {
        match self {
            SampleReader::Frames(reader) => reader.has_writer(),
            SampleReader::Results(reader) => reader.has_writer(),
        }
    }
}
