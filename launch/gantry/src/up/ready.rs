//! When a process counts as ready: its sign has been seen, and it has taken its place in lockstep.

use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use super::lockstep::LockstepWatch;
use super::plan::{Plan, ReadySign};
use crate::bus::Bus;

/// Time for one attempt to connect. A local port answers at once.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(200);

/// What a running process lacks until it is ready, and since when that is waited for.
#[derive(Clone, Copy, Debug)]
pub struct Readiness {
    sign_missing: bool,
    place_missing: bool,
    since: Instant,
}

impl Readiness {
    /// Of a process that has just been started.
    pub fn of(plan: &Plan) -> Self {
        Readiness {
            sign_missing: plan.ready.is_some(),
            place_missing: plan.lockstep,
            since: Instant::now(),
        }
    }

    /// Whether nothing is missing.
    pub fn is_complete(&self) -> bool {
        !self.sign_missing && !self.place_missing
    }

    /// Whether it has not joined lockstep, although it takes part.
    pub fn lacks_place(&self) -> bool {
        self.place_missing
    }

    /// How long it has been waited for.
    pub fn waited(&self) -> Duration {
        self.since.elapsed()
    }

    /// When it must be ready.
    pub fn until(&self, plan: &Plan) -> Instant {
        self.since + plan.ready_within
    }

    /// Whether it is looked for what is missing. A line of output reports itself.
    pub fn needs_looks(&self, plan: &Plan) -> bool {
        let reports_itself = matches!(plan.ready, Some(ReadySign::Line(_)));
        self.place_missing || (self.sign_missing && !reports_itself)
    }

    /// Looks once for what is missing.
    pub fn look(&mut self, plan: &Plan, bus: &Bus, lockstep: &LockstepWatch) {
        self.place_missing &= !lockstep.has(&plan.name);
        if let (true, Some(sign)) = (self.sign_missing, &plan.ready) {
            self.sign_missing = !is_seen(sign, bus);
        }
    }

    /// A line of its output was its sign. Returns whether it is ready by that.
    pub fn said(&mut self) -> bool {
        std::mem::take(&mut self.sign_missing) && self.is_complete()
    }

    /// The daemon has been started anew: the place is lost, and the time begins again.
    pub fn join_again(&mut self) {
        self.place_missing = true;
        self.since = Instant::now();
    }

    /// Why it is not ready, once the longest wait is over.
    pub fn sentence(&self, plan: &Plan, lockstep: &LockstepWatch) -> String {
        let (name, within) = (&plan.name, plan.ready_within.as_secs_f64());
        if let (true, Some(sign)) = (self.sign_missing, &plan.ready) {
            let sign = describe(sign);
            return format!(
                "process {name} was not ready within {within} s: there was no sign of {sign}"
            );
        }
        let others = match lockstep.participants() {
            [] => "nobody".to_owned(),
            names => names.join(", "),
        };
        let held = if lockstep.has_begun() {
            ""
        } else {
            ", and the first tick waits for it"
        };
        format!(
            "process {name} did not join lockstep as {name:?} within {within} s{held}; taking part: {others}"
        )
    }
}

/// Looks once. Lines of output are not examined here, but by the thread that reads them.
fn is_seen(sign: &ReadySign, bus: &Bus) -> bool {
    match sign {
        ReadySign::Service(topic) => bus.has_writer(topic),
        ReadySign::Line(_) => false,
        ReadySign::Tcp(address) => address.to_socket_addrs().is_ok_and(|mut addresses| {
            addresses.any(|address| TcpStream::connect_timeout(&address, CONNECT_TIMEOUT).is_ok())
        }),
    }
}

/// The sign in words, for messages.
fn describe(sign: &ReadySign) -> String {
    match sign {
        ReadySign::Service(topic) => format!("a writer of {topic}"),
        ReadySign::Line(pattern) => format!("a line that matches {:?}", pattern.as_str()),
        ReadySign::Tcp(address) => format!("a connection to {address}"),
    }
}
