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

/// Receives a record of exactly this size, and the descriptor that came with it. Descriptors beyond
/// the first are closed.
pub(super) fn receive<T: Pod>(from: BorrowedFd<'_>) -> Result<(T, Option<OwnedFd>), Errno> {
    let mut record = T::zeroed();
    let mut control = nix::cmsg_space!([i32; 4]);
    let (n_bytes, mut descriptors) = {
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
        (received.bytes, descriptors)
    };
    if n_bytes != size_of::<T>() {
        return Err(Errno::EBADMSG);
    }
    descriptors.truncate(1);
    Ok((record, descriptors.pop()))
}
