//! The ways that samples come to a GPU: they are there, or they are uploaded.

use std::sync::Arc;

use schema_bus::{Bus, BusError, GpuOffer, GpuSample as _, Reader, ReaderCounts, names};

use crate::cuda::Cuda;
use crate::device::Way;
use crate::error::GpuError;
use crate::kinds::{Kind, Which, take};
use crate::memory::{Found, Memories};
use crate::release::Releases;
use crate::sample::{GivesBack, Held, OnGpu, Slot};
use crate::upload::Uploads;

/// A way that samples come.
#[derive(Debug)]
pub struct Opened<K: Kind> {
    pub port: Port<K>,
    pub device: Option<Arc<Cuda>>,
    /// Name of the event that announces its samples.
    pub event: String,
    /// Why they are uploaded; `None` if they stay on the GPU.
    pub fallback: Option<String>,
}

/// What a look at a port found.
pub enum Taken<K: Kind> {
    Sample(OnGpu<K>),
    Nothing,
    /// A sample on another GPU.
    Elsewhere,
}

/// The reader below.
#[derive(Debug)]
pub enum Port<K: Kind> {
    OnGpu {
        reader: Reader<K::OnGpu>,
        memories: Memories,
        releases: Arc<Releases<Slot<K>>>,
    },
    Uploaded {
        reader: Reader<K::OnHost>,
        uploads: Arc<Uploads>,
        releases: Arc<Releases<GivesBack>>,
    },
}

impl<K: Kind> Port<K> {
    /// Counters, and whether there is a writer.
    pub fn state(&self) -> (ReaderCounts, bool) {
        match self {
            Port::OnGpu { reader, .. } => (reader.counts(), reader.has_writer()),
            Port::Uploaded { reader, .. } => (reader.counts(), reader.has_writer()),
        }
    }
}

impl<K: Kind> Opened<K> {
    /// Opens `topic` on a way that was found with this offer.
    ///
    /// # Errors
    /// Those of the readers below.
    pub fn open(
        bus: &Bus,
        topic: &str,
        way: Way,
        offered: &Result<GpuOffer, BusError>,
    ) -> Result<Opened<K>, GpuError> {
        let on_gpu = |device| -> Result<Opened<K>, GpuError> {
            let offer = offered
                .as_ref()
                .map_err(|why| GpuError::memory(topic, why))?;
            Ok(Opened {
                port: Port::OnGpu {
                    reader: K::open_gpu(bus, topic, offer)?,
                    memories: Memories::default(),
                    releases: Releases::new(),
                },
                device,
                event: names::gpu_topic(topic),
                fallback: None,
            })
        };
        match way {
            Way::Imported(cuda) => on_gpu(Some(cuda)),
            Way::Mapped => on_gpu(None),
            Way::Uploaded(cuda, why) => Ok(Opened {
                port: Port::Uploaded {
                    reader: K::open_host(bus, topic)?,
                    uploads: Uploads::new(cuda.clone()),
                    releases: Releases::new(),
                },
                device: Some(cuda),
                event: topic.to_owned(),
                fallback: Some(why),
            }),
        }
    }

    /// Takes a sample that waits, if any.
    ///
    /// # Errors
    /// As the readers below, [`GpuError::Cuda`].
    pub fn take(&mut self, bus: &Bus, which: Which) -> Result<Taken<K>, GpuError> {
        match &mut self.port {
            Port::OnGpu {
                reader,
                memories,
                releases,
            } => loop {
                let sample = match take(reader, which) {
                    // Samples that only wait for the GPU make room.
                    Err(BusError::BorrowLimit { .. }) if releases.make_room() => continue,
                    taken => taken?,
                };
                let Some(sample) = sample else {
                    // Between two samples, where nobody waits for it.
                    releases.sweep();
                    return Ok(Taken::Nothing);
                };
                let memory = match memories.of::<K>(bus, &sample, self.device.as_ref())? {
                    Found::Here(memory) => memory,
                    Found::Elsewhere => return Ok(Taken::Elsewhere),
                    Found::Gone => {
                        reader.forget_last();
                        continue;
                    }
                };
                let address = memory.address() + sample.place().offset_bytes;
                let held = Held::Slot {
                    slot: Some(Slot {
                        sample,
                        _memory: memory,
                    }),
                    releases: releases.clone(),
                };
                return Ok(Taken::Sample(OnGpu::new(
                    address,
                    self.device.clone(),
                    held,
                )));
            },
            Port::Uploaded {
                reader,
                uploads,
                releases,
            } => {
                let Some(sample) = take(reader, which)? else {
                    releases.sweep();
                    return Ok(Taken::Nothing);
                };
                releases.sweep();
                let staged = uploads.upload(&sample)?;
                let address = staged.address;
                let held = Held::Upload {
                    about: Box::new(K::about(&sample)),
                    staged: Some(GivesBack {
                        staged: Some(staged),
                        uploads: uploads.clone(),
                    }),
                    releases: releases.clone(),
                };
                Ok(Taken::Sample(OnGpu::new(
                    address,
                    self.device.clone(),
                    held,
                )))
            }
        }
    }
}
