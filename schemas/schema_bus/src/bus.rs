//! The bus: all that a process can open and ask, on one page.

use schema_frames::{About, DocumentHeader, ResultType};

use crate::contract::error::BusError;
use crate::contract::names;
use crate::looking::any_reader::AnyReader;
use crate::looking::introspect::{ServicePorts, services};
use crate::looking::watch::Watch;
use crate::memory::shortage::guarded;
use crate::memory::sizes::{FrameTopic, ResultTopic};
use crate::place::event::{Listener, Notifier};
use crate::place::node::{BusNode, BusOptions};
use crate::place::service::is_published;
use crate::place::topics::{TopicDetails, topics};
use crate::ports::command::{CommandClient, CommandServer};
use crate::ports::complete::{CompleteReader, CompleteWriter};
use crate::ports::control::{AckReader, AckWriter, ControlReader, ControlWriter};
use crate::ports::document::{DocumentPublisher, DocumentReader};
use crate::ports::frames::reader::FrameReader;
use crate::ports::frames::writer::{FramePublisher, FrameService};
use crate::ports::gpu::{
    GpuDevice, GpuFrameReader, GpuMemory, GpuOffer, GpuPlaces, GpuResultPublisher, GpuResultReader,
    GpuSample, GpuServer, fetch, offer,
};
use crate::ports::render::{RenderClient, RenderServer};
use crate::ports::results::reader::ResultReader;
use crate::ports::results::service::ResultService;
use crate::ports::results::writer::ResultPublisher;
use crate::ports::scene::{RenderedReader, RenderedWriter, ScenePublisher, SceneReader};
use crate::ports::snapshot::{SnapshotPublisher, SnapshotReader};
use crate::time::claim::Claim;

/// Shared memory that a service or a port takes besides its segment, bytes: what its error names.
const PORT_BYTES: u64 = 1 << 16;

/// A process's place on the bus, from which it opens ports. Whatever it opens while `/dev/shm` is
/// full is refused with [`BusError::Memory`].
#[derive(Debug)]
pub struct Bus {
    node: BusNode,
}

impl Bus {
    /// Joins `domain` as `program`, a name for lists and messages.
    ///
    /// # Errors
    /// [`BusError::Domain`] for a name that cannot be part of a service name, [`BusError::Node`] if
    /// shared memory is not usable.
    pub fn open(domain: &str, program: &str) -> Result<Bus, BusError> {
        Self::open_with(domain, program, &BusOptions::default())
    }

    /// Like [`Bus::open`], with iceoryx2's files in a place of their own.
    ///
    /// # Errors
    /// As [`Bus::open`], and [`BusError::Option`] for an unusable root or prefix.
    pub fn open_with(domain: &str, program: &str, options: &BusOptions) -> Result<Bus, BusError> {
        Ok(Bus {
            node: BusNode::open(domain, program, options)?,
        })
    }

    /// Opens something that takes shared memory of its own: an error if that is missing.
    fn guarded<T>(
        &self,
        name: &str,
        open: impl FnOnce() -> Result<T, BusError>,
    ) -> Result<T, BusError> {
        guarded(name, PORT_BYTES, open)
    }

    /// The domain.
    pub fn domain(&self) -> &str {
        self.node.domain()
    }

    /// Removes what killed processes left behind. Returns the number of these processes.
    pub fn clean_dead_nodes(&self) -> u64 {
        self.node.clean_dead_nodes()
    }

    /// Names of the programs that are running, on every domain that shares iceoryx2's files with
    /// this one.
    pub fn programs(&self) -> Vec<String> {
        self.node.programs()
    }

    /// Whether the publish-subscribe topic exists. Much cheaper than a failed opening, whose error
    /// lists the topics that exist.
    pub fn exists(&self, topic: &str) -> bool {
        self.node.exists(topic)
    }

    /// Whether a living process publishes `topic`, a document such as [`names::WORLD_INFO`].
    /// Removes what killed processes left behind first.
    ///
    /// # Errors
    /// [`BusError`] if the service exists and cannot be opened.
    pub fn publisher_alive(&self, topic: &str) -> Result<bool, BusError> {
        self.clean_dead_nodes();
        is_published::<DocumentHeader>(&self.node, topic)
    }

    /// Whether the domain has a daemon: `world/info` has a living publisher. A second daemon
    /// refuses to start by this.
    ///
    /// # Errors
    /// As [`Bus::publisher_alive`].
    pub fn daemon_alive(&self) -> Result<bool, BusError> {
        self.publisher_alive(names::WORLD_INFO)
    }

    /// Takes the right to publish this domain's world: of several processes that ask at once, one
    /// gets it. `None` if a living process has it. Removes what killed processes left behind first.
    ///
    /// # Errors
    /// [`BusError::Permission`], [`BusError::Service`].
    pub fn claim_world(&self) -> Result<Option<Claim>, BusError> {
        self.guarded(names::CONTROL_OWNER, || Claim::take(&self.node))
    }

    /// All publish-subscribe topics of this domain by name.
    ///
    /// # Errors
    /// [`BusError::Service`] if iceoryx2 cannot list.
    pub fn topics(&self) -> Result<Vec<TopicDetails>, BusError> {
        self.guarded("the list of topics", || topics(&self.node))
    }

    /// All services of this domain by name, with the processes that have them open. It opens no
    /// port and starts nothing, so looking every second disturbs nobody.
    ///
    /// # Errors
    /// [`BusError::Service`] if iceoryx2 cannot list.
    pub fn services(&self) -> Result<Vec<ServicePorts>, BusError> {
        self.guarded("the list of services", || services(&self.node))
    }

    /// A look at the newest sample of every writer, without reading.
    pub fn watch(&self) -> Watch {
        Watch::new(&self.node)
    }

    /// Opens a topic of any types for reading its samples as bytes.
    ///
    /// # Errors
    /// [`BusError::NoSuchTopic`], [`BusError::TooManyReaders`], [`BusError::Service`].
    pub fn any_reader(&self, topic: &str) -> Result<AnyReader, BusError> {
        self.guarded(topic, || AnyReader::open(&self.node, topic))
    }

    /// Opens an event for notifying, and makes it if it does not exist.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn notifier(&self, name: &str) -> Result<Notifier, BusError> {
        self.guarded(name, || Notifier::open(&self.node, name))
    }

    /// Opens an event for waiting, and makes it if it does not exist.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn listener(&self, name: &str) -> Result<Listener, BusError> {
        self.guarded(name, || Listener::open(&self.node, name))
    }

    /// Makes the service of `topic` (`<rig>/<sensor>/<modality>`) without memory. Readers can find
    /// and open it.
    ///
    /// # Errors
    /// [`BusError::Name`] if the last segment is not a modality, [`BusError::Capacity`] or
    /// [`BusError::SchemaSkew`] if readers keep an older service alive that does not fit.
    pub fn frame_service(&self, topic: &str, spec: FrameTopic) -> Result<FrameService, BusError> {
        self.guarded(topic, || FrameService::make(&self.node, topic, spec))
    }

    /// Makes the service of `topic` with its memory.
    ///
    /// # Errors
    /// As [`Bus::frame_service`] and [`FrameService::publisher`].
    pub fn frame_publisher(
        &self,
        topic: &str,
        spec: FrameTopic,
    ) -> Result<FramePublisher, BusError> {
        self.frame_service(topic, spec)?.publisher()
    }

    /// Opens a frame topic for reading. The writer starts to render for the first reader within one
    /// tick.
    ///
    /// # Errors
    /// [`BusError::NoSuchTopic`] if no process has made it, [`BusError::SchemaSkew`],
    /// [`BusError::TooManyReaders`].
    pub fn frame_reader(&self, topic: &str) -> Result<FrameReader, BusError> {
        self.guarded(topic, || FrameReader::open(&self.node, topic))
    }

    /// Answers readers that ask for frames on `device`: see [`GpuServer`].
    ///
    /// # Errors
    /// The socket cannot be made below iceoryx2's root.
    pub fn gpu_server(&self, device: GpuDevice) -> std::io::Result<GpuServer> {
        GpuServer::start(&self.node, device)
    }

    /// Looks for the process that keeps `topic` (`ego/front/rgb`) on a GPU, and says which GPU that
    /// is. The process has the topic's GPU service from then on, and memory for it once it is read.
    ///
    /// # Errors
    /// [`BusError::Gpu`] if there is none.
    pub fn gpu_offer(&self, topic: &str) -> Result<GpuOffer, BusError> {
        let offer = offer(&self.node, topic)?;
        // A world that stands still looks at what it was asked for, too.
        self.notifier(names::CONTROL_WAKE)?.notify_listeners();
        Ok(offer)
    }

    /// Opens a topic that is kept on a GPU for reading.
    ///
    /// # Errors
    /// As [`Bus::frame_reader`].
    pub fn gpu_reader(&self, topic: &str, offer: &GpuOffer) -> Result<GpuFrameReader, BusError> {
        self.guarded(topic, || GpuFrameReader::open(&self.node, topic, offer))
    }

    /// The memory that a sample is in, from the process that wrote it; see
    /// [`GpuSample::check_memory`].
    ///
    /// # Errors
    /// [`BusError::Gpu`] if the process has ended or has given the memory back,
    /// [`BusError::GpuMemory`] if it is not what the frame says.
    pub fn gpu_memory(&self, sample: &impl GpuSample) -> Result<GpuMemory, BusError> {
        let place = sample.place();
        let memory = fetch(&self.node, sample.topic(), place.producer, place.generation)?;
        sample.check_memory(&memory)?;
        Ok(memory)
    }

    /// Opens a topic of results for writing them on a GPU, and in shared memory while somebody
    /// reads them there.
    ///
    /// # Errors
    /// As [`Bus::result_publisher`], [`BusError::Description`] for a type that is no array,
    /// [`BusError::Gpu`] if the socket cannot be made.
    pub fn gpu_result_publisher(
        &self,
        topic: &str,
        spec: &ResultTopic,
        places: GpuPlaces,
        device: GpuDevice,
    ) -> Result<GpuResultPublisher, BusError> {
        self.guarded(topic, || {
            GpuResultPublisher::open(&self.node, topic, spec, places, device)
        })
    }

    /// Opens results that are kept on a GPU for reading.
    ///
    /// # Errors
    /// As [`Bus::result_reader`].
    pub fn gpu_result_reader(
        &self,
        topic: &str,
        kind: ResultType,
        offer: &GpuOffer,
    ) -> Result<GpuResultReader, BusError> {
        self.guarded(topic, || {
            GpuResultReader::open(&self.node, topic, kind, offer)
        })
    }

    /// Type of the results of a topic; `None` if it does not exist or carries something else.
    pub fn result_kind(&self, topic: &str) -> Option<ResultType> {
        ResultService::kind_of(&self.node, topic)
    }

    /// Makes a topic of results without a writer, or joins it with the capacities that it has, and
    /// keeps it for as long as the service is kept: readers can come before the writer.
    ///
    /// # Errors
    /// [`BusError::Reserved`], [`BusError::OtherKind`] if the topic exists with another type,
    /// [`BusError::Description`].
    pub fn result_service(
        &self,
        topic: &str,
        spec: &ResultTopic,
    ) -> Result<ResultService, BusError> {
        self.guarded(topic, || ResultService::make(&self.node, topic, spec))
    }

    /// Opens a topic of results for writing, and makes it if it does not exist.
    ///
    /// # Errors
    /// As [`Bus::result_service`], [`BusError::TopicTaken`] if another process writes it,
    /// [`BusError::Memory`] if `/dev/shm` has no room.
    pub fn result_publisher(
        &self,
        topic: &str,
        spec: &ResultTopic,
    ) -> Result<ResultPublisher, BusError> {
        self.guarded(topic, || ResultPublisher::open(&self.node, topic, spec))
    }

    /// Gives a topic of results another description. Its port stays as it is: samples of a port that
    /// ends are lost for readers that have not looked yet.
    ///
    /// # Errors
    /// As [`Bus::result_service`], [`BusError::Memory`] if `/dev/shm` has no room.
    pub fn describe_results(
        &self,
        publisher: &ResultPublisher,
        about: &About,
    ) -> Result<(), BusError> {
        self.guarded(publisher.topic(), || publisher.describe(&self.node, about))
    }

    /// Opens a topic of results for reading.
    ///
    /// # Errors
    /// [`BusError::NoSuchTopic`] if no process has made it, [`BusError::OtherKind`] if it carries
    /// something else, [`BusError::SchemaSkew`], [`BusError::TooManyReaders`].
    pub fn result_reader(&self, topic: &str) -> Result<ResultReader, BusError> {
        self.guarded(topic, || ResultReader::open(&self.node, topic))
    }

    /// Opens `world/snapshot` for writing, for up to `max_actors` records.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn snapshot_publisher(&self, max_actors: usize) -> Result<SnapshotPublisher, BusError> {
        self.guarded(names::WORLD_SNAPSHOT, || {
            SnapshotPublisher::open(&self.node, max_actors)
        })
    }

    /// Opens `world/snapshot` for reading. The newest snapshot arrives within one turn of the
    /// daemon's loop.
    ///
    /// # Errors
    /// [`BusError::NoSuchTopic`] if no daemon ran yet.
    pub fn snapshot_reader(&self) -> Result<SnapshotReader, BusError> {
        self.guarded(names::WORLD_SNAPSHOT, || SnapshotReader::open(&self.node))
    }

    /// Opens a document for writing, e.g. [`crate::names::WORLD_INFO`].
    ///
    /// # Errors
    /// [`BusError`].
    pub fn document_publisher(&self, name: &str) -> Result<DocumentPublisher, BusError> {
        self.guarded(name, || DocumentPublisher::open(&self.node, name))
    }

    /// Opens a document for reading. The newest text arrives within one turn of the daemon's loop.
    ///
    /// # Errors
    /// [`BusError::NoSuchTopic`] if no process has made it yet.
    pub fn document_reader(&self, name: &str) -> Result<DocumentReader, BusError> {
        self.guarded(name, || DocumentReader::open(&self.node, name))
    }

    /// Opens `control/vehicles` for writing under a name. Of several controls for one actor the
    /// last one by (name, seq) counts.
    ///
    /// # Errors
    /// [`BusError::TooManyWriters`] beyond 32 writers.
    pub fn control_writer(&self, name: &str) -> Result<ControlWriter, BusError> {
        self.guarded(names::CONTROL_VEHICLES, || {
            ControlWriter::open(&self.node, name)
        })
    }

    /// Opens `control/vehicles` for reading, as the daemon does.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn control_reader(&self) -> Result<ControlReader, BusError> {
        self.guarded(names::CONTROL_VEHICLES, || ControlReader::open(&self.node))
    }

    /// Opens `control/ack` for writing, as the lockstep participant `name`.
    ///
    /// # Errors
    /// [`BusError::TooManyWriters`] beyond 32 writers.
    pub fn ack_writer(&self, name: &str) -> Result<AckWriter, BusError> {
        self.guarded(names::CONTROL_ACK, || AckWriter::open(&self.node, name))
    }

    /// Opens `control/ack` for reading, as the daemon does.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn ack_reader(&self) -> Result<AckReader, BusError> {
        self.guarded(names::CONTROL_ACK, || AckReader::open(&self.node))
    }

    /// Opens `world/complete` for writing, as the process that publishes the world.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn complete_writer(&self) -> Result<CompleteWriter, BusError> {
        self.guarded(names::WORLD_COMPLETE, || {
            CompleteWriter::open(&self.node, "world")
        })
    }

    /// Opens `world/complete` for reading.
    ///
    /// # Errors
    /// [`BusError::TooManyReaders`] beyond 32 readers.
    pub fn complete_reader(&self) -> Result<CompleteReader, BusError> {
        self.guarded(names::WORLD_COMPLETE, || CompleteReader::open(&self.node))
    }

    /// Opens `control/world` as a client. Requests that meet between two ticks run by (name, seq).
    ///
    /// # Errors
    /// [`BusError`].
    pub fn command_client(&self, name: &str) -> Result<CommandClient, BusError> {
        self.guarded(names::CONTROL_WORLD, || {
            CommandClient::open(&self.node, name)
        })
    }

    /// Opens `control/world` as the server.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn command_server(&self) -> Result<CommandServer, BusError> {
        self.guarded(names::CONTROL_WORLD, || CommandServer::open(&self.node))
    }

    /// Opens `control/scene` for writing, as the simulator does.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn scene_publisher(&self) -> Result<ScenePublisher, BusError> {
        self.guarded(names::CONTROL_SCENE, || ScenePublisher::open(&self.node))
    }

    /// Opens `control/scene` for reading, as a render worker does, and makes it if it does not
    /// exist.
    ///
    /// # Errors
    /// [`BusError::TooManyReaders`] beyond 16 workers.
    pub fn scene_reader(&self) -> Result<SceneReader, BusError> {
        self.guarded(names::CONTROL_SCENE, || SceneReader::open(&self.node))
    }

    /// Opens `control/rendered` for writing, as the render worker `name`.
    ///
    /// # Errors
    /// [`BusError::TooManyWriters`] beyond 16 workers.
    pub fn rendered_writer(&self, name: &str) -> Result<RenderedWriter, BusError> {
        self.guarded(names::CONTROL_RENDERED, || {
            RenderedWriter::open(&self.node, name)
        })
    }

    /// Opens `control/rendered` for reading, as the simulator does.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn rendered_reader(&self) -> Result<RenderedReader, BusError> {
        self.guarded(names::CONTROL_RENDERED, || RenderedReader::open(&self.node))
    }

    /// Opens `control/render` as a worker.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn render_client(&self) -> Result<RenderClient, BusError> {
        self.guarded(names::CONTROL_RENDER, || RenderClient::open(&self.node))
    }

    /// Opens `control/render` as the simulator.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn render_server(&self) -> Result<RenderServer, BusError> {
        self.guarded(names::CONTROL_RENDER, || RenderServer::open(&self.node))
    }
}
