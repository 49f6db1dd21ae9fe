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

// What the contract fixes: names, capacities, sizes, clock, errors.
mod clock;
mod complaints;
mod error;
mod iceoryx_error;
mod memory;
pub mod names;
pub mod qos;
mod wire;

// A process's place on the bus, and the services there.
mod declared;
mod event;
mod gpu_socket;
mod intake;
mod leftovers;
mod node;
mod origin;
mod origins;
mod root;
mod service;
mod shortage;
mod topics;

// Looking at others without taking part.
mod any_reader;
mod introspect;
mod slot;
mod watch;

// Sensor frames.
mod frame;
mod reader;
mod reserve;
mod segment;

// Results of users' programs.
mod result_draft;
mod result_reader;
mod result_service;
mod result_writer;

// Frames and results that stay on a GPU.
mod gpu;

// Everything else that is sent.
mod claim;
mod command;
mod control;
mod document;
mod drain;
mod lockstep;
mod lockstep_watch;
mod render;
mod scene;
mod snapshot;

// Everything a process can open on the bus, on one page.
mod bus;

pub use any_reader::{AnyReader, AnySample};
pub use bus::Bus;
pub use claim::Claim;
pub use clock::mono_now;
pub use command::{CommandClient, CommandError, CommandServer, Request};
pub use complaints::Complaints;
pub use control::{Ack, AckReader, AckWriter, ControlBatch, ControlReader, ControlWriter};
pub use document::{Document, DocumentPublisher, DocumentReader};
pub use error::{BusError, LoanError};
pub use event::{Listener, Notifier, Token, WaitSet};
pub use frame::{DeviceLoan, FrameLoan, FramePublisher, FrameService};
pub use gpu::{
    GpuDevice, GpuFrame, GpuFrameReader, GpuMemory, GpuOffer, GpuPlaces, GpuResult,
    GpuResultPublisher, GpuResultReader, GpuResultSlot, GpuSample, GpuServer, GpuTopic,
    SharedMemory,
};
pub use intake::ReaderCounts;
pub use introspect::{Exchange, Port, ServicePorts};
pub use lockstep::{AckFault, Gate, Participant};
pub use lockstep_watch::{JoinError, Look};
pub use memory::{
    FrameTopic, MemoryShortage, OTHER_BYTES, ResultTopic, check_shared_memory, shared_memory_free,
    shared_memory_needed,
};
pub use node::{BusOptions, write_private_config};
pub use origin::{Life, Origin};
pub use reader::{Frame, FrameReader};
pub use render::{RenderClient, RenderQuestion, RenderServer};
pub use result_draft::{Answerable, Answered, ResultDraft};
pub use result_reader::{ResultReader, ResultSample};
pub use result_service::ResultService;
pub use result_writer::{ResultLoan, ResultPublisher};
pub use scene::{
    Rendered, RenderedReader, RenderedWriter, SceneMessage, ScenePublisher, SceneReader,
};
pub use segment::Segment;
pub use shortage::MAX_MISSING_STRETCHES;
pub use snapshot::{Snapshot, SnapshotPublisher, SnapshotReader};
pub use topics::{GpuSide, TopicDetails, TopicKind};
pub use watch::{Newest, Watch};
