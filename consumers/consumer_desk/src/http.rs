//! Requests of a browser as far as this program needs them, bounded in size and time, and who may
//! make them.
//!
//! A request is answered if it knows the token and names a port of this machine as its host: a page
//! of another site knows no token, and one whose name was bent to 127.0.0.1 names another host. No
//! answer lets pages of other sites read it.

use std::io::{self, BufRead, BufReader, Write};
use std::net::{IpAddr, Ipv4Addr, TcpStream};
use std::time::Duration;

use consumer_rpc::web::{Head, Until};

/// Longest body of a request, bytes.
const MAX_BODY: usize = 1 << 20;
/// How long a whole request may take to come.
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
    /// Code of the query, which a browser that this program opens has in place of the token.
    pub code: Option<String>,
    head: Head,
    /// Body.
    pub body: Vec<u8>,
}

/// Reads one request.
///
/// # Errors
/// If it does not come in time, is none or is too large.
pub fn read(stream: &TcpStream) -> io::Result<Request> {
    read_from(BufReader::new(Until::new(stream, REQUEST_TIMEOUT)))
}

fn read_from(mut source: impl BufRead) -> io::Result<Request> {
    let wrong = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let head = Head::read(&mut source)?;
    let (path, query) = head.target.split_once('?').unwrap_or((&head.target, ""));
    let of_query =
        |name: &'static str| query.split('&').filter_map(move |it| it.strip_prefix(name));
    let of_header = head.field("x-gantry-token");
    let n_body = match head.field("content-length") {
        None => 0,
        Some(text) => text
            .parse()
            .ok()
            .filter(|n| *n <= MAX_BODY)
            .ok_or_else(|| wrong("the request's body is too long"))?,
    };
    if head.field("transfer-encoding").is_some() {
        return Err(wrong("bodies in pieces are not understood"));
    }
    let mut request = Request {
        method: head.method.clone(),
        path: path.to_owned(),
        token: of_header
            .or_else(|| of_query("token=").next_back())
            .unwrap_or_default()
            .to_owned(),
        is_deliberate: of_header.is_some(),
        code: of_query("code=").next_back().map(str::to_owned),
        body: vec![0; n_body],
        head,
    };
    source.read_exact(&mut request.body)?;
    Ok(request)
}

impl Request {
    /// Why it is not answered, whatever it knows: it came by a foreign name, or from a foreign page.
    pub fn misplaced(&self) -> Option<&'static str> {
        if !self.head.names_host(IpAddr::V4(Ipv4Addr::LOCALHOST), &[]) {
            return Some(
                "this page is on 127.0.0.1 only; open the address that gantry-desk printed",
            );
        }
        if self.head.foreign_origin(&[]).is_some() {
            return Some("pages of other sites are not answered");
        }
        None
    }

    /// Why it is not answered, if it is not.
    pub fn refusal(&self, token: &str) -> Option<&'static str> {
        if let Some(why) = self.misplaced() {
            return Some(why);
        }
        if !is_same(&self.token, token) {
            return Some("the address lacks its token; open the one that gantry-desk printed");
        }
        if self.method == "POST" && !self.is_deliberate {
            return Some("the header X-Gantry-Token is missing");
        }
        None
    }
}

/// Compares in a time that does not hang on where they differ.
pub fn is_same(a: &str, b: &str) -> bool {
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

/// Sends the browser to another address of this program, and ends the connection.
///
/// # Errors
/// If the other end has gone.
pub fn redirect(mut to: &TcpStream, target: &str) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 303 See Other\r\nLocation: {target}\r\nContent-Length: 0\r\nConnection: close\r\n{GUARDS}\r\n"
    );
    to.write_all(head.as_bytes())
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
        for wrong in [
            "",
            "POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
            "POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nhi",
            "POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n",
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
