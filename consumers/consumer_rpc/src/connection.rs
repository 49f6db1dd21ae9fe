//! Both directions of a connection: a reader that waits for requests without end and for the rest of
//! one only so long, and a writer that gives up on who does not read.

use std::io::{self, Read, Write as _};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use socket2::{SockRef, TcpKeepalive};

use crate::seats::{Doing, Pulse};

/// A peer that has sent nothing for so long is asked whether it is there.
pub const KEEPALIVE_IDLE: Duration = Duration::from_secs(30);
/// Time between two such questions.
const KEEPALIVE_EVERY: Duration = Duration::from_secs(10);
/// Unanswered questions after which the connection ends.
const KEEPALIVE_TRIES: u32 = 3;
/// A peer that has not acknowledged what it was sent for so long has gone.
pub const UNACKNOWLEDGED: Duration = Duration::from_secs(60);
/// A client that reads nothing of what it is sent for so long is dropped.
pub const WRITE_TIMEOUT: Duration = Duration::from_secs(30);
/// An answer is read within this time, however large it is.
pub const ANSWER_TIMEOUT: Duration = Duration::from_secs(120);
/// A request that has begun is whole within this time.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(60);
/// How often a reader that waits looks at the clock.
const LOOK: Duration = Duration::from_secs(5);

/// Makes a new connection one that ends if its peer vanishes without a word, and sends at once.
///
/// # Errors
/// If the connection has ended.
pub fn prepare(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(WRITE_TIMEOUT))?;
    let socket = SockRef::from(stream);
    socket.set_tcp_keepalive(
        &TcpKeepalive::new()
            .with_time(KEEPALIVE_IDLE)
            .with_interval(KEEPALIVE_EVERY)
            .with_retries(KEEPALIVE_TRIES),
    )?;
    socket.set_tcp_user_timeout(Some(UNACKNOWLEDGED))
}

/// The reading end.
#[derive(Debug)]
pub(crate) struct Incoming {
    stream: Arc<TcpStream>,
    /// When the message that has begun must be whole.
    pub until: Option<Instant>,
}

impl Incoming {
    pub fn new(stream: Arc<TcpStream>) -> io::Result<Incoming> {
        stream.set_read_timeout(Some(LOOK))?;
        Ok(Incoming {
            stream,
            until: None,
        })
    }
}

impl Read for Incoming {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        loop {
            if self.until.is_some_and(|until| Instant::now() >= until) {
                let secs = REQUEST_TIMEOUT.as_secs();
                return Err(io::Error::other(format!(
                    "the rest of it did not come within {secs} s"
                )));
            }
            match (&*self.stream).read(into) {
                Err(error) if is_late(&error) => {}
                read => return read,
            }
        }
    }
}

fn is_late(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

/// The writing end of a connection, for responses out of turn: clients tell responses apart by the
/// numbers of their requests, so they may come in any order.
#[derive(Clone, Debug)]
pub struct Later {
    stream: Arc<TcpStream>,
    /// Held while a response is written.
    writing: Arc<Mutex<()>>,
    pulse: Option<Pulse>,
}

impl Later {
    /// For a connection.
    pub fn new(connection: TcpStream) -> Later {
        Later {
            stream: Arc::new(connection),
            writing: Arc::default(),
            pulse: None,
        }
    }

    pub(crate) fn of(stream: Arc<TcpStream>, pulse: Pulse) -> Later {
        Later {
            stream,
            writing: Arc::default(),
            pulse: Some(pulse),
        }
    }

    /// Writes whole responses. Waits at most [`ANSWER_TIMEOUT`] for a client that does not read.
    ///
    /// # Errors
    /// If the connection has ended or the client does not read; the connection is then of no
    /// further use.
    pub fn send(&self, responses: &[u8]) -> io::Result<()> {
        if responses.is_empty() {
            return Ok(());
        }
        let _one_by_one = self.writing.lock();
        let before = self.pulse.as_ref().map(|pulse| pulse.now(Doing::Taking));
        let written = self.write(responses);
        if let (Some(pulse), Some(before)) = (&self.pulse, before) {
            pulse.now(before);
        }
        if written.is_err() {
            // Half a response may be out, so nothing can follow it.
            let _ = self.stream.shutdown(std::net::Shutdown::Both);
        }
        written
    }

    fn write(&self, mut left: &[u8]) -> io::Result<()> {
        let mut until = None;
        while !left.is_empty() {
            match (&*self.stream).write(left) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(n) => left = &left[n..],
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            // Only what does not fit into the kernel's memory needs a clock.
            if !left.is_empty()
                && *until.get_or_insert_with(|| Instant::now() + ANSWER_TIMEOUT) <= Instant::now()
            {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        Ok(())
    }
}
