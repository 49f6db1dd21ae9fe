//! Whose process is at the other end of a loopback connection.
//!
//! TCP has no credentials, but both ends of a loopback connection are on this machine and in this
//! network namespace, so the kernel lists the other end's socket with the user that made it.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use crate::sock_diag;

/// How often the kernel's list is read: an entry may be passed over while others come and go.
const TRIES: u32 = 4;
/// Pause between two readings.
const PAUSE: Duration = Duration::from_millis(5);
/// The kernel's lists of this thread's network namespace: `/proc/net` is that of the first thread.
const LISTS: [&str; 2] = ["/proc/thread-self/net/tcp", "/proc/thread-self/net/tcp6"];
/// Stands for every user that has no number in this user namespace.
const NOBODYS_NUMBER: u32 = 65534;

/// Who is at the other end of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whose {
    /// A process of this user, by number.
    User(u32),
    /// Nobody any more: it has closed.
    Nobody,
    /// The kernel does not say, or the user has no number here.
    Unknown,
}

impl Whose {
    fn of(user: u32) -> Whose {
        match has_number(user) {
            true => Whose::User(user),
            false => Whose::Unknown,
        }
    }
}

/// Who is at the other end of a connection between `theirs` and `ours`.
///
/// # Errors
/// If the kernel's list of connections cannot be read.
pub fn whose(theirs: SocketAddr, ours: SocketAddr) -> io::Result<Whose> {
    // A kernel that lacks the module finds nothing, and others have none of this at all.
    match sock_diag::find(theirs, ours) {
        Ok(Some(found)) if found.inode == 0 => Ok(Whose::Nobody),
        Ok(Some(found)) => Ok(Whose::of(found.user)),
        _ => listed(theirs, ours),
    }
}

fn listed(theirs: SocketAddr, ours: SocketAddr) -> io::Result<Whose> {
    // A socket for both families is listed with IPv6's.
    let lists = if theirs.is_ipv4() {
        &LISTS[..]
    } else {
        &LISTS[1..]
    };
    for n in 0..TRIES {
        if n > 0 {
            std::thread::sleep(PAUSE);
        }
        for list in lists {
            let text = match std::fs::read_to_string(list) {
                Ok(text) => text,
                // A kernel without IPv6.
                Err(error) if error.kind() == io::ErrorKind::NotFound && *list == LISTS[1] => {
                    continue;
                }
                Err(error) => return Err(error),
            };
            match find(&text, theirs, ours) {
                Some(Listed::Open(user)) => return Ok(Whose::of(user)),
                Some(Listed::Closed) => return Ok(Whose::Nobody),
                None => {}
            }
        }
    }
    Ok(Whose::Unknown)
}

/// Whether this is a process of this process's own user.
pub fn is_ours(whose: Whose) -> bool {
    whose == Whose::User(nix::unistd::geteuid().as_raw())
}

/// Whether users can be told at all.
///
/// # Errors
/// If the kernel's list of connections cannot be read.
pub fn can_tell() -> io::Result<()> {
    std::fs::File::open(LISTS[0]).map(drop)
}

/// A socket in a list of the kernel's.
#[derive(Debug, PartialEq, Eq)]
enum Listed {
    /// The user that made it.
    Open(u32),
    /// Its process has closed it: it belongs to nobody, which is listed as user 0.
    Closed,
}

/// In a user namespace everybody without a number there looks alike.
fn has_number(user: u32) -> bool {
    user != NOBODYS_NUMBER
        || std::fs::read_to_string("/proc/self/uid_map").is_ok_and(|map| has_everybody(&map))
}

/// Whether a user namespace has all users of the machine.
fn has_everybody(map: &str) -> bool {
    let mut words = map.split_ascii_whitespace();
    [words.next(), words.next(), words.next()] == [Some("0"), Some("0"), Some("4294967295")]
}

/// The user of the socket with these ends in a list of the kernel's.
fn find(list: &str, local: SocketAddr, remote: SocketAddr) -> Option<Listed> {
    // Addresses of the list that the line is from: 8 digits, or 32.
    let forms = [false, true].map(|wide| (in_list(local, wide), in_list(remote, wide)));
    list.lines().skip(1).find_map(|line| {
        let mut words = line.split_ascii_whitespace().skip(1);
        let (here, there) = (words.next()?, words.next()?);
        let is_it = forms.iter().any(|(local, remote)| {
            local.as_deref() == Some(here) && remote.as_deref() == Some(there)
        });
        if !is_it {
            return None;
        }
        // Behind the two addresses: state, queues, timer, retransmissions, user, probes, inode.
        let (user, inode) = (words.nth(4)?, words.nth(1)?);
        if inode == "0" {
            return Some(Listed::Closed);
        }
        user.parse().ok().map(Listed::Open)
    })
}

/// An address as the kernel lists it: words of 32 bits in the machine's order, then the port.
fn in_list(address: SocketAddr, wide: bool) -> Option<String> {
    let words = |octets: &[u8]| -> String {
        let word = |four: &[u8]| u32::from_ne_bytes([four[0], four[1], four[2], four[3]]);
        octets
            .chunks(4)
            .map(|four| format!("{:08X}", word(four)))
            .collect()
    };
    let host = match (address.ip(), wide) {
        (IpAddr::V4(ip), false) => words(&ip.octets()),
        (IpAddr::V4(ip), true) => words(&ip.to_ipv6_mapped().octets()),
        (IpAddr::V6(ip), true) => words(&ip.octets()),
        (IpAddr::V6(_), false) => return None,
    };
    Some(format!("{host}:{:04X}", address.port()))
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream};

    use super::*;

    #[test]
    fn the_other_end_of_a_loopback_connection_is_found() {
        let ours = nix::unistd::geteuid().as_raw();
        for host in ["127.0.0.1", "127.9.8.7", "::1"] {
            let Ok(listener) = TcpListener::bind((host, 0)) else {
                continue; // This machine has no IPv6.
            };
            let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let (server, theirs) = listener.accept().unwrap();
            let here = server.local_addr().unwrap();
            for told in [whose, listed] {
                assert_eq!(told(theirs, here).unwrap(), Whose::User(ours), "{host}");
            }
            drop(client);
            for told in [whose, listed] {
                let gone = told(theirs, here).unwrap();
                assert_eq!(gone, Whose::Nobody, "{host}: it has gone");
            }
        }
    }

    /// A line of either list, from a machine whose byte order is that of x86-64.
    #[cfg(target_endian = "little")]
    #[test]
    fn lines_of_the_kernel_are_read() {
        let list = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n\
            0: 0100007F:07D0 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 1 1 f 100 0 0 10 0\n\
            1: 0100007F:977E 0100007F:07D0 01 00000000:00000000 02:00000E86 00000000  1000        0 4242 2 f 20 4 0 10 -1\n\
            2: 0100007F:977F 0100007F:07D0 05 00000000:00000000 00:00000000 00000000     0        0 0 2 f 20 4 0 10 -1\n";
        let at = |text: &str| text.parse::<SocketAddr>().unwrap();
        let ours = at("127.0.0.1:2000");
        assert_eq!(
            find(list, at("127.0.0.1:38782"), ours),
            Some(Listed::Open(1000))
        );
        assert_eq!(
            find(list, at("127.0.0.1:38783"), ours),
            Some(Listed::Closed)
        );
        assert_eq!(find(list, at("127.0.0.1:1"), ours), None);
        let wide = "head\n 0: 0000000000000000FFFF00000100007F:977E 0000000000000000FFFF00000100007F:07D0 01 0:0 0:0 0 7 0 9 1\n";
        assert_eq!(
            find(wide, at("127.0.0.1:38782"), ours),
            Some(Listed::Open(7))
        );
        assert!(find("", ours, ours).is_none());
    }

    #[test]
    fn a_namespace_with_few_users_is_told_apart() {
        assert!(has_everybody("         0          0 4294967295\n"));
        assert!(!has_everybody("0 1000 1\n1 100000 65536\n"));
    }
}
