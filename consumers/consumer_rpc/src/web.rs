//! Heads of HTTP requests, bounded in size and time, and whether a browser's request is for this
//! server and from a page that may ask.
//!
//! A browser sends requests of any page to any address. Two lines of the head tell who asks, and no
//! page can change them: `Origin` names the page's site, and `Host` the name by which the browser
//! found this server. A page whose own name was made to point to this machine (DNS rebinding) names
//! a host that is not one of this server's.

use std::io::{self, BufRead, Read};
use std::net::{IpAddr, TcpStream};
use std::time::{Duration, Instant};

/// Longest head of a request, bytes.
pub const MAX_HEAD_BYTES: u64 = 16 << 10;

/// Reads a connection until a moment, however often a byte comes.
#[derive(Debug)]
pub struct Until<'s> {
    stream: &'s TcpStream,
    until: Instant,
}

impl<'s> Until<'s> {
    /// Reads for so long from now on.
    pub fn new(stream: &'s TcpStream, patience: Duration) -> Until<'s> {
        Until {
            stream,
            until: Instant::now() + patience,
        }
    }
}

impl Read for Until<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(into)
    }
}

/// The head of a request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// `GET` or another method.
    pub method: String,
    /// Path and query.
    pub target: String,
    /// The head as it came, up to the empty line that ends it.
    pub bytes: Vec<u8>,
    /// Names in lower case, and values.
    fields: Vec<(String, String)>,
}

impl Head {
    /// Reads a head and nothing behind it.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] with a sentence if it is none or is too long, and what reading
    /// fails with.
    pub fn read(source: &mut impl BufRead) -> io::Result<Head> {
        let mut source = source.take(MAX_HEAD_BYTES);
        let mut head = Head::default();
        let first = line(&mut source, &mut head.bytes)?;
        let mut words = first.split(' ');
        let (Some(method), Some(target)) = (words.next(), words.next()) else {
            return Err(wrong("this is no request of HTTP"));
        };
        (head.method, head.target) = (method.to_owned(), target.to_owned());
        loop {
            let line = line(&mut source, &mut head.bytes)?;
            if line.is_empty() {
                break;
            }
            let Some((name, value)) = line.split_once(':') else {
                return Err(wrong("a line of the request's head has no name"));
            };
            let field = (name.to_ascii_lowercase(), value.trim().to_owned());
            head.fields.push(field);
        }
        for name in ["host", "origin"] {
            if head
                .fields
                .iter()
                .filter(|(known, _)| known == name)
                .count()
                > 1
            {
                return Err(wrong("the request's head names its host or origin twice"));
            }
        }
        Ok(head)
    }

    /// The value of a field, by its name in lower case; the last one if it occurs several times.
    pub fn field(&self, name: &str) -> Option<&str> {
        let mut found = self.fields.iter().rev().filter(|(known, _)| known == name);
        found.next().map(|(_, value)| value.as_str())
    }

    /// Host and port by which the client found this server; empty if it does not say.
    pub fn host(&self) -> &str {
        self.field("host").unwrap_or_default()
    }

    /// Whether the client found this server by an address of it: `localhost`, an address of the
    /// machine itself (as through `ssh -L 9000:127.0.0.1:8800`), or `ours`, the address that the
    /// connection came to; or by one of the `names`. The port may be another one.
    pub fn names_host(&self, ours: IpAddr, names: &[String]) -> bool {
        let name = host_name(self.host());
        let address = name.trim_start_matches('[').trim_end_matches(']');
        if let Ok(address) = address.parse::<IpAddr>() {
            let address = address.to_canonical();
            return address.is_loopback() || address == ours.to_canonical();
        }
        name.eq_ignore_ascii_case("localhost")
            || names.iter().any(|own| own.eq_ignore_ascii_case(name))
    }

    /// The site of the page that asks, if it is neither this server's own nor one of `origins`.
    /// Programs that are no browsers name none.
    pub fn foreign_origin(&self, origins: &[String]) -> Option<&str> {
        let origin = self.field("origin")?;
        let is_own = origin
            .strip_prefix("http://")
            .is_some_and(|site| site == self.host());
        let is_allowed = origins.iter().any(|own| own.eq_ignore_ascii_case(origin));
        (!is_own && !is_allowed).then_some(origin)
    }
}

/// The host without its port.
fn host_name(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if !name.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    }
}

fn wrong(sentence: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, sentence.to_owned())
}

/// The next line without its end.
fn line(source: &mut impl BufRead, bytes: &mut Vec<u8>) -> io::Result<String> {
    let from = bytes.len();
    source.read_until(b'\n', bytes)?;
    let line = std::str::from_utf8(&bytes[from..]);
    match line {
        Ok(line) if line.ends_with('\n') => Ok(line.trim_end().to_owned()),
        Ok(_) => Err(wrong("the request's head is too long or not whole")),
        Err(_) => Err(wrong("the request's head is not UTF-8")),
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    fn head(text: &str) -> io::Result<Head> {
        Head::read(&mut text.as_bytes())
    }

    fn of(host: &str, origin: &str) -> Head {
        head(&format!(
            "GET / HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\n\r\n"
        ))
        .unwrap()
    }

    #[test]
    fn a_head_is_read_as_it_came_and_nothing_behind_it() {
        let text = "GET /a?b HTTP/1.1\r\nHost: localhost:1\r\nX-A:  1 \r\n\r\n";
        let whole = format!("{text}behind");
        let mut source = whole.as_bytes();
        let head = Head::read(&mut source).unwrap();
        assert_eq!((&*head.method, &*head.target), ("GET", "/a?b"));
        assert_eq!((head.host(), head.field("x-a")), ("localhost:1", Some("1")));
        assert_eq!(
            (&*head.bytes, source),
            (text.as_bytes(), b"behind".as_slice())
        );
    }

    #[test]
    fn wrong_and_long_heads_are_refused() {
        let long = format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "a".repeat(20_000));
        for wrong in [
            "",
            "GET\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: x",
            "GET / HTTP/1.1\r\nno name\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: localhost\r\nhost: evil.example\r\n\r\n",
            "GET / HTTP/1.1\r\nOrigin: null\r\nOrigin: http://localhost\r\n\r\n",
            &long,
        ] {
            let error = head(wrong).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{wrong:.40}");
        }
    }

    #[test]
    fn only_names_of_this_server_are_its_host() {
        let here: IpAddr = "192.168.1.7".parse().unwrap();
        let names = ["rover.local".to_owned()];
        for (host, is_ours) in [
            ("127.0.0.1:8765", true),
            ("localhost:9000", true),
            ("LOCALHOST", true),
            ("[::1]:8765", true),
            ("192.168.1.7:8765", true),
            ("[::ffff:192.168.1.7]:1", true),
            ("rover.local:8765", true),
            ("192.168.1.8:8765", false),
            ("evil.example:8765", false),
            ("127.0.0.1.evil.example", false),
            ("localhost.evil.example:1", false),
            ("", false),
            (":8765", false),
        ] {
            assert_eq!(of(host, "x").names_host(here, &names), is_ours, "{host}");
        }
    }

    #[test]
    fn pages_of_other_sites_are_foreign() {
        let allowed = ["https://app.foxglove.dev".to_owned()];
        for (origin, is_foreign) in [
            ("https://app.foxglove.dev", false),
            ("http://localhost:8765", false),
            ("https://app.foxglove.dev.evil.example", true),
            ("http://app.foxglove.dev", true),
            ("http://localhost:8766", true),
            ("null", true),
            ("", true),
        ] {
            let head = of("localhost:8765", origin);
            let found = head.foreign_origin(&allowed);
            assert_eq!(found.is_some(), is_foreign, "{origin}");
        }
        let program = head("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        assert_eq!(program.foreign_origin(&[]), None);
    }

    /// Bytes that come one by one do not extend the time.
    #[test]
    fn a_slow_client_is_read_only_so_long() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (here, _) = listener.accept().unwrap();
        let mut until = Until::new(&here, Duration::ZERO);
        io::Write::write_all(&mut &client, b"GET").unwrap();
        let error = until.read(&mut [0; 3]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }
}
