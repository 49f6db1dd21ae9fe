//! The way from other threads to the desk of a session: requests wait in a bounded queue until the
//! session runs them between two snapshots, and whoever asks gets the answer.

use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{
    Receiver, RecvTimeoutError, SyncSender, TrySendError, channel as queue, sync_channel,
};
use std::time::Duration;

use crate::desk::{Desk, Request};

/// Most requests that wait for the session, for example while it reads a map.
pub const MAX_WAITING_REQUESTS: usize = 4096;

/// Why a question is not asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AskError {
    /// Too many wait already.
    #[error("{MAX_WAITING_REQUESTS} requests wait for the driver already; ask again later")]
    Full,
    /// The session has ended.
    #[error("the driver ends")]
    Ended,
}

/// Where other threads ask. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Counter {
    requests: SyncSender<Request>,
    wake: Arc<UnixStream>,
}

/// Where a session finds what was asked.
#[derive(Debug)]
pub struct Requests {
    waiting: Receiver<Request>,
    wake: UnixStream,
}

/// Both ends.
///
/// # Errors
/// The process may open no more files.
pub fn channel() -> io::Result<(Counter, Requests)> {
    let (requests, waiting) = sync_channel(MAX_WAITING_REQUESTS);
    let (ours, theirs) = UnixStream::pair()?;
    ours.set_nonblocking(true)?;
    theirs.set_nonblocking(true)?;
    let wake = Arc::new(theirs);
    Ok((
        Counter { requests, wake },
        Requests {
            waiting,
            wake: ours,
        },
    ))
}

impl Counter {
    /// Runs `question` on the desk between two snapshots and returns its answer when what it changed
    /// counts; `None` if that takes longer than `patience`. A question that was not answered in time
    /// is run later all the same.
    ///
    /// # Errors
    /// [`AskError`]; the question is not run then.
    pub fn ask<R: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Desk) -> R + Send + 'static,
        patience: Duration,
    ) -> Result<Option<R>, AskError> {
        let (answer, answered) = queue();
        let request: Request = Box::new(move |desk| {
            let result = question(desk);
            // Who asked may have gone.
            Box::new(move || drop(answer.send(result)))
        });
        let asked = self.requests.try_send(request);
        // A socket that is full has woken the session already.
        let _ = (&*self.wake).write(&[1]);
        match asked {
            Ok(()) => match answered.recv_timeout(patience) {
                Ok(answer) => Ok(Some(answer)),
                Err(RecvTimeoutError::Timeout) => Ok(None),
                Err(RecvTimeoutError::Disconnected) => Err(AskError::Ended),
            },
            Err(TrySendError::Full(_)) => Err(AskError::Full),
            Err(TrySendError::Disconnected(_)) => Err(AskError::Ended),
        }
    }
}

impl Requests {
    /// All requests that wait, in order of arrival. Whoever asked waits until its request is run or
    /// dropped.
    pub fn take(&self) -> Vec<Request> {
        let mut wakes = [0; 256];
        while matches!((&self.wake).read(&mut wakes), Ok(n) if n == wakes.len()) {}
        self.waiting.try_iter().collect()
    }
}

/// Readable while requests wait.
impl AsFd for Requests {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_come_back_in_order_and_end_with_the_session() {
        let (counter, requests) = channel().unwrap();
        let asking = std::thread::spawn(move || {
            let patience = Duration::from_secs(60);
            let register = |desk: &mut Desk| {
                desk.register(&[7]);
                desk.registered().collect::<Vec<_>>()
            };
            let first = counter.ask(register, patience);
            let second = counter.ask(|desk| desk.lockstep(), patience);
            (first, second, counter.ask(|_| (), patience))
        });
        let mut desk = Desk::default();
        let mut n_run = 0;
        while n_run < 2 {
            for request in requests.take() {
                request(&mut desk)();
                n_run += 1;
            }
        }
        drop(requests);
        let answers = (Ok(Some(vec![7])), Ok(Some(false)), Err(AskError::Ended));
        assert_eq!(asking.join().unwrap(), answers);
    }

    #[test]
    fn only_so_many_requests_wait() {
        let (counter, requests) = channel().unwrap();
        let ask = || counter.ask(|_| (), Duration::ZERO);
        let n_taken = (0..2 * MAX_WAITING_REQUESTS)
            .filter(|_| ask().is_ok())
            .count();
        assert_eq!(
            (n_taken, ask()),
            (MAX_WAITING_REQUESTS, Err(AskError::Full))
        );
        assert_eq!(requests.take().len(), MAX_WAITING_REQUESTS);
        assert_eq!(ask(), Ok(None));
    }
}
