//! Streams: their numbers, where a client finds one, and how messages lie on their connections.

use std::io::{IoSlice, Write as _};
use std::net::TcpStream;
use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::time::Duration;

use schema_bus::WaitSet;

/// Stream of the world snapshots, for who asks for no own one.
pub const WORLD_STREAM: u32 = 1;
/// Clients' own world streams count from here; actors' streams never come so far.
pub const FIRST_OWN_WORLD_STREAM: u32 = 0x8000_0000;

/// A message that is made once and sent to several clients.
#[derive(Clone, Debug)]
pub struct StreamMessage {
    /// Tick it shows.
    pub tick: u64,
    /// Its bytes.
    pub bytes: Arc<[u8]>,
}

/// Whether a number is that of a world stream.
pub fn is_world(stream: u32) -> bool {
    stream == WORLD_STREAM || stream >= FIRST_OWN_WORLD_STREAM
}

/// Stream of an actor's messages; the world's is 1, and no actor has the id 0.
pub fn stream_of(actor: u32) -> u32 {
    actor.wrapping_add(1)
}

/// The actor whose messages a stream has.
pub fn actor_of(stream: u32) -> Option<u32> {
    stream.checked_sub(1).filter(|actor| *actor != 0)
}

/// Length and message, in one system call where the kernel has room.
pub fn send(connection: &mut TcpStream, head: &[u8], body: &[u8]) -> std::io::Result<()> {
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

/// Clients send nothing after the number, so anything that can be read is the end.
pub fn has_ended(connection: &TcpStream) -> std::io::Result<bool> {
    connection.set_nonblocking(true)?;
    let looked = connection.peek(&mut [0; 1]);
    connection.set_nonblocking(false)?;
    Ok(match looked {
        Ok(_) => true,
        Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
    })
}

/// Closing would make the client come again at once.
pub fn wait_for_end(connection: &TcpStream) -> std::io::Result<()> {
    let forever = Duration::from_secs(3600);
    while !has_ended(connection)? {
        WaitSet::new()
            .wait_beside(&[connection.as_fd()], forever)
            .map_err(std::io::Error::other)?;
    }
    Ok(())
}

/// The 24 bytes that tell a client where a stream is: on the host it dialled, at this port.
pub fn token(stream: u32, port: u16) -> Vec<u8> {
    const TCP: u8 = 1;
    let mut token = vec![0; 24];
    token[0..4].copy_from_slice(&stream.to_le_bytes());
    token[4..6].copy_from_slice(&port.to_le_bytes());
    token[6] = TCP;
    token
}
