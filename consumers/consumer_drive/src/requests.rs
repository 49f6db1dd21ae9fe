//! The way from other threads to the desk of a session: requests wait in a queue until the session
//! runs them between two snapshots, and whoever asks gets the answer.

use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel as queue};
use std::time::Duration;

use crate::desk::{Desk, Request};

/// Where other threads ask. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Counter {
    requests: Sender<Request>,
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
    let (requests, waiting) = queue();
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
    /// counts; `None` if the session has ended or takes longer than `patience`. A question that was
    /// not answered in time is run later all the same.
    pub fn ask<R: Send + 'static>(
        &self,
        question: impl FnOnce(&mut Desk) -> R + Send + 'static,
        patience: Duration,
    ) -> Option<R> {
        let (answer, answered) = queue();
        let request: Request = Box::new(move |desk| {
            let result = question(desk);
            // Who asked may have gone.
            Box::new(move || drop(answer.send(result)))
        });
        self.requests.send(request).ok()?;
        // A socket that is full has woken the session already.
        let _ = (&*self.wake).write(&[1]);
        answered.recv_timeout(patience).ok()
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
        assert_eq!(asking.join().unwrap(), (Some(vec![7]), Some(false), None));
    }
}
