//! Requests of a browser as far as this program needs them, bounded in size and time, and who may
//! make them.
//!
//! A request is answered if it knows the token and names a port of this machine as its host: a page of another
//! site knows no token, and one whose name was bent to 127.0.0.1 names another host. No answer lets
//! pages of other sites read it.

use std::io::{self, BufRead as _, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Longest head of a request, bytes.
const MAX_HEAD: u64 = 16 << 10;
/// Longest body of a request, bytes.
const MAX_BODY: usize = 1 << 20;
/// How long a request may stop coming. Who sends a byte now and then keeps a place of a door that
/// lets in its own user alone.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// A request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// `GET` or `POST`.
    pub method: String,
    /// Path without the query.
    pub path: String,
    /// Token of the query or of the header.
    pub token: String,
    /// Whether the token stood in the header, which forms of other sites cannot set.
    pub is_deliberate: bool,
    host: String,
    origin: Option<String>,
    /// Body.
    pub body: Vec<u8>,
}

/// Reads one request.
///
/// # Errors
/// If it does not come in time, is none or is too large.
pub fn read(stream: &TcpStream) -> io::Result<Request> {
    stream.set_read_timeout(Some(REQUEST_TIMEOUT))?;
    read_from(stream)
}

fn read_from(source: impl Read) -> io::Result<Request> {
    let wrong = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let mut source = BufReader::new(source);
    let mut head = (&mut source).take(MAX_HEAD);
    let mut line = || -> io::Result<String> {
        let mut line = String::new();
        head.read_line(&mut line)?;
        match line.ends_with('\n') {
            true => Ok(line.trim_end().to_owned()),
            false => Err(wrong("the request's head is too long or not whole")),
        }
    };
    let first = line()?;
    let mut words = first.split(' ');
    let (Some(method), Some(target)) = (words.next(), words.next()) else {
        return Err(wrong("this is no request of HTTP"));
    };
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let mut request = Request {
        method: method.to_owned(),
        path: path.to_owned(),
        ..Request::default()
    };
    for pair in query.split('&') {
        if let Some(token) = pair.strip_prefix("token=") {
            request.token = token.to_owned();
        }
    }
    let mut n_body = 0;
    loop {
        let line = line()?;
        if line.is_empty() {
            break;
        }
        let Some((name, value)) = line.split_once(':') else {
            return Err(wrong("a line of the request's head has no name"));
        };
        let value = value.trim();
        match name.to_ascii_lowercase().as_str() {
            "host" => request.host = value.to_owned(),
            "origin" => request.origin = Some(value.to_owned()),
            "x-gantry-token" => {
                request.token = value.to_owned();
                request.is_deliberate = true;
            }
            "content-length" => {
                n_body = value
                    .parse()
                    .ok()
                    .filter(|n| *n <= MAX_BODY)
                    .ok_or_else(|| wrong("the request's body is too long"))?;
            }
            "transfer-encoding" => return Err(wrong("bodies in pieces are not understood")),
            _ => {}
        }
    }
    request.body = vec![0; n_body];
    source.read_exact(&mut request.body)?;
    Ok(request)
}

impl Request {
    /// Why it is not answered, if it is not.
    pub fn refusal(&self, token: &str) -> Option<&'static str> {
        if !self.names_this_machine() {
            return Some(
                "this page is on 127.0.0.1 only; open the address that gantry-desk printed",
            );
        }
        let own = format!("http://{}", self.host);
        if self.origin.as_ref().is_some_and(|origin| *origin != own) {
            return Some("pages of other sites are not answered");
        }
        if !is_same(&self.token, token) {
            return Some("the address lacks its token; open the one that gantry-desk printed");
        }
        if self.method == "POST" && !self.is_deliberate {
            return Some("the header X-Gantry-Token is missing");
        }
        None
    }

    /// Whether it came to a port of this machine: this program's, or that of a tunnel, as through
    /// `ssh -L 9000:127.0.0.1:8800`.
    fn names_this_machine(&self) -> bool {
        let port = |name: &str| {
            let port = self.host.strip_prefix(name)?.strip_prefix(':')?;
            port.parse::<u16>().ok()
        };
        ["127.0.0.1", "localhost"]
            .iter()
            .any(|name| port(name).is_some())
    }
}

/// Compares in a time that does not hang on where they differ.
fn is_same(a: &str, b: &str) -> bool {
    let pairs = a.bytes().zip(b.bytes());
    a.len() == b.len() && pairs.fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// What every answer says: nothing is kept, framed, guessed or handed on.
const GUARDS: &str = "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
Referrer-Policy: no-referrer\r\nContent-Security-Policy: default-src 'none'; img-src 'self'; \
connect-src 'self'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; frame-ancestors 'none'\r\n";

/// Writes an answer and ends the connection.
///
/// # Errors
/// If the other end has gone.
pub fn answer(mut to: &TcpStream, status: &str, kind: &str, body: &[u8]) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n{GUARDS}\r\n",
        body.len()
    );
    to.write_all(head.as_bytes())?;
    to.write_all(body)
}

/// Boundary between the pictures of a stream.
const BOUNDARY: &str = "gantry-picture";

/// Begins an answer of pictures, each of which replaces the one before.
///
/// # Errors
/// If the other end has gone.
pub fn begin_pictures(mut to: &TcpStream) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\nConnection: close\r\n{GUARDS}\r\n"
    );
    to.write_all(head.as_bytes())
}

/// Sends the next picture.
///
/// # Errors
/// If the other end has gone.
pub fn picture(mut to: &TcpStream, jpeg: &[u8]) -> io::Result<()> {
    let head = format!(
        "--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
        jpeg.len()
    );
    to.write_all(&[head.as_bytes(), jpeg, b"\r\n"].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(text: &str) -> Request {
        read_from(text.as_bytes()).unwrap()
    }

    #[test]
    fn requests_are_read_and_bounded() {
        let read = request(
            "POST /command?x=1&token=abc HTTP/1.1\r\nHost: localhost:8800\r\nContent-Length: 2\r\n\r\nhi!",
        );
        assert_eq!((&*read.method, &*read.path), ("POST", "/command"));
        assert_eq!((&*read.token, &*read.body), ("abc", &b"hi"[..]));
        let long = format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "a".repeat(20_000));
        for wrong in [
            "",
            "GET\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: x",
            "GET / HTTP/1.1\r\nno name\r\n\r\n",
            "POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
            "POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nhi",
            "POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n",
            &long,
        ] {
            assert!(read_from(wrong.as_bytes()).is_err(), "{wrong:.40}");
        }
    }

    #[test]
    fn only_who_knows_the_token_and_names_this_host_is_answered() {
        let get = |host: &str, more: &str| {
            request(&format!("GET / HTTP/1.1\r\nHost: {host}\r\n{more}\r\n")).refusal("secret")
        };
        let token = "X-Gantry-Token: secret\r\n";
        assert_eq!(get("127.0.0.1:8800", token), None);
        assert_eq!(get("localhost:9000", token), None, "through a tunnel");
        assert!(get("evil.example:8800", token).is_some());
        assert!(get("127.0.0.1.evil.example", token).is_some());
        assert!(get("127.0.0.1:8800", "").is_some());
        assert!(get("127.0.0.1:8800", "X-Gantry-Token: secreT\r\n").is_some());
        let own = format!("{token}Origin: http://127.0.0.1:8800\r\n");
        assert_eq!(get("127.0.0.1:8800", &own), None);
        let foreign = format!("{token}Origin: http://evil.example\r\n");
        assert!(get("127.0.0.1:8800", &foreign).is_some());
        let post = |head: &str| {
            let text = format!("POST /command{head}\r\nContent-Length: 0\r\n\r\n");
            request(&text).refusal("secret")
        };
        let host = " HTTP/1.1\r\nHost: 127.0.0.1:8800";
        assert!(post(&format!("?token=secret{host}")).is_some());
        assert_eq!(post(&format!("{host}\r\nX-Gantry-Token: secret")), None);
    }
}
