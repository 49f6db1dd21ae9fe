//! Which request is answered how.
//!
//! | request | answer |
//! |---|---|
//! | `GET /` | the page |
//! | `GET /?code=CODE` | once, to a browser of this user: the page's address with the token |
//! | `GET /state` | the world as it is now, JSON |
//! | `GET /town` | what changes seldom, JSON |
//! | `GET /picture` | the spectator's pictures, each replacing the one before |
//! | `POST /command` | a batch of commands, as on `control/world`, and its answer |
//! | `POST /fly` | what keys and mouse ask of the spectator |

use std::io;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context as _;
use consumer_rpc::door::Guest;
use consumer_rpc::owner;
use consumer_rpc::seats::Doing;
use parking_lot::Mutex;
use serde_json::json;

use crate::commands::{self, Commands, Job};
use crate::facts::Facts;
use crate::flight::{Asked, Flight};
use crate::http::{self, Request};

const PAGE: &str = include_str!("page.html");
const HTML: &str = "text/html; charset=utf-8";
const JSON: &str = "application/json";
const TEXT: &str = "text/plain; charset=utf-8";
/// How long a stream waits for a picture before it looks whether anybody is still there.
const PICTURE_WAIT: Duration = Duration::from_secs(1);

/// Everything that requests need.
pub struct Desk {
    domain: String,
    token: String,
    /// What the browser that this program opens may be told the token for, once.
    code: Mutex<Option<String>>,
    facts: Facts,
    flight: Flight,
    commands: Commands,
    jobs: Mutex<Option<Receiver<Job>>>,
    ends: AtomicBool,
}

impl Desk {
    /// Nothing is looked at yet.
    pub fn new(domain: &str, token: &str) -> Desk {
        let (commands, jobs) = commands::queue();
        Desk {
            domain: domain.to_owned(),
            token: token.to_owned(),
            code: Mutex::default(),
            facts: Facts::default(),
            flight: Flight::default(),
            commands,
            jobs: Mutex::new(Some(jobs)),
            ends: AtomicBool::new(false),
        }
    }

    /// From now on a browser of this user is told the token for this code, once: its address stands
    /// in the list of processes, which everybody may read.
    pub fn invite(&self, code: &str) {
        *self.code.lock() = Some(code.to_owned());
    }

    /// Whether this is the code, which is then used up.
    fn redeem(&self, code: &str) -> bool {
        let mut known = self.code.lock();
        let is_it = known
            .as_ref()
            .is_some_and(|known| http::is_same(known, code));
        is_it && known.take().is_some()
    }

    /// Starts the threads that look, ask and fly.
    ///
    /// # Errors
    /// If there can be no more threads.
    pub fn start(self: &Arc<Self>) -> anyhow::Result<Vec<JoinHandle<anyhow::Result<()>>>> {
        let jobs = self.jobs.lock().take();
        let jobs = jobs.context("this desk has been started already")?;
        let thread = |name: &str, work: Box<dyn FnOnce() -> anyhow::Result<()> + Send>| {
            let builder = std::thread::Builder::new().name(name.into());
            builder.spawn(work).context("cannot start a thread")
        };
        let [looks, asks, flies] = [0; 3].map(|_| self.clone());
        Ok(vec![
            thread(
                "look",
                Box::new(move || looks.facts.serve(&looks.domain, &looks.ends)),
            )?,
            thread(
                "ask",
                Box::new(move || commands::serve(&asks.domain, &jobs, &asks.ends)),
            )?,
            thread(
                "fly",
                Box::new(move || flies.flight.serve(&flies.domain, &flies.ends)),
            )?,
        ])
    }

    /// Ends the threads.
    pub fn stop(&self) {
        self.ends.store(true, Ordering::Release);
    }
}

/// Answers one connection.
pub fn serve(desk: &Desk, guest: Guest) {
    let stream = &*guest.stream;
    let served = match &guest.unwelcome {
        Some(why) => http::answer(stream, "403 Forbidden", TEXT, why.as_bytes()),
        None => match http::read(stream) {
            Ok(request) => answer(desk, &guest, &request),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                let why = error.to_string();
                http::answer(stream, "400 Bad Request", TEXT, why.as_bytes())
            }
            Err(error) => Err(error),
        },
    };
    if let Err(error) = served {
        tracing::debug!(%error, "a connection ended early");
    }
}

fn answer(desk: &Desk, guest: &Guest, request: &Request) -> io::Result<()> {
    let stream = &*guest.stream;
    if let Some(code) = &request.code
        && request.misplaced().is_none()
        && is_own_users(stream)
        && desk.redeem(code)
    {
        return http::redirect(stream, &format!("/?token={}", desk.token));
    }
    if let Some(why) = request.refusal(&desk.token) {
        return http::answer(stream, "403 Forbidden", TEXT, why.as_bytes());
    }
    // Whoever knows the token keeps its place when others come.
    guest.seat.pulse.now(Doing::Served);
    let ok = |kind: &str, body: &[u8]| http::answer(stream, "200 OK", kind, body);
    match (request.method.as_str(), request.path.as_str()) {
        ("GET", "/") => ok(HTML, PAGE.as_bytes()),
        ("GET", "/state") => {
            let state = desk.facts.state();
            let known = if state.is_empty() {
                "{}"
            } else {
                state.as_str()
            };
            let flight = json!(desk.flight.line());
            ok(
                JSON,
                format!(r#"{{"flight":{flight},"world":{known}}}"#).as_bytes(),
            )
        }
        ("GET", "/town") => {
            let town = desk.facts.town();
            ok(
                JSON,
                if town.is_empty() {
                    b"{}"
                } else {
                    town.as_bytes()
                },
            )
        }
        ("GET", "/picture") => pictures(desk, stream),
        ("POST", "/command") => match desk.commands.ask(request.body.clone()) {
            Ok(answer) => ok(JSON, &answer),
            Err(error) => {
                let why = error.to_string();
                http::answer(stream, "503 Service Unavailable", TEXT, why.as_bytes())
            }
        },
        ("POST", "/fly") => match serde_json::from_slice::<Vec<Asked>>(&request.body) {
            Ok(asked) => {
                desk.flight.ask(&asked);
                ok(JSON, b"{}")
            }
            Err(error) => {
                let why = format!("this is nothing to fly by: {error}");
                http::answer(stream, "400 Bad Request", TEXT, why.as_bytes())
            }
        },
        ("GET" | "POST", path) => {
            let why = format!("there is nothing at {path}");
            http::answer(stream, "404 Not Found", TEXT, why.as_bytes())
        }
        (method, _) => {
            let why = format!("{method} is not understood; GET and POST are");
            http::answer(stream, "405 Method Not Allowed", TEXT, why.as_bytes())
        }
    }
}

/// Whether a process of this user is at the other end, also where all users are let in.
fn is_own_users(stream: &TcpStream) -> bool {
    let ends = stream
        .peer_addr()
        .and_then(|theirs| Ok((theirs, stream.local_addr()?)));
    ends.and_then(|(theirs, ours)| owner::whose(theirs, ours))
        .is_ok_and(owner::is_ours)
}

/// Sends pictures until the page has gone.
fn pictures(desk: &Desk, stream: &TcpStream) -> io::Result<()> {
    let _watcher = desk.flight.watch();
    http::begin_pictures(stream)?;
    // Whoever has gone is noticed by reading its end.
    stream.set_read_timeout(Some(Duration::from_millis(1)))?;
    let mut number = 0;
    while !desk.ends.load(Ordering::Acquire) {
        match desk.flight.after(number, PICTURE_WAIT) {
            Some((newest, jpeg)) => {
                number = newest;
                http::picture(stream, &jpeg)?;
            }
            None => {
                let mut byte = [0; 1];
                if matches!(stream.peek(&mut byte), Ok(0)) {
                    return Ok(());
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The list of processes shows the code to everybody.
    #[test]
    fn a_code_is_worth_something_once() {
        let desk = Desk::new("town", "secret");
        assert!(!desk.redeem("") && !desk.redeem("abc"));
        desk.invite("abc");
        assert!(!desk.redeem("abd"));
        assert!(desk.redeem("abc"));
        assert!(!desk.redeem("abc"), "it is used up");
    }
}
