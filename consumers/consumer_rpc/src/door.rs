//! Where connections come in: each is looked at, and then gets a seat and a thread. On a loopback
//! address only processes of this process's user (and root) are let in, unless all are; others get
//! a seat apart, to be told why.

use std::io;
use std::net::{IpAddr, TcpListener, TcpStream};
use std::sync::Arc;

use launch_cli::accept::{AcceptPause, Seldom, is_out_of_files};

use crate::connection::prepare;
use crate::owner::{self, Whose};
use crate::seats::{Seat, Seats};

/// Files that every process may have open, as far as nothing else is known.
const FEWEST_FILES: u64 = 1024;
/// Most connections that are told at a time why they are not let in.
pub const MAX_STRANGERS: usize = 16;

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

/// Tells why a connection is not let in, if it is not; an error if it has ended.
type Judge = Box<dyn Fn(&TcpStream) -> io::Result<Option<String>> + Send + Sync>;

/// A listener and who may come in.
pub struct Door {
    listener: TcpListener,
    what: &'static str,
    seats: Arc<Seats>,
    /// Places of those that are not let in.
    strangers: Arc<Seats>,
    judge: Judge,
    refusals: Seldom,
}

impl std::fmt::Debug for Door {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Door")
            .field("listener", &self.listener)
            .field("what", &self.what)
            .finish_non_exhaustive()
    }
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
        let judge: Judge = match user {
            Some(ours) => Box::new(move |stream: &TcpStream| unwelcome(stream, ours)),
            None => Box::new(|_: &TcpStream| Ok(None)),
        };
        Ok(Door::judged(listener, what, capacity, judge))
    }

    fn judged(listener: TcpListener, what: &'static str, capacity: usize, judge: Judge) -> Door {
        Door {
            listener,
            what,
            seats: Seats::new(what, capacity),
            strangers: Seats::new("refused connections", MAX_STRANGERS),
            judge,
            refusals: Seldom::default(),
        }
    }

    /// Accepts connections for ever and runs `serve` for each on a thread of its own.
    pub fn serve(self: &Arc<Self>, serve: impl Fn(Guest) + Send + Sync + 'static) {
        let serve = Arc::new(serve);
        let mut pause = AcceptPause::new(self.what);
        loop {
            let accepted = self.listener.accept().and_then(|(stream, _)| {
                let Some(guest) = self.look_at(Arc::new(stream)) else {
                    return Ok(());
                };
                let serve = serve.clone();
                std::thread::Builder::new()
                    .name("client".into())
                    .spawn(move || serve(guest))
                    .map(drop)
            });
            match accepted {
                Ok(()) => pause.over(),
                Err(error) => {
                    if is_out_of_files(&error) && !self.strangers.relieve() {
                        self.seats.relieve();
                    }
                    pause.wait(&error);
                }
            }
        }
    }

    /// A new connection, which takes no place of those that are let in before it is let in; `None`
    /// if it has ended or there is no place.
    fn look_at(&self, stream: Arc<TcpStream>) -> Option<Guest> {
        prepare(&stream).ok()?;
        let unwelcome = (self.judge)(&stream).ok()?;
        if let Some(why) = &unwelcome
            && let Some(n_unsaid) = self.refusals.is_due()
        {
            tracing::warn!(n_unsaid, "refused one of the {}: {why}", self.what);
        }
        let seats = match unwelcome {
            None => &self.seats,
            Some(_) => &self.strangers,
        };
        let seat = seats.take(&stream)?;
        Some(Guest {
            stream,
            seat,
            unwelcome,
        })
    }
}

/// Why a connection is not let in that only processes of the user `ours`, and root, may make.
fn unwelcome(stream: &TcpStream, ours: u32) -> io::Result<Option<String>> {
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
    use std::io::{Read as _, Write as _};
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    /// However many strangers come, they take no place of those that are let in.
    #[test]
    fn strangers_make_nobody_leave() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let is_strange = Arc::new(AtomicBool::new(false));
        let judged = is_strange.clone();
        let judge = move |_: &TcpStream| {
            let is_strange = judged.load(Ordering::Acquire);
            Ok(is_strange.then(|| "somebody else's".to_owned()))
        };
        let door = Door::judged(listener, "test connections", 4, Box::new(judge));
        std::thread::spawn(move || {
            // Says what it is, and then once more when it is asked.
            Arc::new(door).serve(|guest| {
                let word = [u8::from(guest.unwelcome.is_some())];
                let mut stream = &*guest.stream;
                while stream.write_all(&word).is_ok() && stream.read_exact(&mut [0]).is_ok() {}
            });
        });
        let word = |client: &mut TcpStream| {
            let mut word = [9];
            client.read_exact(&mut word).map(|()| word[0]).ok()
        };
        let come = || TcpStream::connect(address).unwrap();
        let mut own: Vec<TcpStream> = (0..4).map(|_| come()).collect();
        assert!(own.iter_mut().all(|client| word(client) == Some(0)));
        is_strange.store(true, Ordering::Release);
        let strangers: Vec<TcpStream> = (0..4 * MAX_STRANGERS)
            .map(|_| {
                let mut client = come();
                assert_eq!(word(&mut client), Some(1));
                client
            })
            .collect();
        for client in &mut own {
            client.write_all(&[1]).unwrap();
            assert_eq!(word(client), Some(0), "it is served as before");
        }
        drop(strangers);
    }

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
