//! Publishes results: a list of records that answers frames, in one call or filled in place.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use schema_bus::{Answerable, Bus, BusError, LoanError, ResultLoan, ResultPublisher, ResultTopic};
use schema_frames::ResultRecord;

/// Why a result was not published.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// No slot was free.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// The result could not be sent.
    #[error(transparent)]
    Bus(#[from] BusError),
}

/// Publishes results that are lists of `T`: boxes, tracks, points of a path.
///
/// ```no_run
/// use consumer_kit::{Follower, MAX_WAIT, Publisher, Take};
/// use schema_frames::Box2d;
///
/// let mut follower = Follower::open("gantry", "detector")?;
/// let camera = follower.follow("ego/front/rgb", Take::Newest);
/// let boxes = Publisher::<Box2d>::open(follower.bus(), "detector/boxes")?;
/// loop {
///     follower.wait(MAX_WAIT)?;
///     while let Some(image) = follower.take(camera)? {
///         let found: Vec<Box2d> = Vec::new(); // what a detector sees in `image`
///         boxes.send(&found, &[&image])?;
///     }
/// }
/// # #[allow(unreachable_code)]
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Publisher<T> {
    publisher: ResultPublisher,
    of: PhantomData<fn(T)>,
}

impl<T: ResultRecord> Publisher<T> {
    /// Opens `topic` (without the domain) with the usual capacities and CARLA's classes.
    ///
    /// # Errors
    /// As [`Bus::result_publisher`].
    pub fn open(bus: &Bus, topic: &str) -> Result<Self, BusError> {
        Self::open_with(bus, topic, ResultTopic::new(T::TYPE))
    }

    /// Opens `topic` as `spec` says; its `kind` is `T`'s whatever it holds.
    ///
    /// # Errors
    /// As [`Bus::result_publisher`].
    pub fn open_with(bus: &Bus, topic: &str, mut spec: ResultTopic) -> Result<Self, BusError> {
        spec.kind = T::TYPE;
        Ok(Publisher {
            publisher: bus.result_publisher(topic, &spec)?,
            of: PhantomData,
        })
    }

    /// Publishes a copy of `records`, which answer `inputs`. Returns the number of readers that
    /// received them.
    ///
    /// # Errors
    /// [`PublishError`].
    pub fn send(&self, records: &[T], inputs: &[&dyn Answerable]) -> Result<usize, PublishError> {
        let mut list = self.loan(records.len())?;
        list.copy_from_slice(records);
        for input in inputs {
            list.answers(*input);
        }
        list.send(records.len())
    }

    /// Loans room for up to `max_records` in shared memory, all zero, to be filled in place.
    ///
    /// # Errors
    /// As [`ResultPublisher::loan`].
    pub fn loan(&self, max_records: usize) -> Result<ListLoan<T>, LoanError> {
        let mut loan = self.publisher.loan(max_records * size_of::<T>())?;
        loan.body_mut().fill(0);
        Ok(ListLoan {
            loan,
            of: PhantomData,
        })
    }

    /// The publisher below, for results with runs or key points behind their records.
    pub fn publisher(&self) -> &ResultPublisher {
        &self.publisher
    }
}

/// A list of records in shared memory that is being filled. It dereferences to the records.
#[derive(Debug)]
pub struct ListLoan<T> {
    loan: ResultLoan,
    of: PhantomData<fn(T)>,
}

impl<T: ResultRecord> ListLoan<T> {
    /// Names a frame or a result that this list was computed from, see [`ResultLoan::answers`].
    pub fn answers(&mut self, input: &dyn Answerable) {
        self.loan.answers(input);
    }

    /// The header, for space, pose and whatever the inputs do not say.
    pub fn header_mut(&mut self) -> &mut schema_frames::ResultHeader {
        self.loan.header_mut()
    }

    /// Sends the first `n` records. Returns the number of readers that received them.
    ///
    /// # Errors
    /// [`PublishError::Bus`] with [`BusError::TooLong`] if `n` is more than the loan holds.
    pub fn send(mut self, n: usize) -> Result<usize, PublishError> {
        self.loan.set_list(n as u32, size_of::<T>() as u32, 0)?;
        Ok(self.loan.send()?)
    }
}

impl<T: ResultRecord> Deref for ListLoan<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        bytemuck::cast_slice(self.loan.body())
    }
}

impl<T: ResultRecord> DerefMut for ListLoan<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        bytemuck::cast_slice_mut(self.loan.body_mut())
    }
}
