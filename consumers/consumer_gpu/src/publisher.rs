//! The writing end of a topic of results on a GPU: bodies are copied within the device, or made in
//! place, and only their places cross to the readers.
//!
//! The memory is made for the first body, or before, and again for a longer one. Readers ask for
//! its descriptor when they meet the first result in it, so it stays exported until every slot that
//! was sent in it has come back. What is read in shared memory is a copy of the same bytes.

use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard};
use schema_bus::{
    Bus, GpuDevice, GpuPlaces, GpuResultPublisher, GpuResultSlot, ResultDraft, ResultTopic,
    SharedMemory,
};
use schema_frames::{GpuAnswer, GpuPlace, ResultType};

use crate::cuda::Cuda;
use crate::device::{Device, writers_device};
use crate::error::GpuError;
use crate::shared::{self, SharedRange};
use crate::stream::Stream;

/// Slots begin at multiples of this, bytes: what every GPU reads fastest.
const SLOT_ALIGN_BYTES: usize = 256;

/// The writing end of a topic of results on a GPU.
#[derive(Debug)]
pub struct GpuPublisher {
    // Memory goes before the socket that hands it out.
    state: Mutex<State>,
    port: GpuResultPublisher,
    stream: Stream,
    cuda: Arc<Cuda>,
    first_bytes: usize,
}

#[derive(Debug, Default)]
struct State {
    current: Option<Arc<SlotMemory>>,
    /// By slot: the memory of what was sent in it last. Readers may not have imported it yet.
    sent: Vec<Option<Arc<SlotMemory>>>,
}

/// Memory of all slots of a topic.
#[derive(Debug)]
pub struct SlotMemory {
    // Nobody gets the descriptor of memory that is being given back.
    exported: SharedMemory,
    range: SharedRange,
    slot_bytes: usize,
}

/// Where the bytes of a result are.
#[derive(Clone, Copy, Debug)]
pub enum Body<'a> {
    /// At this address of the device.
    Device(u64),
    /// In this process's memory.
    Host(&'a [u8]),
}

/// A slot on the GPU that is borrowed for writing: its memory is this process's alone until it is
/// sent. Dropped, it goes back after what the device was given until then.
#[derive(Debug)]
pub struct GpuLoan {
    slot: Option<GpuResultSlot>,
    memory: Arc<SlotMemory>,
    cuda: Arc<Cuda>,
    address: u64,
    n_bytes: usize,
}

impl GpuPublisher {
    /// Opens a topic of results for writing on a device, and makes it if it does not exist. With
    /// `first_bytes` above 0, memory for bodies of this length is made at once.
    ///
    /// # Errors
    /// As [`Bus::gpu_result_publisher`], [`GpuError::NoCuda`], [`GpuError::Room`].
    pub fn open(
        bus: &Bus,
        topic: &str,
        spec: &ResultTopic,
        places: GpuPlaces,
        first_bytes: usize,
        device: Device,
    ) -> Result<GpuPublisher, GpuError> {
        let (cuda, found) = writers_device(topic, device)?;
        let device = GpuDevice {
            device_uuid: found.uuid,
            driver_uuid: [0; 16],
            is_mappable: false,
        };
        let publisher = GpuPublisher {
            state: Mutex::default(),
            port: bus.gpu_result_publisher(topic, spec, places, device)?,
            stream: Stream::new(&cuda)?,
            cuda,
            first_bytes,
        };
        if first_bytes > 0 {
            publisher.memory_for(&mut publisher.state.lock(), first_bytes)?;
        }
        Ok(publisher)
    }

    /// Name without the domain.
    pub fn topic(&self) -> &str {
        self.port.topic()
    }

    /// Type of its results.
    pub fn kind(&self) -> ResultType {
        self.port.kind()
    }

    /// Number of CUDA's device.
    pub fn device(&self) -> i32 {
        self.cuda.ordinal
    }

    /// Number of readers now, on the GPU and in shared memory.
    pub fn n_readers(&self) -> usize {
        self.port.n_gpu_readers() + self.port.n_host_readers()
    }

    /// Memory of the device that it has for its slots now, bytes.
    pub fn n_device_bytes(&self) -> u64 {
        let state = self.state.lock();
        let current = state.current.as_ref();
        current.map_or(0, |memory| memory.exported.n_bytes())
    }

    /// Address of the stream on which bodies are copied. Whoever made a body lets this stream wait
    /// for it, and need not wait itself.
    pub fn stream(&self) -> u64 {
        self.stream.address()
    }

    /// Lets that stream wait for everything that this process has given the device so far.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn wait_for_work(&self) -> Result<(), GpuError> {
        match self.cuda.sees_all_streams() {
            true => self.stream.after(&self.cuda.now(0)?),
            false => self.cuda.wait_for_all(),
        }
    }

    /// A result of this topic's type that says nothing yet.
    pub fn draft(&self) -> ResultDraft {
        ResultDraft::new(self.kind())
    }

    /// Copies a body into a slot on the GPU if somebody reads there, and into shared memory if
    /// somebody reads there, and sends it once it is complete. Returns the number of readers that
    /// received it.
    ///
    /// # Errors
    /// [`GpuError::Loan`] if all slots are loaned, [`GpuError::Room`], [`GpuError::Cuda`],
    /// [`GpuError::Bus`] if the draft contradicts itself.
    ///
    /// # Safety
    /// A body on the device is memory of this device, as long as the draft's `body_bytes`, until
    /// this returns; it is complete once [`GpuPublisher::stream`] has waited for what it was told.
    pub unsafe fn send(&self, mut draft: ResultDraft, body: Body<'_>) -> Result<usize, GpuError> {
        let n_bytes = draft.header().body_bytes as usize;
        if let Body::Host(bytes) = body
            && bytes.len() != n_bytes
        {
            return Err(GpuError::Memory {
                topic: self.topic().into(),
                fault: format!("{} bytes are given for a body of {n_bytes}", bytes.len()),
            });
        }
        let mut state = self.state.lock();
        let is_read_in_host = self.port.n_host_readers() > 0;
        let slot = match self.port.n_gpu_readers() {
            0 => None,
            _ => {
                let loan = self.take_slot(&mut state, n_bytes)?;
                match body {
                    // SAFETY: promised by the caller; the slot is nobody else's.
                    Body::Device(from) if n_bytes > 0 => unsafe {
                        self.stream.copy(from, loan.address, n_bytes)?;
                    },
                    // SAFETY: the slot is nobody else's.
                    Body::Host(bytes) if n_bytes > 0 => unsafe {
                        self.stream.upload(bytes, loan.address)?;
                    },
                    _ => {}
                }
                self.stream.wait()?;
                Some(loan)
            }
        };
        self.port.number(&mut draft);
        let mut n_readers = 0;
        if let Some(loan) = slot {
            n_readers += self.send_slot(&mut state, loan, &draft)?;
        }
        if is_read_in_host {
            n_readers += self.send_to_host(&draft, body)?;
        }
        Ok(n_readers)
    }

    /// Loans a slot for a body of up to `n_bytes`, to be filled by the device and sent.
    ///
    /// # Errors
    /// As [`GpuPublisher::send`].
    pub fn loan(&self, n_bytes: usize) -> Result<GpuLoan, GpuError> {
        self.take_slot(&mut self.state.lock(), n_bytes)
    }

    /// Waits until the device has done what this process gave it, and sends a slot. Returns the
    /// number of readers that received it.
    ///
    /// # Errors
    /// As [`GpuPublisher::send`].
    pub fn send_loan(&self, loan: GpuLoan, mut draft: ResultDraft) -> Result<usize, GpuError> {
        let n_bytes = draft.header().body_bytes;
        if n_bytes > loan.n_bytes as u64 {
            return Err(GpuError::Memory {
                topic: self.topic().into(),
                fault: format!(
                    "its body has {n_bytes} bytes, but {} were loaned",
                    loan.n_bytes
                ),
            });
        }
        self.cuda.wait_for_all()?;
        let mut state = self.state.lock();
        let body = Body::Device(loan.address);
        let is_read_in_host = self.port.n_host_readers() > 0;
        self.port.number(&mut draft);
        let mut n_readers = 0;
        // A slot that was sent stays as it is while the lock is held, because it is needed for the
        // next loan.
        let kept = match self.port.n_gpu_readers() {
            0 => Some(loan),
            _ => {
                n_readers += self.send_slot(&mut state, loan, &draft)?;
                None
            }
        };
        if is_read_in_host {
            n_readers += self.send_to_host(&draft, body)?;
        }
        drop(state);
        drop(kept);
        Ok(n_readers)
    }

    fn send_slot(
        &self,
        state: &mut MutexGuard<'_, State>,
        mut loan: GpuLoan,
        draft: &ResultDraft,
    ) -> Result<usize, GpuError> {
        let slot = loan.slot.take().expect("only this and drop take it");
        let number = slot.number();
        let place = loan.memory.place_of(number);
        let n_readers = self.port.send(slot, &place, draft)?;
        state.sent[number] = Some(loan.memory.clone());
        Ok(n_readers)
    }

    fn send_to_host(&self, draft: &ResultDraft, body: Body<'_>) -> Result<usize, GpuError> {
        let n_bytes = draft.header().body_bytes as usize;
        let mut loan = self.port.host_loan(n_bytes)?;
        match body {
            Body::Host(bytes) => loan.body_mut().copy_from_slice(bytes),
            Body::Device(_) if n_bytes == 0 => {}
            // SAFETY: the caller's body or a slot that nobody is loaned; both stay as they are.
            Body::Device(from) => unsafe { self.stream.download(from, loan.body_mut())? },
        }
        Ok(loan.send_as(draft)?)
    }

    fn take_slot(
        &self,
        state: &mut MutexGuard<'_, State>,
        n_bytes: usize,
    ) -> Result<GpuLoan, GpuError> {
        let memory = self.memory_for(state, n_bytes)?;
        let slot = self.port.loan()?;
        let number = slot.number();
        if state.sent.len() <= number {
            state.sent.resize(number + 1, None);
        }
        // What was sent in it before has come back from everybody.
        state.sent[number] = None;
        Ok(GpuLoan {
            address: memory.range.address + memory.offset_of(number),
            cuda: self.cuda.clone(),
            slot: Some(slot),
            memory,
            n_bytes,
        })
    }

    /// Memory whose slots hold `n_bytes`.
    fn memory_for(
        &self,
        state: &mut MutexGuard<'_, State>,
        n_bytes: usize,
    ) -> Result<Arc<SlotMemory>, GpuError> {
        if let Some(memory) = &state.current
            && memory.slot_bytes >= n_bytes
        {
            return Ok(memory.clone());
        }
        // Results that got longer once do so again.
        let wanted = match &state.current {
            None => n_bytes.max(self.first_bytes),
            Some(_) => n_bytes.checked_next_power_of_two().unwrap_or(n_bytes),
        };
        let made = match self.make(wanted) {
            Err(GpuError::Room { .. }) if wanted > n_bytes => self.make(n_bytes),
            made => made,
        };
        let memory = Arc::new(made?);
        state.current = Some(memory.clone());
        Ok(memory)
    }

    fn make(&self, n_bytes: usize) -> Result<SlotMemory, GpuError> {
        let n_slots = self.port.n_slots();
        let aligned = n_bytes.max(1).checked_next_multiple_of(SLOT_ALIGN_BYTES);
        // What no address can reach has no room either.
        let slot_bytes = aligned.unwrap_or(usize::MAX);
        let too_large = |free_bytes, all_bytes| GpuError::Room {
            topic: self.topic().into(),
            n_slots,
            slot_bytes: slot_bytes as u64,
            free_bytes,
            all_bytes,
        };
        let room = shared::room(&self.cuda)?;
        let none = || too_large(room.free_bytes, room.all_bytes);
        let whole = slot_bytes.checked_mul(n_slots).ok_or_else(none)?;
        let whole = shared::rounded(&self.cuda, whole)?;
        if whole as u64 > room.free_bytes {
            return Err(none());
        }
        let (range, descriptor) = shared::make(&self.cuda, whole)?;
        let server = self.port.server();
        let exported = server.share(descriptor, whole as u64, GpuAnswer::CUDA);
        Ok(SlotMemory {
            exported: exported.map_err(|error| GpuError::Memory {
                topic: self.topic().into(),
                fault: format!("it has no number to be asked for by ({error})"),
            })?,
            range,
            slot_bytes,
        })
    }
}

impl SlotMemory {
    fn offset_of(&self, slot: usize) -> u64 {
        (slot * self.slot_bytes) as u64
    }

    fn place_of(&self, slot: usize) -> GpuPlace {
        GpuPlace {
            producer: self.exported.producer(),
            generation: self.exported.generation(),
            offset_bytes: self.offset_of(slot),
            memory_bytes: self.exported.n_bytes(),
            capacity_bytes: self.slot_bytes as u64,
            pid: std::process::id(),
            slot: slot as u32,
            reserved: [0; 16],
        }
    }
}

impl GpuLoan {
    /// Address of its first byte on the device.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Bytes of room for the body.
    pub fn room(&self) -> usize {
        self.n_bytes
    }

    /// Number of CUDA's device.
    pub fn device(&self) -> i32 {
        self.cuda.ordinal
    }

    /// What keeps its memory in place, for tensors that outlive it. They must not be written to
    /// once it is sent.
    pub fn memory(&self) -> Arc<SlotMemory> {
        self.memory.clone()
    }
}

impl Drop for GpuLoan {
    fn drop(&mut self) {
        if self.slot.is_some()
            && let Err(error) = self.cuda.wait_for_all()
        {
            tracing::debug!(%error, "the device does nothing any more");
        }
    }
}
