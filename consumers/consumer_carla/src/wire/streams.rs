//! Streams: their numbers, the tokens that tell clients where they are, and messages on their
//! connections.

use std::io::{IoSlice, Write as _};
use std::net::TcpStream;
use std::os::fd::{AsFd as _, BorrowedFd};
use std::sync::Arc;
use std::time::Duration;

use consumer_rpc::seats::{Doing, Seat};
use schema_bus::WaitSet;

use crate::stages;

/// The world stream of clients that have not asked for one of their own.
pub const WORLD_STREAM: u32 = 1;
/// Numbers of clients' own world streams start here; actors' streams never get this far.
pub const FIRST_OWN_WORLD_STREAM: u32 = 0x8000_0000;

/// A message that is made once and sent to several clients.
#[derive(Clone, Debug)]
pub struct StreamMessage {
    /// Tick it shows.
    pub tick: u64,
    /// Its bytes.
    pub bytes: Arc<[u8]>,
}

/// Whether this is the number of a world stream.
pub fn is_world(stream: u32) -> bool {
    stream == WORLD_STREAM || stream >= FIRST_OWN_WORLD_STREAM
}

/// The stream of an actor's messages. No actor has the id 0, so none gets the world's number, 1.
pub fn stream_of(actor: u32) -> u32 {
    actor.wrapping_add(1)
}

/// The actor whose messages a stream carries.
pub fn actor_of(stream: u32) -> Option<u32> {
    stream.checked_sub(1).filter(|actor| *actor != 0)
}

/// The client at the other end of a streaming connection, and its place among them.
#[derive(Debug)]
pub struct Recipient {
    connection: Arc<TcpStream>,
    seat: Seat,
}

impl Recipient {
    /// The client of a connection that is served from now on.
    pub fn new(connection: Arc<TcpStream>, seat: Seat) -> Recipient {
        seat.pulse.now(Doing::Served);
        Recipient { connection, seat }
    }

    /// The socket, to wait for the client's end.
    pub fn as_fd(&self) -> BorrowedFd<'_> {
        self.connection.as_fd()
    }

    /// Sends a message after its length, in one system call if the kernel has room.
    ///
    /// # Errors
    /// If the client has gone, or takes nothing for the time-out of writing.
    pub fn send(&self, head: &[u8], body: &[u8]) -> std::io::Result<()> {
        self.seat.pulse.now(Doing::Taking);
        let _span = stages::SEND.span();
        let sent = write(&self.connection, head, body);
        self.seat.pulse.now(Doing::Served);
        sent
    }

    /// Whether the client has disconnected. It sends nothing after the stream's number, so anything
    /// that can be read is the end.
    ///
    /// # Errors
    /// If the socket cannot be looked at.
    pub fn has_ended(&self) -> std::io::Result<bool> {
        let connection = &self.connection;
        connection.set_nonblocking(true)?;
        let looked = connection.peek(&mut [0; 1]);
        connection.set_nonblocking(false)?;
        Ok(match looked {
            Ok(_) => true,
            Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
        })
    }

    /// Waits until the client disconnects. Closing the connection instead would make it reconnect
    /// at once. A client that waits for nothing makes room for others.
    ///
    /// # Errors
    /// If the socket cannot be looked at.
    pub fn wait_for_end(&self) -> std::io::Result<()> {
        self.seat.pulse.now(Doing::Waiting);
        let forever = Duration::from_secs(3600);
        while !self.has_ended()? {
            WaitSet::new()
                .wait_beside(&[self.as_fd()], forever)
                .map_err(std::io::Error::other)?;
        }
        Ok(())
    }
}

fn write(mut connection: &TcpStream, head: &[u8], body: &[u8]) -> std::io::Result<()> {
    let length = ((head.len() + body.len()) as u32).to_le_bytes();
    let mut pieces = [
        IoSlice::new(&length),
        IoSlice::new(head),
        IoSlice::new(body),
    ];
    let mut pieces = &mut pieces[..];
    IoSlice::advance_slices(&mut pieces, 0);
    while !pieces.is_empty() {
        match connection.write_vectored(pieces) {
            Ok(0) => return Err(std::io::ErrorKind::WriteZero.into()),
            Ok(n) => IoSlice::advance_slices(&mut pieces, n),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// The token that tells a client where a stream is: on the host that it called, at this port. 24
/// bytes.
pub fn token(stream: u32, port: u16) -> Vec<u8> {
    const TCP: u8 = 1;
    let mut token = vec![0; 24];
    token[0..4].copy_from_slice(&stream.to_le_bytes());
    token[4..6].copy_from_slice(&port.to_le_bytes());
    token[6] = TCP;
    token
}
