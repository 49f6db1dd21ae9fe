//! Asks the kernel about one TCP socket (`sock_diag(7)`), which costs the same however many there
//! are.

use std::io::{self, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};

const AF_NETLINK: i32 = 16;
const NETLINK_SOCK_DIAG: i32 = 4;
const SOCK_DIAG_BY_FAMILY: u16 = 20;
const NLM_F_REQUEST: u16 = 1;
const NLMSG_ERROR: u16 = 2;
const AF_INET: u8 = 2;
const AF_INET6: u8 = 10;
const TCP: u8 = 6;
const LISTENING: u8 = 10;
/// Bytes of a message's head, of the question behind it, and of the answer behind it.
const HEAD: usize = 16;
const QUESTION: usize = 56;
const ANSWER: usize = 72;
/// Where the ends of a socket are in both: ports, addresses, interface, cookie.
const ENDS: [usize; 2] = [8, 4];
/// Bytes of ports and addresses.
const ENDS_BYTES: usize = 36;

/// A socket as the kernel knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// The user that made it.
    pub user: u32,
    /// 0 if its process has closed it.
    pub inode: u32,
}

/// The TCP socket with these ends; `None` if there is none.
///
/// # Errors
/// If the kernel does not answer such questions.
pub fn find(local: SocketAddr, remote: SocketAddr) -> io::Result<Option<Found>> {
    let mut socket = Socket::new(
        Domain::from(AF_NETLINK),
        Type::RAW,
        Some(Protocol::from(NETLINK_SOCK_DIAG)),
    )?;
    socket.set_read_timeout(Some(Duration::from_secs(1)))?;
    let question = question(local, remote);
    socket.write_all(&question)?;
    let mut answer = [0; 4096];
    let n_bytes = socket.read(&mut answer)?;
    read(
        &answer[..n_bytes],
        &question[HEAD + ENDS[0]..][..ENDS_BYTES],
    )
}

fn question(local: SocketAddr, remote: SocketAddr) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD + QUESTION);
    bytes.extend(((HEAD + QUESTION) as u32).to_ne_bytes());
    bytes.extend(SOCK_DIAG_BY_FAMILY.to_ne_bytes());
    bytes.extend(NLM_F_REQUEST.to_ne_bytes());
    bytes.extend([0; 8]);
    let family = if local.is_ipv4() { AF_INET } else { AF_INET6 };
    bytes.extend([family, TCP, 0, 0]);
    // Any state.
    bytes.extend(u32::MAX.to_ne_bytes());
    bytes.extend(local.port().to_be_bytes());
    bytes.extend(remote.port().to_be_bytes());
    for end in [local, remote] {
        let mut address = [0; 16];
        match end.ip() {
            IpAddr::V4(ip) => address[..4].copy_from_slice(&ip.octets()),
            IpAddr::V6(ip) => address.copy_from_slice(&ip.octets()),
        }
        bytes.extend(address);
    }
    // Any interface, and no cookie.
    bytes.extend([0; 4]);
    bytes.extend([0xff; 8]);
    bytes
}

fn read(answer: &[u8], asked: &[u8]) -> io::Result<Option<Found>> {
    let odd = || io::Error::other("the kernel's answer about a socket cannot be read");
    let (head, body) = answer.split_at_checked(HEAD).ok_or_else(odd)?;
    let word = |at: usize| -> Option<u32> {
        Some(u32::from_ne_bytes(body.get(at..at + 4)?.try_into().ok()?))
    };
    match u16::from_ne_bytes([head[4], head[5]]) {
        NLMSG_ERROR => {
            let code = word(0).ok_or_else(odd)?.cast_signed().wrapping_neg();
            let error = io::Error::from_raw_os_error(code);
            match error.kind() {
                // Without its module the kernel says so of every socket.
                io::ErrorKind::NotFound => Ok(None),
                _ => Err(error),
            }
        }
        SOCK_DIAG_BY_FAMILY if body.len() >= ANSWER => {
            let found = Found {
                user: word(ANSWER - 8).ok_or_else(odd)?,
                inode: word(ANSWER - 4).ok_or_else(odd)?,
            };
            // In place of a connection that has gone the kernel may name who listens there.
            let is_it = body[1] != LISTENING && is_same(&body[ENDS[1]..][..ENDS_BYTES], asked);
            Ok(is_it.then_some(found))
        }
        _ => Err(odd()),
    }
}

/// Whether ports and addresses are the same. IPv4's are four bytes, or the last four of IPv6's if
/// the socket is for both families.
fn is_same(found: &[u8], asked: &[u8]) -> bool {
    let mapped = |at: usize| {
        found[at..at + 12] == [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff]
            && found[at + 12..at + 16] == asked[at..at + 4]
    };
    found == asked || found[..4] == asked[..4] && mapped(4) && mapped(20)
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream};

    use super::*;

    #[test]
    fn a_connection_is_found_and_a_listener_is_not_taken_for_one() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let ours = listener.local_addr().unwrap();
        let client = TcpStream::connect(ours).unwrap();
        let theirs = client.local_addr().unwrap();
        let Ok(found) = find(theirs, ours) else {
            return; // This kernel does not answer such questions.
        };
        let Some(found) = found else {
            return; // Or it lacks the module.
        };
        assert_eq!(found.user, nix::unistd::geteuid().as_raw());
        assert_ne!(found.inode, 0);
        // The kernel finds the listener for ends that no connection has.
        let nobody = "127.0.0.1:9".parse().unwrap();
        assert_eq!(find(ours, nobody).unwrap(), None);
        assert_eq!(find(nobody, ours).unwrap(), None);
    }

    #[test]
    fn odd_answers_are_errors() {
        for bytes in [&[][..], &[0; 16], &[0xff; 100]] {
            assert!(read(bytes, &[0; ENDS_BYTES]).is_err());
        }
    }
}
