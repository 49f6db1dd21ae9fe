//! The streaming server: a client sends a stream's number and receives that stream's messages, each
//! preceded by its length.

use std::io::Read as _;
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::feeds::Feeds;
use crate::wire::streams::is_world;

/// Most streaming connections that may be open.
const MAX_CONNECTIONS: usize = 512;
/// A client that connects and sends no stream number is dropped after this time.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// A client that reads nothing from its connection is dropped after this time.
const WRITE: Duration = Duration::from_secs(30);

/// Accepts clients for ever and serves each on its own thread.
pub fn serve(listener: &TcpListener, feeds: &Arc<Feeds>) {
    let open = Arc::new(AtomicUsize::new(0));
    for connection in listener.incoming() {
        let Ok(connection) = connection else { continue };
        if open.fetch_add(1, Ordering::AcqRel) >= MAX_CONNECTIONS {
            tracing::warn!("refused a streaming connection: {MAX_CONNECTIONS} are open");
            open.fetch_sub(1, Ordering::AcqRel);
            continue;
        }
        let (feeds, open_here) = (feeds.clone(), open.clone());
        let spawned = std::thread::Builder::new()
            .name("stream".into())
            .spawn(move || {
                if let Err(error) = serve_one(connection, &feeds) {
                    tracing::debug!(%error, "a streaming connection ended");
                }
                open_here.fetch_sub(1, Ordering::AcqRel);
            });
        if let Err(error) = spawned {
            tracing::warn!(%error, "cannot start a thread for a streaming connection");
            open.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

fn serve_one(mut connection: TcpStream, feeds: &Arc<Feeds>) -> std::io::Result<()> {
    connection.set_nodelay(true)?;
    connection.set_read_timeout(Some(HANDSHAKE))?;
    connection.set_write_timeout(Some(WRITE))?;
    let mut id = [0; 4];
    connection.read_exact(&mut id)?;
    match u32::from_le_bytes(id) {
        world if is_world(world) => feeds.world_stream().serve(world, connection),
        sensor => feeds.serve(sensor, connection),
    }
}
