//! The memory behind a publisher: where its segment is mapped, how its pages are reserved, and how
//! they are faulted in.

use std::fs::File;
use std::os::fd::AsRawFd as _;
use std::path::PathBuf;

/// The whole data segment of a publisher, as mapped into this process. Valid as long as the
/// publisher.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// First byte; a multiple of the page size.
    pub base: *mut u8,
    /// Bytes; a multiple of the page size.
    pub len: usize,
}

// SAFETY: `Segment` is only an address range; reading or writing through it needs `unsafe` of its
// own, and the memory is shared between processes by design.
unsafe impl Send for Segment {}
// SAFETY: as above.
unsafe impl Sync for Segment {}

/// The mapping that `ptr` lies in.
///
/// # Errors
/// If the list of mappings cannot be read, for want of descriptors for example, or lacks it.
pub(crate) fn mapping_of(ptr: *const u8) -> std::io::Result<Segment> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let (base, end) = maps
        .lines()
        .filter_map(parse_range)
        .find(|(base, end)| (*base..*end).contains(&(ptr as usize)))
        .ok_or(std::io::ErrorKind::NotFound)?;
    Ok(Segment {
        base: base as *mut u8,
        len: end - base,
    })
}

/// The file that is mapped at `ptr`.
pub(crate) fn file_of(ptr: *const u8) -> Option<PathBuf> {
    let maps = std::fs::read_to_string("/proc/self/maps").ok()?;
    let line = maps.lines().find(|line| {
        parse_range(line).is_some_and(|(base, end)| (base..end).contains(&(ptr as usize)))
    })?;
    line.find('/').map(|at| PathBuf::from(&line[at..]))
}

/// Reserves pages of a file in `/dev/shm`, which are then the file's until it is removed: no write
/// to them can fail. Either all are reserved or, where they were not there before, none.
///
/// # Errors
/// The kernel's error, `ENOSPC` if there is no room.
pub(crate) fn reserve(file: &File, offset: u64, n_bytes: u64) -> std::io::Result<()> {
    let too_long = |_| std::io::Error::from_raw_os_error(libc::EFBIG);
    let offset = libc::off_t::try_from(offset).map_err(too_long)?;
    let n_bytes = libc::off_t::try_from(n_bytes).map_err(too_long)?;
    loop {
        // SAFETY: the descriptor is open; the call only changes which pages the file has.
        let done = unsafe {
            libc::fallocate(file.as_raw_fd(), libc::FALLOC_FL_KEEP_SIZE, offset, n_bytes)
        };
        if done == 0 {
            return Ok(());
        }
        let error = std::io::Error::last_os_error();
        match error.raw_os_error() {
            Some(libc::EINTR) => {}
            // No tmpfs: the pages are faulted in later, under the guard of `shortage.rs`.
            Some(libc::EOPNOTSUPP) => return Ok(()),
            _ => return Err(error),
        }
    }
}

/// Start and end of a line such as `7f00-7f10 rw-s …`.
fn parse_range(line: &str) -> Option<(usize, usize)> {
    let (base, end) = line.split_whitespace().next()?.split_once('-')?;
    Some((
        usize::from_str_radix(base, 16).ok()?,
        usize::from_str_radix(end, 16).ok()?,
    ))
}

/// Makes the kernel provide the first `bytes` of a segment now: a first touch later would cost
/// milliseconds per frame, and would kill the process on a full `/dev/shm`.
///
/// # Errors
/// The kernel's error, for example that there is no memory.
pub(crate) fn prefault(segment: Segment, bytes: usize) -> std::io::Result<()> {
    let len = bytes.min(segment.len);
    // SAFETY: the range lies in a mapping that the publisher keeps; `MADV_POPULATE_WRITE` faults
    // pages in and changes no byte of them.
    if unsafe { libc::madvise(segment.base.cast(), len, libc::MADV_POPULATE_WRITE) } == 0 {
        return Ok(());
    }
    let error = std::io::Error::last_os_error();
    if error.raw_os_error() != Some(libc::EINVAL) {
        return Err(error);
    }
    // Kernels before 5.14 lack this advice; reading a hole in a shared tmpfs mapping allocates its
    // page as well.
    for offset in (0..len).step_by(4096) {
        // SAFETY: the address is within the mapping and readable; the read is volatile because
        // another process may write there.
        unsafe { segment.base.add(offset).read_volatile() };
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_maps_is_read() {
        assert_eq!(
            parse_range("7f1200000000-7f1200004000 rw-s 00000000 00:19 5 /dev/shm/x"),
            Some((0x7f1200000000, 0x7f1200004000))
        );
        assert_eq!(parse_range("nonsense"), None);
    }

    #[test]
    fn a_value_on_the_heap_lies_in_a_mapping() {
        let value = Box::new(7u8);
        let found = mapping_of(&*value).expect("the heap is mapped");
        assert!(found.base as usize <= &*value as *const u8 as usize);
    }
}
