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
use launch_cli::logging::cut;
use parking_lot::Mutex;
use schema_bus::Bus;

use crate::desk::{Answer, Desk};
use crate::requests::{Counter, Requests, channel};
use announce::Notice;
use keep::Record;
use methods::{Client, PATIENCE};

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
        let account = &peer.account;
        self.clients.lock().insert(account.number());
        let Some((method, run)) = methods::find(&request.method) else {
            let error = message::unknown(&request.method, request.args.len());
            if let Some(n_unsaid) = account.may_warn() {
                // The name in it has been cut.
                tracing::warn!(error, n_unsaid, "unknown call");
            }
            return Ok(message::failure(request.id, &error));
        };
        let client = Client {
            counter: &self.counter,
            account,
            request: peer.request.clone(),
            method,
        };
        let mut args = Fields::new("the arguments", &request.args);
        Ok(match run(&client, &mut args) {
            Ok(result) => message::success(request.id, result),
            Err(wrong) => {
                if let Some(n_unsaid) = account.may_warn() {
                    let error = wrong.to_string();
                    tracing::warn!(method, error = %cut(&error), n_unsaid, "refused a call");
                }
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
            // A session that ends has nothing to reset.
            let _ = self.counter.ask(Desk::reset_common, PATIENCE);
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
            record: Record::new(domain, first)?,
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

    /// Keeps what is set, for a process that takes over, and tells who asked.
    pub(crate) fn keep(&mut self, desk: &Desk, answers: Vec<Answer>) {
        self.record.keep(desk, answers);
    }

    /// An orderly end: nobody takes over.
    pub(crate) fn end(&mut self) {
        self.record.remove();
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::net::TcpStream;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    use consumer_rpc::budget::MAX_CONNECTION_BYTES;
    use consumer_rpc::list;
    use consumer_rpc::msgpack::{self, Limits, Value};

    use super::*;
    use crate::desk::tests::list as actors;

    /// Bytes that this process may need beside: other tests run in it, too.
    const BESIDE_BYTES: usize = 256 << 20;

    /// Memory that this process has of the machine, without what was freed.
    fn resident_bytes() -> usize {
        launch_cli::heap::give_back();
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.unwrap().trim().trim_end_matches(" kB");
        kib.parse::<usize>().unwrap() << 10
    }

    /// Every method with vehicles that exist and that do not, with long paths and with nonsense.
    #[test]
    fn memory_is_bounded_whatever_clients_set() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let door = Door::new(listener, "test connections", 8, Admits::AnyUser).unwrap();
        let (counter, requests) = channel().unwrap();
        let manager = Arc::new(Manager::new(counter));
        std::thread::spawn(move || server::serve(door, &manager));
        let ends = Arc::new(AtomicBool::new(false));
        let ended = ends.clone();
        let session = std::thread::spawn(move || {
            let mut desk = Desk::new(crate::desk::Start::default());
            desk.set_episode(1, 1);
            desk.set_actors(actors(&[7, 8, 9]));
            while !ended.load(Ordering::Acquire) {
                let all = requests.take();
                if all.is_empty() {
                    std::thread::sleep(Duration::from_millis(1));
                }
                all.into_iter().for_each(|request| request(&mut desk)());
            }
            serde_json::to_vec(&desk.memory()).unwrap().len()
        });
        let connect = || {
            let client = TcpStream::connect(address).unwrap();
            client
                .set_read_timeout(Some(Duration::from_secs(60)))
                .unwrap();
            client
        };
        // Whether there was an answer.
        let call = |client: &mut TcpStream, method: &str, args: Vec<Value>| {
            let mut bytes = Vec::new();
            msgpack::write(&mut bytes, &list![0u32, 1u32, method, Value::Array(args)]);
            client.write_all(&bytes).is_ok() && msgpack::read(client, Limits::default()).is_ok()
        };
        let before = resident_bytes();
        let path = Value::Array(vec![list![1.0f64, 2.0f64, 3.0f64]; 100_000]);
        let text = Value::from("x".repeat(8 << 20));
        for method in methods::names().chain(["x"]) {
            let mut client = connect();
            for id in [7u32, 8, 9, 10, 5_000_000, u32::MAX] {
                let forms = [
                    vec![id.into(), path.clone(), true.into()],
                    vec![list![id], path.clone(), true.into()],
                    vec![list![id], list![8u32], 50.0f32.into()],
                    vec![list![list![id], list![8u32]]],
                    vec![text.clone()],
                ];
                for args in forms {
                    assert!(call(&mut client, method, args), "{method} {id}");
                }
            }
        }
        // Very many vehicles that do not exist, as fast as one can.
        let mut client = connect();
        for id in 0..4_000u32 {
            let args = vec![list![id * 1000], 50.0f32.into()];
            assert!(call(&mut client, "set_percentage_running_light", args));
        }
        let grown = resident_bytes().saturating_sub(before);
        let most = MAX_CONNECTION_BYTES + BESIDE_BYTES;
        assert!(grown < most, "{} MiB", grown >> 20);
        ends.store(true, Ordering::Release);
        let n_bytes = session.join().unwrap();
        assert!(n_bytes < 64 << 20, "a file of {n_bytes} bytes");
    }
}
