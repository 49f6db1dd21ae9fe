//! Looks for the sign that a process is ready.

use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::Duration;

use super::plan::ReadySign;
use crate::bus::Bus;

/// Time for one attempt to connect. A local port answers at once.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(200);

/// Looks once. Lines of output are not examined here, but by the thread that reads them.
pub fn look(sign: &ReadySign, bus: &Bus) -> bool {
    match sign {
        ReadySign::Service(topic) => bus.has_writer(topic),
        ReadySign::Line(_) => false,
        ReadySign::Tcp(address) => address.to_socket_addrs().is_ok_and(|mut addresses| {
            addresses.any(|address| TcpStream::connect_timeout(&address, CONNECT_TIMEOUT).is_ok())
        }),
    }
}

/// The sign in words, for messages.
pub fn describe(sign: &ReadySign) -> String {
    match sign {
        ReadySign::Service(topic) => format!("a writer of {topic}"),
        ReadySign::Line(pattern) => format!("a line that matches {:?}", pattern.as_str()),
        ReadySign::Tcp(address) => format!("a connection to {address}"),
    }
}
