//! Traffic Managers in processes of their own that clients were sent to, and whether one of them has
//! ended just now.
//!
//! A client of the 0.9.16 package looks every 2 s whether its Traffic Manager answers, and gives that
//! 2 s. When it does not, the client's next snapshot is lost: the package hands the error to whoever
//! waits for a snapshot in place of the state that came. In a stepped world no other snapshot follows,
//! and `World.tick` waits for its whole time-out. Therefore snapshots are repeated for a while after a
//! manager's end; a client that has a snapshot takes no notice of its repetition, but for callbacks of
//! `World.on_tick`.

use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use consumer_rpc::place::Place;
use parking_lot::Mutex;

/// For how long clients may lose a snapshot: one look every 2 s, which may take 2 s, and some time for
/// a busy machine.
const WINDOW: Duration = Duration::from_secs(8);
/// How long a connection to a manager may take.
const CONNECT: Duration = Duration::from_millis(500);
/// Most managers that are watched; the first ones are forgotten.
const MAX_WATCHED: usize = 16;

/// The managers that clients were sent to.
#[derive(Debug, Default)]
pub struct LostManagers {
    /// Connections that say nothing; they end with the manager's process.
    watched: Mutex<Vec<(Place, TcpStream)>>,
    lost: Mutex<Option<Instant>>,
}

impl LostManagers {
    /// Watches the manager at `place` from now on.
    pub fn watch(&self, place: &Place) {
        if self.watched.lock().iter().any(|(known, _)| known == place) {
            return;
        }
        let connection = (place.host.as_str(), place.port)
            .to_socket_addrs()
            .and_then(|mut all| all.next().ok_or(std::io::ErrorKind::NotFound.into()))
            .and_then(|address| TcpStream::connect_timeout(&address, CONNECT))
            .and_then(|connection| connection.set_nonblocking(true).map(|()| connection));
        match connection {
            Ok(connection) => {
                let mut watched = self.watched.lock();
                watched.truncate(MAX_WATCHED - 1);
                watched.insert(0, (place.clone(), connection));
            }
            Err(error) => {
                tracing::debug!(host = place.host, port = place.port, %error, "cannot watch")
            }
        }
    }

    /// Looks whether one has ended.
    pub fn sweep(&self) {
        let mut watched = self.watched.lock();
        let before = watched.len();
        watched.retain(|(_, connection)| match connection.peek(&mut [0]) {
            Ok(n) => n > 0,
            Err(error) => matches!(
                error.kind(),
                std::io::ErrorKind::WouldBlock | std::io::ErrorKind::Interrupted
            ),
        });
        if watched.len() < before {
            tracing::info!("a Traffic Manager has ended; snapshots are repeated for its clients");
            *self.lost.lock() = Some(Instant::now());
        }
    }

    /// Whether one has ended so lately that clients may lose a snapshot.
    pub fn is_recent(&self) -> bool {
        self.lost.lock().is_some_and(|at| at.elapsed() < WINDOW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn the_end_of_a_manager_is_seen_once() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let place = Place {
            host: "127.0.0.1".into(),
            port: listener.local_addr().unwrap().port(),
        };
        let managers = LostManagers::default();
        managers.watch(&place);
        managers.watch(&place);
        let (held, _) = listener.accept().unwrap();
        managers.sweep();
        assert!(!managers.is_recent());
        drop(held);
        // The connection was made once: no other is waiting to be accepted.
        listener.set_nonblocking(true).unwrap();
        assert!(listener.accept().is_err());
        let until = Instant::now() + Duration::from_secs(60);
        while !managers.is_recent() && Instant::now() < until {
            managers.sweep();
        }
        assert!(managers.is_recent());
    }
}
