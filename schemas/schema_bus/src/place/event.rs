//! Wake-ups. Several notifications may arrive as one, so a listener looks at everything it reads.

use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::prelude::*;
use parking_lot::Mutex;

use crate::contract::error::BusError;
use crate::place::iceoryx_error::other_error;
use crate::place::node::{BusNode, Service};
use crate::place::service::{Events, make_event};

/// Wakes the listeners of an event.
#[derive(Debug)]
pub struct Notifier {
    port: iceoryx2::port::notifier::Notifier<Service>,
    service: Events,
}

impl Notifier {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<Notifier, BusError> {
        let (full, service) = make_event(node, name)?;
        let port = service
            .notifier_builder()
            .create()
            .map_err(|e| other_error("notify", &full, &e))?;
        Ok(Notifier { port, service })
    }

    /// Wakes all listeners, at the cost of a system call for each. Returns the number of listeners
    /// that were woken.
    ///
    /// A listener whose queue is full has been woken before, so no failure here loses a wake-up.
    pub fn notify(&self) -> usize {
        self.port.notify().unwrap_or(0)
    }

    /// As [`Notifier::notify`], without any call of iceoryx2 if nobody listens.
    pub fn notify_listeners(&self) -> usize {
        if self.n_listeners() == 0 {
            return 0;
        }
        self.notify()
    }

    /// Number of listeners now. If it is 0, a notification has no effect.
    pub fn n_listeners(&self) -> usize {
        self.service.dynamic_config().number_of_listeners()
    }
}

/// Held while a listener is made. iceoryx2 binds its socket under a file mode mask of its own and
/// puts back the one that it found; two threads at once would leave the process with that mask, and
/// no folder or program that it makes from then on could be entered or run.
static BINDING: Mutex<()> = Mutex::new(());

/// Waits for an event.
#[derive(Debug)]
pub struct Listener {
    port: iceoryx2::port::listener::Listener<Service>,
    name: String,
    _service: Events,
}

impl Listener {
    pub(crate) fn open(node: &BusNode, name: &str) -> Result<Listener, BusError> {
        let (full, service) = make_event(node, name)?;
        let made = {
            let _alone = BINDING.lock();
            service.listener_builder().create()
        };
        let port = made.map_err(|e| other_error("listen to", &full, &e))?;
        Ok(Listener {
            port,
            name: full,
            _service: service,
        })
    }

    /// Waits until the event is notified or `timeout` is over. Returns whether it was notified; a
    /// signal ends the wait early with `false`.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn wait(&self, timeout: Duration) -> Result<bool, BusError> {
        if poll(&mut [self.pollfd()], timeout) {
            return self.drain();
        }
        Ok(false)
    }

    /// Waits as [`Listener::wait`], but leaves the notifications pending. A woken reader then has
    /// its sample two system calls earlier, and calls [`Listener::drain`] before it looks for
    /// samples and sleeps the next time.
    pub fn wait_pending(&self, timeout: Duration) -> bool {
        poll(&mut [self.pollfd()], timeout)
    }

    /// Takes all pending notifications without waiting. Returns whether there were any; those that a
    /// signal kept from being taken stay pending, and count as well.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn drain(&self) -> Result<bool, BusError> {
        match self.port.try_wait(|_| {}) {
            Ok(n) => Ok(n > 0),
            Err(ListenerWaitError::InterruptSignal) => Ok(true),
            Err(e) => Err(other_error("wait for", &self.name, &e)),
        }
    }

    fn pollfd(&self) -> libc::pollfd {
        // SAFETY: the descriptor is only polled, never closed, and lives as long as the port.
        let fd = unsafe { self.port.file_descriptor().native_handle() };
        libc::pollfd {
            fd,
            events: libc::POLLIN,
            revents: 0,
        }
    }
}

/// For event loops: the descriptor is readable while notifications are pending.
impl AsFd for Listener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the descriptor is open as long as the port, which the result borrows.
        unsafe { BorrowedFd::borrow_raw(self.pollfd().fd) }
    }
}

/// Waits for any of `fds`. Returns `false` if the time is over or a signal came.
fn poll(fds: &mut [libc::pollfd], timeout: Duration) -> bool {
    let wait = libc::timespec {
        tv_sec: timeout.as_secs().min(1 << 30) as libc::time_t,
        tv_nsec: timeout.subsec_nanos() as libc::c_long,
    };
    // SAFETY: pointer and length are those of one slice, of which the kernel writes only `revents`;
    // no signal mask is given.
    unsafe {
        libc::ppoll(
            fds.as_mut_ptr(),
            fds.len() as libc::nfds_t,
            &wait,
            std::ptr::null(),
        ) > 0
    }
}

/// Number of a listener in a [`WaitSet`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Token(usize);

/// Waits for several listeners at once.
#[derive(Debug, Default)]
pub struct WaitSet {
    listeners: Vec<Listener>,
    fds: Vec<libc::pollfd>,
}

impl WaitSet {
    /// An empty set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a listener.
    pub fn add(&mut self, listener: Listener) -> Token {
        self.fds.push(listener.pollfd());
        self.listeners.push(listener);
        Token(self.listeners.len() - 1)
    }

    /// Waits until one of the listeners is notified or `timeout` is over. Returns whether any was
    /// notified; [`WaitSet::woken`] says which. An empty set sleeps.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, BusError> {
        self.fds.iter_mut().for_each(|fd| fd.revents = 0);
        if !poll(&mut self.fds, timeout) {
            return Ok(false);
        }
        for (listener, fd) in self.listeners.iter().zip(&self.fds) {
            if fd.revents != 0 {
                listener.drain()?;
            }
        }
        Ok(true)
    }

    /// Waits as [`WaitSet::wait`], and also until one of `others` (sockets, pipes) can be read or
    /// has ended. Returns for each of `others`, in their order, whether that is so; reading from
    /// them is left to the caller.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn wait_beside(
        &mut self,
        others: &[BorrowedFd<'_>],
        timeout: Duration,
    ) -> Result<Vec<bool>, BusError> {
        let mut fds = self.fds.clone();
        fds.extend(others.iter().map(|fd| libc::pollfd {
            fd: fd.as_raw_fd(),
            events: libc::POLLIN,
            revents: 0,
        }));
        fds.iter_mut().for_each(|fd| fd.revents = 0);
        poll(&mut fds, timeout);
        let (own, others) = fds.split_at(self.fds.len());
        for (listener, fd) in self.listeners.iter().zip(own) {
            if fd.revents != 0 {
                listener.drain()?;
            }
        }
        self.fds.copy_from_slice(own);
        Ok(others.iter().map(|fd| fd.revents != 0).collect())
    }

    /// Waits as [`WaitSet::wait`] until `deadline`; at once if that is past.
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn wait_until(&mut self, deadline: Instant) -> Result<bool, BusError> {
        self.wait(deadline.saturating_duration_since(Instant::now()))
    }

    /// Whether this listener was notified by the last wait.
    pub fn woken(&self, token: Token) -> bool {
        self.fds.get(token.0).is_some_and(|fd| fd.revents != 0)
    }
}
