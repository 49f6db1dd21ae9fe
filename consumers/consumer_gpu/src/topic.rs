//! A topic's samples on a GPU, whichever way they come there.

use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, GpuOffer, Listener, ReaderCounts, names};
use schema_frames::ResultType;

use crate::device::{Device, Way, find_way};
use crate::error::GpuError;
use crate::kinds::{Frames, Kind, Results, Which};
use crate::port::{Opened, Port, Taken};
use crate::sample::{Held, OnGpu};
use crate::watch::{LOOK, Watch};

/// The reading end of a topic on a GPU. It follows the topic when another process writes it: samples
/// stay on the GPU if that process has them on the same one, and are uploaded otherwise.
#[derive(Debug)]
pub struct Topic<K: Kind> {
    topic: String,
    /// The device, by its number once it is known: samples never change it.
    wish: Device,
    opened: Opened<K>,
    listener: Listener,
    watch: Watch,
    /// Port that wrote the last sample that was uploaded.
    writer: Option<u128>,
    /// Epoch, tick and number of the last sample.
    last: Option<(u64, u64, u64)>,
    /// Whether no sample came yet the way that they come now.
    is_switched: bool,
    has_moved: bool,
    /// Counters of the ports before this one.
    counts_before: ReaderCounts,
}

/// The reading end of a topic of frames on a GPU.
pub type GpuTopic = Topic<Frames>;
/// The reading end of a topic of results on a GPU.
pub type GpuResults = Topic<Results>;

impl<K: Kind> Topic<K> {
    /// Opens `topic` (`ego/front/rgb`) on a device. Where its samples are not made on that device,
    /// they are uploaded to it, and [`Topic::fallback`] says why.
    ///
    /// # Errors
    /// [`GpuError::NoCuda`], [`GpuError::Memory`] if the device cannot be used, those of
    /// [`Bus::frame_reader`] or [`Bus::result_reader`].
    pub fn open(bus: &Bus, topic: &str, device: Device) -> Result<Topic<K>, GpuError> {
        let topic = names::host_topic(topic);
        // Without the topic there is nothing to fall back to.
        if !bus.exists(topic) {
            K::open_host(bus, topic)?;
        }
        let offered = bus.gpu_offer(topic);
        let way = find_way(topic, device, &offered)?;
        let opened = Opened::open(bus, topic, way, &offered)?;
        let number = opened.device.as_ref().map(|device| device.ordinal);
        Ok(Topic {
            topic: topic.to_owned(),
            wish: number.map_or(device, Device::CudaNumber),
            listener: bus.listener(&opened.event)?,
            opened,
            watch: Watch::new(),
            writer: None,
            last: None,
            is_switched: false,
            has_moved: false,
            counts_before: ReaderCounts::default(),
        })
    }

    /// Why samples are uploaded instead of staying on the GPU; `None` if they stay. That changes
    /// when a process on another GPU writes the topic.
    pub fn fallback(&self) -> Option<&str> {
        self.opened.fallback.as_deref()
    }

    /// Number of CUDA's device; `None` if samples are mapped.
    pub fn device(&self) -> Option<i32> {
        self.opened.device.as_ref().map(|device| device.ordinal)
    }

    /// Name of the event that announces its samples. Whoever waits for it looks at least twice a
    /// second all the same, because a writer that ends announces nothing.
    pub fn event(&self) -> &str {
        &self.opened.event
    }

    /// Whether event and fallback may be others than at the last call.
    pub fn has_moved(&mut self) -> bool {
        std::mem::take(&mut self.has_moved)
    }

    /// Takes the oldest sample that waits, if any.
    ///
    /// # Errors
    /// As [`schema_bus::FrameReader::next`], [`GpuError::Cuda`].
    pub fn next(&mut self, bus: &Bus) -> Result<Option<OnGpu<K>>, GpuError> {
        self.take(bus, Which::Oldest)
    }

    /// Takes the newest sample that waits, if any.
    ///
    /// # Errors
    /// As [`Topic::next`].
    pub fn latest(&mut self, bus: &Bus) -> Result<Option<OnGpu<K>>, GpuError> {
        self.take(bus, Which::Newest)
    }

    /// Waits for the newest sample, at most `timeout`.
    ///
    /// # Errors
    /// As [`Topic::next`].
    pub fn wait(&mut self, bus: &Bus, timeout: Duration) -> Result<Option<OnGpu<K>>, GpuError> {
        let deadline = Instant::now() + timeout;
        loop {
            self.listener.drain()?;
            if let Some(sample) = self.latest(bus)? {
                return Ok(Some(sample));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return Ok(None);
            }
            self.listener.wait_pending(rest.min(LOOK));
        }
    }

    /// Counters since it was opened.
    pub fn counts(&self) -> ReaderCounts {
        let (now, before) = (self.opened.port.state().0, self.counts_before);
        ReaderCounts {
            taken: now.taken + before.taken,
            skipped: now.skipped + before.skipped,
            lost: now.lost + before.lost,
            refused: now.refused + before.refused,
            restarts: now.restarts + before.restarts,
        }
    }

    /// Whether a process writes it now.
    pub fn has_writer(&self) -> bool {
        self.opened.port.state().1
    }

    fn take(&mut self, bus: &Bus, which: Which) -> Result<Option<OnGpu<K>>, GpuError> {
        loop {
            match self.opened.take(bus, which)? {
                Taken::Sample(sample) => {
                    self.follow_writer(bus, &sample);
                    if self.is_next(K::moment(sample.sample())) {
                        return Ok(Some(sample));
                    }
                }
                Taken::Elsewhere => {
                    let (way, offered) = self.find_way(bus)?;
                    if matches!(way, Way::Uploaded(..)) {
                        self.switch(bus, way, &offered)?;
                    }
                }
                Taken::Nothing => {
                    self.look_for_writer(bus)?;
                    return Ok(None);
                }
            }
        }
    }

    /// Whether a sample is not one that came another way already; takes note of it then.
    fn is_next(&mut self, moment @ (epoch, tick, seq): (u64, u64, u64)) -> bool {
        if self.is_switched
            && let Some((_, last_tick, last_seq)) = self.last.filter(|last| last.0 == epoch)
        {
            if tick <= last_tick && seq <= last_seq {
                return false;
            }
            self.counts_before.lost += seq.saturating_sub(last_seq + 1);
        }
        self.is_switched = false;
        self.last = Some(moment);
        true
    }

    /// Finds the way that frames can come now.
    fn find_way(&self, bus: &Bus) -> Result<(Way, Result<GpuOffer, BusError>), GpuError> {
        let offered = bus.gpu_offer(&self.topic);
        let way = find_way(&self.topic, self.wish, &offered)?;
        Ok((way, offered))
    }

    /// Lets frames come another way.
    fn switch(
        &mut self,
        bus: &Bus,
        way: Way,
        offered: &Result<GpuOffer, BusError>,
    ) -> Result<(), GpuError> {
        let opened = Opened::open(bus, &self.topic, way, offered)?;
        self.listener = bus.listener(&opened.event)?;
        self.counts_before = self.counts();
        let topic = &self.topic;
        match &opened.fallback {
            Some(why) => tracing::warn!(topic, "frames are uploaded from now on: {why}"),
            None => tracing::info!(topic, "frames stay on the GPU again"),
        }
        self.opened = opened;
        self.watch = Watch::new();
        self.writer = None;
        (self.is_switched, self.has_moved) = (true, true);
        Ok(())
    }

    /// Looks, when samples are uploaded that another process has written than those before, whether
    /// they can stay on the GPU.
    fn follow_writer(&mut self, bus: &Bus, sample: &OnGpu<K>) {
        let Held::Upload { about, .. } = &sample.held else {
            return;
        };
        let writer = K::writer(about);
        if self.writer.replace(writer) == Some(writer) {
            return;
        }
        match self.find_way(bus) {
            Ok((Way::Uploaded(_, why), _)) => self.opened.fallback = Some(why),
            Ok((way, offered)) => {
                // All places of the GPU may be taken; frames are uploaded then as before.
                if let Err(error) = self.switch(bus, way, &offered) {
                    tracing::debug!(topic = self.topic, %error, "frames do not stay on the GPU");
                }
            }
            Err(error) => tracing::debug!(topic = self.topic, %error, "no other way is found"),
        }
    }

    /// Looks, when no frame waits, whether somebody still keeps the topic on the GPU.
    fn look_for_writer(&mut self, bus: &Bus) -> Result<(), GpuError> {
        if !matches!(self.opened.port, Port::OnGpu { .. }) || !self.watch.is_due() {
            return Ok(());
        }
        // Without the topic there is nobody to write it, on whatever way.
        if self.has_writer() || !bus.exists(&self.topic) {
            self.watch.is_there();
            return Ok(());
        }
        let offered = bus.gpu_offer(&self.topic);
        if offered.is_err() && (self.wish == Device::Mapped || !self.watch.is_missing_for_long()) {
            return Ok(());
        }
        let way = find_way(&self.topic, self.wish, &offered)?;
        match way {
            Way::Uploaded(..) => self.switch(bus, way, &offered),
            Way::Imported(_) | Way::Mapped => {
                self.watch.is_there();
                Ok(())
            }
        }
    }
}

impl Topic<Results> {
    /// Type of its results.
    pub fn kind(&self) -> ResultType {
        match &self.opened.port {
            Port::OnGpu { reader, .. } => reader.kind(),
            Port::Uploaded { reader, .. } => reader.kind(),
        }
    }
}
