//! CARLA's Traffic Manager, served: what a client's `TrafficManager` asks over msgpack-rpc acts on
//! the desk of the session that drives.
//!
//! A client asks its CARLA server whether a Traffic Manager runs on port 8000. If a gateway of this
//! domain says so, the client connects here instead of driving by itself. Positions and offsets come
//! in CARLA's axes (y to the right), speeds in km/h.
//!
//! [`methods`] holds the table of methods, [`announce`] tells gateways where to find this process,
//! [`keep`] survives a kill.

use std::collections::BTreeSet;
use std::net::{IpAddr, TcpListener};
use std::sync::Arc;

use anyhow::Context as _;
use consumer_driver::parameters::Parameters;
use consumer_rpc::door::{Admits, Door, within_file_limit};
use consumer_rpc::fields::{Fields, Wrong};
use consumer_rpc::message::{self, Request};
use consumer_rpc::place::Place;
use consumer_rpc::server::{self, Peer, Service};
use parking_lot::Mutex;
use schema_bus::Bus;

use crate::desk::Desk;
use crate::requests::{Counter, Requests, channel};
use announce::Notice;
use keep::Record;

mod announce;
mod keep;
pub mod methods;

/// What a Traffic Manager begins with: as CARLA's does, it leaves lamps alone and removes vehicles
/// that cannot go on.
pub fn parameters() -> Parameters {
    Parameters {
        updates_lights: false,
        removes_at_dead_ends: true,
        removes_stuck: true,
        ..Parameters::default()
    }
}

/// The Traffic Manager of one session.
#[derive(Debug)]
pub struct Manager {
    counter: Counter,
    /// Connections that have asked something; what clients set for all vehicles ends with the last.
    clients: Mutex<BTreeSet<u64>>,
}

impl Manager {
    /// The manager of the session behind `counter`.
    pub fn new(counter: Counter) -> Manager {
        Manager {
            counter,
            clients: Mutex::default(),
        }
    }
}

impl Service for Manager {
    fn serve(&self, peer: Peer, request: Request) -> Result<Vec<u8>, Wrong> {
        self.clients.lock().insert(peer.number);
        let method = request.method.as_str();
        let Some(run) = methods::find(method) else {
            let error = message::unknown(method, request.args.len());
            tracing::warn!(error, "unknown call");
            return Ok(message::failure(request.id, &error));
        };
        let mut args = Fields::new("the arguments", &request.args);
        Ok(match run(&self.counter, &mut args) {
            Ok(result) => message::success(request.id, result),
            Err(wrong) => {
                tracing::warn!(method, error = %wrong, "refused a call");
                message::failure(request.id, &format!("{method}: {wrong}"))
            }
        })
    }

    /// What was set for all vehicles ends with the last client: the next script begins with what it
    /// expects. Vehicles stay on autopilot.
    fn closed(&self, number: u64) {
        let mut clients = self.clients.lock();
        if clients.remove(&number) && clients.is_empty() {
            tracing::info!("the last client has gone; settings for all vehicles begin anew");
            drop(clients);
            methods::change(&self.counter, Desk::reset_common);
        }
    }
}

/// The session's side of a served Traffic Manager.
#[derive(Debug)]
pub struct Served {
    /// What clients ask.
    pub(crate) requests: Requests,
    /// Ports at which clients look for it.
    ports: Vec<u16>,
    place: Place,
    notices: Vec<Notice>,
    record: Record,
}

impl Served {
    /// Listens at `bind`, on the first of `ports` if it is free and else on any, and serves clients
    /// until the process ends. Gateways of `domain` are told when the session begins.
    ///
    /// # Errors
    /// No socket, or no thread.
    pub fn start(
        domain: &str,
        bind: IpAddr,
        admits: Admits,
        ports: Vec<u16>,
    ) -> anyhow::Result<Served> {
        let first = ports.first().copied().unwrap_or(0);
        let listener = TcpListener::bind((bind, first))
            .or_else(|_| TcpListener::bind((bind, 0)))
            .with_context(|| format!("cannot listen on {bind}; choose another with --bind"))?;
        let place = announce::place_of(&listener)?;
        let door = Door::new(
            listener,
            "Traffic Manager connections",
            within_file_limit(server::MAX_RPC_CONNECTIONS),
            admits,
        )?;
        let (counter, requests) = channel().context("cannot make a socket pair")?;
        let manager = Arc::new(Manager::new(counter));
        std::thread::Builder::new()
            .name("managers".into())
            .spawn(move || server::serve(door, &manager))
            .context("cannot start a thread")?;
        Ok(Served {
            requests,
            record: Record::new(domain, first),
            ports,
            place,
            notices: Vec::new(),
        })
    }

    /// Where it listens.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Its ports, as part of a name.
    pub(crate) fn name(&self) -> String {
        let ports: Vec<String> = self.ports.iter().map(u16::to_string).collect();
        ports.join("-")
    }

    /// Tells gateways where it is.
    pub(crate) fn announce(&mut self, bus: &Bus) -> anyhow::Result<()> {
        for port in &self.ports {
            self.notices.push(Notice::open(bus, *port, &self.place)?);
        }
        Ok(())
    }

    /// Tells gateways that have started since.
    pub(crate) fn greet(&self) {
        self.notices.iter().for_each(Notice::greet);
    }

    /// Goes on where a process of the same ports was killed.
    pub(crate) fn recall(&mut self, desk: &mut Desk) {
        self.record.recall(desk);
    }

    /// Keeps what is set, for a process that takes over.
    pub(crate) fn keep(&mut self, desk: &Desk, has_changed: bool) {
        self.record.keep(desk, has_changed);
    }

    /// An orderly end: nobody takes over.
    pub(crate) fn end(&mut self) {
        self.record.remove();
    }
}
