//! The door in front of Foxglove's server, which itself answers every page that a browser shows.
//!
//! Only requests that name this server as their host and come from no page, or from one of Foxglove,
//! are passed on. The server behind listens on an address of the loopback network that is drawn anew
//! at every start (24 random bits, and a port), so that no page finds it; the protocol has no
//! password by which the server could tell who asks, and its library takes connections from nobody
//! but itself.

use std::io::{self, BufReader, Read, Write as _};
use std::net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use consumer_rpc::door::{Admits, Door, Guest};
use consumer_rpc::seats::Doing;
use consumer_rpc::web::{Head, Until};
use launch_cli::accept::Seldom;
use launch_cli::logging::cut;

/// Site of Foxglove's application in the browser.
pub const APPLICATION: &str = "https://app.foxglove.dev";
/// Most clients of Foxglove at a time.
pub const MAX_FOXGLOVE_CLIENTS: usize = 64;
/// How long a client may take to say what it wants.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Bytes that are passed on at a time: images are large.
const PIECE: usize = 256 << 10;

/// Whose requests are passed on.
#[derive(Clone, Debug)]
pub struct Allowed {
    /// Names of this server, beside its addresses.
    hosts: Vec<String>,
    /// Sites whose pages may connect.
    origins: Vec<String>,
}

impl Allowed {
    /// Foxglove's own site and this machine's name, and what the user adds: sites
    /// (`https://HOST:PORT`) and names of this machine.
    pub fn new(more: &[String]) -> Allowed {
        let (origins, hosts): (Vec<String>, Vec<String>) =
            more.iter().cloned().partition(|name| name.contains("://"));
        let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let machine = machine.trim();
        let own = [machine.to_owned(), format!("{machine}.local")];
        Allowed {
            hosts: hosts
                .into_iter()
                .chain(own.into_iter().filter(|_| !machine.is_empty()))
                .collect(),
            origins: [APPLICATION.to_owned()]
                .into_iter()
                .chain(origins)
                .collect(),
        }
    }

    /// Why a request that came to `ours` is not passed on, if it is not.
    fn refusal(&self, head: &Head, ours: IpAddr) -> Option<String> {
        if !head.names_host(ours, &self.hosts) {
            let host = cut(head.host());
            return Some(format!(
                "this server is not known as {host:?}; connect to it by its address, or start gantry-bridge with --foxglove-allow and that name"
            ));
        }
        let origin = head.foreign_origin(&self.origins)?;
        let origin = cut(origin);
        Some(format!(
            "pages of {origin:?} may not connect, those of {APPLICATION} may; if you trust this one, start gantry-bridge with --foxglove-allow and that origin"
        ))
    }
}

/// What `--foxglove-allow` takes.
///
/// # Errors
/// A sentence for what is neither a site nor a name.
pub fn allowed(text: &str) -> Result<String, String> {
    let host = text.split_once("://").map_or(text, |(_, host)| host);
    let is_name = |c: char| c.is_ascii_alphanumeric() || "-._:[]".contains(c);
    // Browsers name a page that is a file by this, without a host.
    let is_fine = text == "file://" || !host.is_empty() && host.chars().all(is_name);
    match is_fine {
        true => Ok(text.to_owned()),
        false => Err(format!(
            "{text:?} is neither a site nor a host; write https://HOST or https://HOST:PORT without a path, or HOST"
        )),
    }
}

/// An address of this machine that nobody can guess, for the server behind.
///
/// # Errors
/// If the system has no random numbers.
pub fn hidden() -> anyhow::Result<IpAddr> {
    let mut bytes = [0u8; 3];
    std::fs::File::open("/dev/urandom")
        .and_then(|mut file| file.read_exact(&mut bytes))
        .context("cannot read /dev/urandom")?;
    // 0 and 255 are left out: 127.255.255.255 is no address of a host.
    let [a, b, c] = bytes.map(|byte| 1 + byte % 254);
    Ok(IpAddr::V4(Ipv4Addr::new(127, a, b, c)))
}

/// Lets clients in at `listener` and passes them on to the server at `behind`, until the process
/// ends.
///
/// # Errors
/// If the system gives no thread.
pub fn open(listener: TcpListener, behind: SocketAddr, allowed: Allowed) -> anyhow::Result<()> {
    let door = Door::new(
        listener,
        "Foxglove connections",
        MAX_FOXGLOVE_CLIENTS,
        Admits::AnyUser,
    )?;
    let refusals = Seldom::default();
    std::thread::Builder::new()
        .name("foxglove".into())
        .spawn(move || {
            Arc::new(door).serve(move |guest| {
                if let Err(error) = serve(&guest, behind, &allowed, &refusals) {
                    tracing::debug!(%error, "a connection of Foxglove ended");
                }
            });
        })
        .context("the system gives no thread")?;
    Ok(())
}

fn serve(
    guest: &Guest,
    behind: SocketAddr,
    allowed: &Allowed,
    refusals: &Seldom,
) -> io::Result<()> {
    let client = &*guest.stream;
    let mut source = BufReader::new(Until::new(client, HEAD_TIMEOUT));
    let head = match Head::read(&mut source) {
        Ok(head) => head,
        Err(error) if error.kind() == io::ErrorKind::InvalidData => {
            return answer(client, "400 Bad Request", &error.to_string());
        }
        Err(error) => return Err(error),
    };
    if let Some(why) = allowed.refusal(&head, client.local_addr()?.ip()) {
        if let Some(n_unsaid) = refusals.is_due() {
            tracing::warn!(n_unsaid, "refused a client of Foxglove: {why}");
        }
        return answer(client, "403 Forbidden", &why);
    }
    let server = TcpStream::connect(behind)?;
    server.set_nodelay(true)?;
    (&server).write_all(&head.bytes)?;
    (&server).write_all(source.buffer())?;
    client.set_read_timeout(None)?;
    guest.seat.pulse.now(Doing::Served);
    std::thread::scope(|scope| {
        let back = std::thread::Builder::new()
            .name("foxglove".into())
            .spawn_scoped(scope, || pass_on(&server, client));
        if back.is_ok() {
            pass_on(client, &server);
        }
        end(client, &server);
        back.map(drop)
    })
}

/// Passes on what comes until one of the two has gone.
fn pass_on(mut from: &TcpStream, mut to: &TcpStream) {
    let mut piece = vec![0; PIECE];
    loop {
        match from.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => {
                if to.write_all(&piece[..n]).is_err() {
                    break;
                }
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(_) => break,
        }
    }
    end(from, to);
}

/// Ends both connections, which wakes the other direction.
fn end(one: &TcpStream, other: &TcpStream) {
    // Either may have ended already.
    let _ = one.shutdown(Shutdown::Both);
    let _ = other.shutdown(Shutdown::Both);
}

fn answer(mut client: &TcpStream, status: &str, why: &str) -> io::Result<()> {
    let length = why.len();
    let text = format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{why}"
    );
    client.write_all(text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A server of Foxglove's library behind a gate; the address of the gate.
    fn gate(
        more: &[&str],
    ) -> (
        SocketAddr,
        Arc<foxglove::Context>,
        foxglove::WebSocketServerHandle,
    ) {
        let (hidden, context) = (hidden().unwrap(), foxglove::Context::new());
        let server = foxglove::WebSocketServer::new()
            .bind(hidden.to_string(), 0)
            .context(&context)
            .start_blocking()
            .unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let more: Vec<String> = more.iter().map(|name| allowed(name).unwrap()).collect();
        let behind = SocketAddr::new(hidden, server.port());
        open(listener, behind, Allowed::new(&more)).unwrap();
        (address, context, server)
    }

    /// First line and rest of the answer to a handshake.
    fn shake(gate: SocketAddr, host: &str, origin: Option<&str>) -> (String, String) {
        let mut client = TcpStream::connect(gate).unwrap();
        let origin = origin.map_or(String::new(), |origin| format!("Origin: {origin}\r\n"));
        let request = format!(
            "GET / HTTP/1.1\r\nHost: {host}\r\n{origin}Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        );
        client.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        // One that is let in goes on to be sent things.
        let mut byte = [0];
        while !answer.ends_with(b"\r\n\r\n") && client.read(&mut byte).unwrap() == 1 {
            answer.push(byte[0]);
        }
        if answer.starts_with(b"HTTP/1.1 4") {
            client.read_to_end(&mut answer).unwrap();
        }
        let answer = String::from_utf8(answer).unwrap();
        let (first, rest) = answer.split_once("\r\n").unwrap();
        (first.to_owned(), rest.to_owned())
    }

    #[test]
    fn programs_and_foxglove_come_in_and_pages_of_others_do_not() {
        let (gate, _context, server) = gate(&["https://lab.example:8443", "rover.example"]);
        let own = gate.to_string();
        for (host, origin) in [
            (own.as_str(), None),
            ("localhost:9000", None),
            (&own, Some(APPLICATION)),
            (&own, Some("https://lab.example:8443")),
            ("rover.example:8765", None),
        ] {
            let (first, _) = shake(gate, host, origin);
            assert!(first.contains(" 101 "), "{host} {origin:?}: {first}");
        }
        for (host, origin, names) in [
            (own.as_str(), Some("https://evil.example"), "evil.example"),
            (&own, Some("null"), "null"),
            (
                "evil.example:8765",
                Some("http://evil.example:8765"),
                "evil.example",
            ),
            ("evil.example:8765", None, "evil.example"),
        ] {
            let (first, rest) = shake(gate, host, origin);
            assert!(first.contains(" 403 "), "{host} {origin:?}: {first}");
            assert!(
                rest.contains(names) && rest.contains("--foxglove-allow"),
                "{rest}"
            );
        }
        let mut odd = TcpStream::connect(gate).unwrap();
        odd.write_all(b"hello\r\n\r\n").unwrap();
        let mut answer = String::new();
        odd.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 400 "), "{answer}");
        drop(server.stop());
    }

    #[test]
    fn only_sites_and_hosts_can_be_allowed() {
        for fine in [
            "https://a.example",
            "http://[::1]:80",
            "rover.local",
            "file://",
        ] {
            assert!(allowed(fine).is_ok(), "{fine}");
        }
        for wrong in ["", "https://", "https://a.example/path", "a b", "*"] {
            assert!(
                allowed(wrong).unwrap_err().contains("https://HOST"),
                "{wrong}"
            );
        }
    }
}
