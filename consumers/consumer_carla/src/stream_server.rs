//! The streaming server: a client sends a stream's number and receives that stream's messages, each
//! preceded by its length.

use std::io::Read as _;
use std::sync::Arc;
use std::time::Duration;

use consumer_rpc::door::{Door, Guest};

use crate::feeds::Feeds;
use crate::wire::streams::{Recipient, is_world};

/// Most streaming connections that may be open. Beyond that, those make room that wait for a stream
/// that does not exist or take nothing, then the oldest of a stream that very many listen to.
pub const MAX_STREAM_CONNECTIONS: usize = 1024;
/// A client that connects and sends no stream number is dropped after this time.
pub const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(10);

/// Accepts clients for ever and serves each on its own thread.
pub fn serve(door: Door, feeds: &Arc<Feeds>) {
    let feeds = feeds.clone();
    Arc::new(door).serve(move |guest| {
        if let Err(error) = serve_one(guest, &feeds) {
            tracing::debug!(%error, "a streaming connection ended");
        }
    });
}

fn serve_one(guest: Guest, feeds: &Arc<Feeds>) -> std::io::Result<()> {
    if guest.unwelcome.is_some() {
        return Ok(());
    }
    guest.stream.set_read_timeout(Some(HANDSHAKE_TIMEOUT))?;
    let mut id = [0; 4];
    (&*guest.stream).read_exact(&mut id)?;
    let stream = u32::from_le_bytes(id);
    guest.seat.pulse.about(stream);
    let client = Recipient::new(guest.stream, guest.seat);
    if is_world(stream) {
        feeds.world_stream().serve(stream, &client)
    } else {
        feeds.serve(stream, &client)
    }
}
