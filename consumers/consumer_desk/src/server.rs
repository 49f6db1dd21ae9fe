//! Which request is answered how.
//!
//! | request | answer |
//! |---|---|
//! | `GET /` | the page |
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
            facts: Facts::default(),
            flight: Flight::default(),
            commands,
            jobs: Mutex::new(Some(jobs)),
            ends: AtomicBool::new(false),
        }
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
            Ok(request) => answer(desk, stream, &request),
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

fn answer(desk: &Desk, stream: &TcpStream, request: &Request) -> io::Result<()> {
    if let Some(why) = request.refusal(&desk.token) {
        return http::answer(stream, "403 Forbidden", TEXT, why.as_bytes());
    }
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
