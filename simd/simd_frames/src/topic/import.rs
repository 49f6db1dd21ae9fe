//! The one place of the daemon that hands shared memory to the GPU, and takes it back.

#![expect(
    unsafe_code,
    reason = "importing memory is a promise about its lifetime that only the daemon can keep"
)]

use std::sync::Arc;
use std::time::Duration;

use schema_bus::{DeviceLoan, FrameLoan, FramePublisher, Segment};
use sensor_camera::Submission;
use sensor_gpu::{Gpu, GpuError, Place, ShmTarget};

/// How the GPU's frames get into shared memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// The GPU writes into the imported segment, if its driver can import it.
    Imported,
    /// The GPU writes into a buffer of its own, and the CPU copies it once (`--staged`).
    Staged,
}

/// The publisher's whole data segment as a target of copies: imported once, or staged if asked for
/// or if the driver refuses. The target keeps the publisher.
pub fn target(
    gpu: &Gpu,
    segment: &Segment,
    publisher: Arc<FramePublisher>,
    transfer: Transfer,
) -> ShmTarget {
    match transfer {
        // SAFETY: as below.
        Transfer::Staged => unsafe { ShmTarget::staged(segment.base, segment.len, publisher) },
        // SAFETY: the segment stays mapped while its publisher lives, which the target holds.
        Transfer::Imported => unsafe {
            ShmTarget::import(gpu, segment.base, segment.len, publisher)
        },
    }
}

/// A loan as a place that the GPU writes to. The place goes into a submission, the loan beside it
/// into a [`Lent`].
pub fn lend(
    target: &Arc<ShmTarget>,
    loan: FrameLoan,
    capacity_bytes: usize,
) -> (DeviceLoan, Place<'static>) {
    let loan = loan.lend();
    let offset_bytes = loan
        .offset_in_segment()
        .expect("the segment was asked for when the topic was opened");
    // SAFETY: the range is the payload of a loan, which no other loan overlaps. Nobody reaches it
    // through the loan, which `Lent` keeps until the submission has been waited for or dropped.
    let place = unsafe { target.place(offset_bytes, capacity_bytes) };
    (loan, place)
}

/// A submission, and the loans that it writes to. Dropped at any moment, also while a panic unwinds,
/// the submission is waited for before its loans go back.
pub struct Lent<S, L = DeviceLoan> {
    // Fields are dropped in this order.
    submission: S,
    loans: Vec<L>,
}

impl<S, L> Lent<S, L> {
    /// The loans are those of the places that went into the submission.
    pub fn new(submission: S, loans: Vec<L>) -> Lent<S, L> {
        Lent { submission, loans }
    }

    fn finish<R>(
        self,
        wait: impl FnOnce(S) -> Result<R, GpuError>,
    ) -> Result<(R, Vec<L>), GpuError> {
        let Lent { submission, loans } = self;
        Ok((wait(submission)?, loans))
    }
}

// Nobody gets the submission itself: taken out, it could outlive its loans.
impl<L> Lent<Submission<'static>, L> {
    /// As [`Submission::is_drawn_within`].
    pub fn is_drawn_within(&self, most: Duration) -> bool {
        self.submission.is_drawn_within(most)
    }

    /// As [`Submission::has_events`].
    pub fn has_events(&self) -> bool {
        self.submission.has_events()
    }

    /// As [`Submission::begin_events`].
    pub fn begin_events(&mut self) {
        self.submission.begin_events();
    }
}

impl<S> Lent<S> {
    /// Waits for the submission; returns what `wait` returns, and the loans in their order.
    ///
    /// # Errors
    /// Those of `wait`. The loans go back then.
    pub fn wait<R>(
        self,
        wait: impl FnOnce(S) -> Result<R, GpuError>,
    ) -> Result<(R, impl Iterator<Item = FrameLoan>), GpuError> {
        let (results, loans) = self.finish(wait)?;
        // SAFETY: `wait` was given the submission and returned, so it was waited for, or dropped,
        // which waits too.
        let take_back = |loan: DeviceLoan| unsafe { loan.take_back() };
        Ok((results, loans.into_iter().map(take_back)))
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::rc::Rc;

    use super::*;

    /// Notes when it is dropped.
    struct Noted(&'static str, Rc<RefCell<Vec<&'static str>>>);

    impl Drop for Noted {
        fn drop(&mut self) {
            self.1.borrow_mut().push(self.0);
        }
    }

    #[test]
    fn a_submission_ends_before_its_loans_go_back_also_while_a_panic_unwinds() {
        let order = Rc::new(RefCell::new(Vec::new()));
        let made = || {
            let noted = |what| Noted(what, order.clone());
            Lent::new(noted("submission"), vec![noted("loan")])
        };
        drop(made());
        let unwound = catch_unwind(AssertUnwindSafe(|| {
            made().finish(|_submission| -> Result<(), GpuError> { panic!("while waiting") })
        }));
        assert!(unwound.is_err());
        assert_eq!(
            order.borrow()[..],
            ["submission", "loan", "submission", "loan"]
        );
    }
}
