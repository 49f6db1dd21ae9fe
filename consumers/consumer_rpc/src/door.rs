//! Where connections come in: each gets a thread and a seat, and is looked at first. On a loopback
//! address only processes of this process's user (and root) are let in, unless all are.

use std::io;
use std::net::{IpAddr, TcpListener, TcpStream};
use std::sync::Arc;

use launch_cli::accept::{AcceptPause, Seldom, is_out_of_files};

use crate::connection::prepare;
use crate::owner::{self, Whose};
use crate::seats::{Seat, Seats};

/// Files that every process may have open, as far as nothing else is known.
const FEWEST_FILES: u64 = 1024;

/// Who may connect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admits {
    /// Processes of this user and root; what listens on an address that other machines can reach
    /// lets everybody in.
    SameUser,
    /// Everybody.
    AnyUser,
}

/// How many connections of one kind a server may take, `most` at most: a quarter of the files that
/// this process may have open, so that two kinds leave half of them for everything else. Raises the
/// limit of open files before.
pub fn within_file_limit(most: usize) -> usize {
    let raised = launch_cli::raise_file_limit();
    if let Err(error) = &raised {
        tracing::warn!("{error:#}");
    }
    let limit = raised.map_or(FEWEST_FILES, |limit| limit);
    usize::try_from(limit / 4).map_or(most, |share| share.clamp(1, most))
}

/// A listener and who may come in.
#[derive(Debug)]
pub struct Door {
    listener: TcpListener,
    what: &'static str,
    seats: Arc<Seats>,
    /// The user that may come in; `None`: everybody.
    user: Option<u32>,
    refusals: Seldom,
}

/// A connection that came in.
#[derive(Debug)]
pub struct Guest {
    /// Its socket.
    pub stream: Arc<TcpStream>,
    /// Its place.
    pub seat: Seat,
    /// Why nothing may be done for it: a sentence for its user.
    pub unwelcome: Option<String>,
}

impl Door {
    /// Lets at most `capacity` connections of `what` in, as a sentence names them ("RPC
    /// connections").
    ///
    /// # Errors
    /// If it cannot be told whose processes connect.
    pub fn new(
        listener: TcpListener,
        what: &'static str,
        capacity: usize,
        admits: Admits,
    ) -> io::Result<Door> {
        let is_private = is_loopback(listener.local_addr()?.ip());
        let user =
            (admits == Admits::SameUser && is_private).then(|| nix::unistd::geteuid().as_raw());
        if user.is_some() {
            owner::can_tell().map_err(|error| {
                io::Error::new(
                    error.kind(),
                    format!("cannot tell whose processes connect, because /proc/net/tcp cannot be read ({error}); mount /proc, or let everybody on this machine in with --any-user"),
                )
            })?;
        }
        Ok(Door {
            listener,
            what,
            seats: Seats::new(what, capacity),
            user,
            refusals: Seldom::default(),
        })
    }

    /// Accepts connections for ever and runs `serve` for each on a thread of its own.
    pub fn serve(self: &Arc<Self>, serve: impl Fn(Guest) + Send + Sync + 'static) {
        let serve = Arc::new(serve);
        let mut pause = AcceptPause::new(self.what);
        loop {
            let accepted = self.listener.accept().and_then(|(stream, _)| {
                let stream = Arc::new(stream);
                let Some(seat) = self.seats.take(&stream) else {
                    return Ok(());
                };
                let (door, serve) = (self.clone(), serve.clone());
                std::thread::Builder::new()
                    .name("client".into())
                    .spawn(move || {
                        if let Some(guest) = door.look_at(stream, seat) {
                            serve(guest);
                        }
                    })
                    .map(drop)
            });
            match accepted {
                Ok(()) => pause.over(),
                Err(error) => {
                    if is_out_of_files(&error) {
                        self.seats.relieve();
                    }
                    pause.wait(&error);
                }
            }
        }
    }

    /// A new connection; `None` if it has ended.
    fn look_at(&self, stream: Arc<TcpStream>, seat: Seat) -> Option<Guest> {
        prepare(&stream).ok()?;
        let unwelcome = match self.user {
            Some(ours) => self.unwelcome(&stream, ours).ok()?,
            None => None,
        };
        if let (Some(why), Some(n_unsaid)) = (
            &unwelcome,
            unwelcome.as_ref().and_then(|_| self.refusals.is_due()),
        ) {
            tracing::warn!(n_unsaid, "refused one of the {}: {why}", self.what);
        }
        Some(Guest {
            stream,
            seat,
            unwelcome,
        })
    }

    fn unwelcome(&self, stream: &TcpStream, ours: u32) -> io::Result<Option<String>> {
        let (theirs, here) = (stream.peer_addr()?, stream.local_addr()?);
        const SO: &str = "--any-user lets all users of this machine in";
        Ok(match owner::whose(theirs, here) {
            Ok(Whose::User(user)) if user == ours || user == 0 => None,
            Ok(Whose::User(user)) => Some(format!(
                "this server belongs to user {ours} and answers only that user's programs, but this one is user {user}'s; {SO}"
            )),
            Ok(Whose::Nobody) => return Err(io::ErrorKind::NotConnected.into()),
            Ok(Whose::Unknown) => Some(format!(
                "this server belongs to user {ours} and answers only that user's programs, but the kernel does not say whose this one is; {SO}"
            )),
            Err(error) => Some(format!(
                "this server belongs to user {ours} and answers only that user's programs, but whose this one is cannot be read ({error}); {SO}"
            )),
        })
    }
}

fn is_loopback(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(ip) => ip.is_loopback(),
        IpAddr::V6(ip) => {
            ip.is_loopback() || ip.to_ipv4_mapped().is_some_and(|ip| ip.is_loopback())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_is_private() {
        for (address, is_private) in [
            ("127.0.0.1", true),
            ("127.3.2.1", true),
            ("::1", true),
            ("::ffff:127.0.0.1", true),
            ("0.0.0.0", false),
            ("::", false),
            ("10.0.0.1", false),
        ] {
            assert_eq!(
                is_loopback(address.parse().unwrap()),
                is_private,
                "{address}"
            );
        }
    }
}
