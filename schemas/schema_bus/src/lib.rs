//! The bus: frames, results, snapshots, documents, controls, commands and wake-ups between
//! processes, by name, in shared memory. This is the only crate that knows iceoryx2.
//!
//! A program opens one [`Bus`] and asks it for ports. Names are given without the domain
//! (`ego/front/rgb`); the bus puts the domain in front. Nothing here waits unless its name or a
//! `timeout` says so, nothing handles signals, and every error is a sentence with a next step.
//!
//! ```no_run
//! let bus = schema_bus::Bus::open("gantry", "my-consumer")?;
//! let mut camera = bus.frame_reader("ego/front/rgb")?;
//! let sent = bus.listener("ego/front/rgb")?;
//! while sent.wait(std::time::Duration::from_secs(1))? {
//!     if let Some(frame) = camera.latest()? {
//!         println!("tick {}: {} bytes", frame.header().tick, frame.len());
//!     }
//! }
//! # Ok::<(), schema_bus::BusError>(())
//! ```
//!
//! How much memory a topic takes is known before anything is made:
//!
//! ```
//! use schema_bus::FrameTopic;
//! use schema_frames::Modality;
//!
//! // 8 readers × 5 samples + 3 loans = 43 slots of an image and its header.
//! let topic = FrameTopic::new(Modality::Rgb, 800 * 600 * 4);
//! assert_eq!(topic.segment_bytes(Modality::Rgb), 82_642_048);
//! ```

#![warn(missing_docs)]
#![deny(unsafe_op_in_unsafe_fn)]
#![expect(
    unsafe_code,
    reason = "type names on the bus, memory of loans and segments, poll(2); each block proves itself"
)]

// Each room may use those above it in this list, never those below.
mod contract;
mod memory;
mod place;
mod time;

mod looking;
mod ports;

// Everything a process can open on the bus, on one page, and who takes part in the lockstep.
mod bus;
mod participants;

pub use bus::Bus;
pub use contract::error::{BusError, LoanError};
pub use contract::origin::{Life, Origin};
pub use contract::{names, qos};
pub use looking::any_reader::{AnyReader, AnySample};
pub use looking::introspect::{Exchange, Port, ServicePorts};
pub use looking::watch::{Newest, Watch};
pub use memory::segment::Segment;
pub use memory::shortage::MAX_MISSING_STRETCHES;
pub use memory::sizes::{
    FrameTopic, MemoryShortage, OTHER_BYTES, ResultTopic, check_shared_memory, shared_memory_free,
    shared_memory_needed,
};
pub use participants::{JoinError, Look};
pub use place::complaints::Complaints;
pub use place::event::{Listener, Notifier, Token, WaitSet};
pub use place::node::{BusOptions, write_private_config};
pub use place::topics::{GpuSide, TopicDetails, TopicKind};
pub use ports::command::{CommandClient, CommandError, CommandServer, Request, RequestFault};
pub use ports::complete::{CompleteReader, CompleteWriter};
pub use ports::control::{Ack, AckReader, AckWriter, ControlBatch, ControlReader, ControlWriter};
pub use ports::document::{Document, DocumentPublisher, DocumentReader};
pub use ports::frames::reader::{Frame, FrameReader, Frames};
pub use ports::frames::writer::{DeviceLoan, FrameLoan, FramePublisher, FrameService};
pub use ports::gpu::{
    GpuDevice, GpuFrame, GpuFrameReader, GpuFrames, GpuMemory, GpuOffer, GpuPlaces, GpuResult,
    GpuResultPublisher, GpuResultReader, GpuResultSlot, GpuResults, GpuSample, GpuServer, GpuTopic,
    SharedMemory,
};
pub use ports::reader::{Moment, Reader, ReaderCounts, SampleFault, SampleKind};
pub use ports::render::{RenderClient, RenderQuestion, RenderServer};
pub use ports::results::draft::{Answerable, Answered, ResultDraft};
pub use ports::results::reader::{ResultReader, ResultSample, Results};
pub use ports::results::service::ResultService;
pub use ports::results::writer::{ResultLoan, ResultPublisher};
pub use ports::scene::{
    Rendered, RenderedReader, RenderedWriter, SceneMessage, ScenePublisher, SceneReader, Scenes,
};
pub use ports::snapshot::{Snapshot, SnapshotPublisher, SnapshotReader, Snapshots};
pub use time::claim::Claim;
pub use time::clock::mono_now;
pub use time::gate::{AckFault, Gate, Participant};
