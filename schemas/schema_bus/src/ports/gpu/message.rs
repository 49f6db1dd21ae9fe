//! One record and at most one descriptor through a socket.

use std::io::{IoSlice, IoSliceMut};
use std::os::fd::{AsRawFd as _, BorrowedFd, FromRawFd as _, OwnedFd};

use bytemuck::Pod;
use nix::errno::Errno;
use nix::sys::socket::{ControlMessage, ControlMessageOwned, MsgFlags, UnixAddr, recvmsg, sendmsg};

/// Sends a record, with a descriptor if there is one.
pub(super) fn send<T: Pod>(
    to: BorrowedFd<'_>,
    record: &T,
    descriptor: Option<BorrowedFd<'_>>,
) -> Result<(), Errno> {
    let bytes = [IoSlice::new(bytemuck::bytes_of(record))];
    let descriptors: Vec<i32> = descriptor.iter().map(|it| it.as_raw_fd()).collect();
    let rights = [ControlMessage::ScmRights(&descriptors)];
    let control = if descriptors.is_empty() {
        &[][..]
    } else {
        &rights[..]
    };
    let sent = sendmsg::<UnixAddr>(
        to.as_raw_fd(),
        &bytes,
        control,
        MsgFlags::MSG_NOSIGNAL,
        None,
    )?;
    if sent == size_of::<T>() {
        Ok(())
    } else {
        Err(Errno::EMSGSIZE)
    }
}

/// Most descriptors that the kernel passes on with one message (`SCM_MAX_FD`). With room for fewer
/// those that fit would be this process's and nobody would know their numbers.
const MAX_DESCRIPTORS: usize = 253;

/// Receives a record of exactly this size, and the descriptor that came with it. Descriptors beyond
/// the first are closed.
pub(super) fn receive<T: Pod>(from: BorrowedFd<'_>) -> Result<(T, Option<OwnedFd>), Errno> {
    let mut record = T::zeroed();
    let mut control = nix::cmsg_space!([i32; MAX_DESCRIPTORS]);
    let (n_bytes, is_cut, mut descriptors) = {
        let mut bytes = [IoSliceMut::new(bytemuck::bytes_of_mut(&mut record))];
        let received = recvmsg::<UnixAddr>(
            from.as_raw_fd(),
            &mut bytes,
            Some(&mut control),
            MsgFlags::MSG_CMSG_CLOEXEC,
        )?;
        let mut descriptors = Vec::new();
        for message in received.cmsgs()? {
            if let ControlMessageOwned::ScmRights(these) = message {
                // SAFETY: the kernel has just made these descriptors for this process, and nobody
                // else knows them.
                let owned = these.iter().map(|fd| unsafe { OwnedFd::from_raw_fd(*fd) });
                descriptors.extend(owned);
            }
        }
        // A longer record is cut to the length that was asked for.
        let is_cut = received.flags.contains(MsgFlags::MSG_TRUNC);
        (received.bytes, is_cut, descriptors)
    };
    if is_cut || n_bytes != size_of::<T>() {
        return Err(Errno::EBADMSG);
    }
    descriptors.truncate(1);
    Ok((record, descriptors.pop()))
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;
    use std::os::fd::AsFd as _;

    use nix::sys::socket::{AddressFamily, SockFlag, SockType, socketpair};

    use super::*;

    fn pair() -> (OwnedFd, OwnedFd) {
        let kind = (AddressFamily::Unix, SockType::SeqPacket);
        socketpair(kind.0, kind.1, None, SockFlag::SOCK_CLOEXEC).unwrap()
    }

    #[test]
    fn longer_and_shorter_records_are_refused() {
        for n_bytes in [1, 7, 8, 9, 4096] {
            let (from, to) = pair();
            nix::unistd::write(&from, &vec![7; n_bytes]).unwrap();
            let received = receive::<u64>(to.as_fd()).map(|(record, _)| record);
            let expected = match n_bytes {
                8 => Ok(0x0707_0707_0707_0707),
                _ => Err(Errno::EBADMSG),
            };
            assert_eq!(received, expected, "{n_bytes} bytes");
        }
    }

    #[test]
    fn descriptors_that_nobody_asked_for_are_closed() {
        for n in [2, 5, 64, MAX_DESCRIPTORS] {
            let (mut reader, writer) = std::io::pipe().unwrap();
            let (from, to) = pair();
            let descriptors = vec![writer.as_raw_fd(); n];
            let bytes = [IoSlice::new(&[7; 8])];
            let control = [ControlMessage::ScmRights(&descriptors)];
            let none = MsgFlags::empty();
            sendmsg::<UnixAddr>(from.as_raw_fd(), &bytes, &control, none, None).unwrap();
            drop(writer);
            let (record, kept) = receive::<u64>(to.as_fd()).unwrap();
            assert_eq!(record, 0x0707_0707_0707_0707);
            drop(kept.expect("the first one"));
            // The pipe ends only when the last copy of its writing end is closed.
            let nonblocking = nix::fcntl::FcntlArg::F_SETFL(nix::fcntl::OFlag::O_NONBLOCK);
            nix::fcntl::fcntl(&reader, nonblocking).unwrap();
            assert_eq!(reader.read(&mut [0]).unwrap(), 0, "{n} descriptors");
        }
    }
}
