//! What a full `/dev/shm` does to a process: an error, never its death.
//!
//! Segments are sparse, and a page that cannot be had when it is first touched is a SIGBUS. Frames
//! therefore have their pages reserved before they are loaned (`reserve.rs`). Everything else, above
//! all what iceoryx2 writes while it makes services and ports, is touched under the guard of this
//! module: the handler of the signal puts a page of the process's own in the place of the missing
//! one and notes it. [`guarded`] then refuses what was being made, and [`backed`] refuses to send a
//! sample that lies in such a page, or gives the page back to the segment once there is room.
//!
//! A fault anywhere but in a file of `/dev/shm` ends the process as it would without the guard.

use std::cell::UnsafeCell;
use std::fs::File;
use std::io::Write as _;
use std::os::fd::AsRawFd as _;
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::os::unix::fs::FileExt as _;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::contract::error::BusError;
use crate::memory::segment::{file_of, reserve};
use crate::memory::sizes::shared_memory_free;

/// Stretches of missing pages that one process may hold at a time; one more ends it as without the
/// guard. Whole samples are one stretch each.
pub const MAX_MISSING_STRETCHES: usize = 256;

/// Longest path of a file in `/dev/shm` that is followed, bytes; names there have at most 255.
const MAX_PATH_BYTES: usize = 300;
/// Longest line of `/proc/self/maps` that is looked at, bytes: the columns before the path, and it.
const MAX_LINE_BYTES: usize = 100 + MAX_PATH_BYTES;
/// Headers before a payload in its slot, bytes; an upper bound.
const HEAD_BYTES: usize = 512;
/// Where the missing pages must belong.
const SHARED_MEMORY: &[u8] = b"/dev/shm/";

/// Pages of the process's own in the place of pages that a file in `/dev/shm` could not get.
#[derive(Clone, Copy)]
struct Stretch {
    address: usize,
    n_bytes: usize,
    /// Where the first page belongs in its file.
    file_offset: u64,
    is_writable: bool,
    path: [u8; MAX_PATH_BYTES],
    path_bytes: usize,
}

impl Stretch {
    const NONE: Stretch = Stretch {
        address: 0,
        n_bytes: 0,
        file_offset: 0,
        is_writable: false,
        path: [0; MAX_PATH_BYTES],
        path_bytes: 0,
    };

    fn path(&self) -> &[u8] {
        self.path.get(..self.path_bytes).unwrap_or_default()
    }

    fn meets(&self, address: usize, n_bytes: usize) -> bool {
        self.address < address.saturating_add(n_bytes)
            && address < self.address.saturating_add(self.n_bytes)
    }

    fn protection(&self) -> libc::c_int {
        if self.is_writable {
            libc::PROT_READ | libc::PROT_WRITE
        } else {
            libc::PROT_READ
        }
    }
}

/// The stretches, behind a lock that a signal handler may take: whoever holds it touches nothing
/// but the list, so no fault happens under it.
struct Stretches {
    is_locked: AtomicBool,
    list: UnsafeCell<[Stretch; MAX_MISSING_STRETCHES]>,
}

// SAFETY: the list is only reached through `with`, which lets in one thread at a time.
unsafe impl Sync for Stretches {}

static STRETCHES: Stretches = Stretches {
    is_locked: AtomicBool::new(false),
    list: UnsafeCell::new([Stretch::NONE; MAX_MISSING_STRETCHES]),
};
/// How many entries at the front of the list are in use.
static N_STRETCHES: AtomicUsize = AtomicUsize::new(0);
/// Pages that were missing so far.
static N_MISSED: AtomicUsize = AtomicUsize::new(0);
/// How many of them had been missing when unmapped stretches were last forgotten.
static N_LOOKED_AT: AtomicUsize = AtomicUsize::new(0);
/// Bytes of a page.
static PAGE_BYTES: AtomicUsize = AtomicUsize::new(4096);

/// What the signal did before the guard came. Written once, before the handler is installed.
struct Before(UnsafeCell<std::mem::MaybeUninit<libc::sigaction>>);
// SAFETY: written once under `Once`, before the only reader, the handler, can run.
unsafe impl Sync for Before {}
static BEFORE: Before = Before(UnsafeCell::new(std::mem::MaybeUninit::zeroed()));

impl Stretches {
    fn with<T>(&self, look: impl FnOnce(&mut [Stretch; MAX_MISSING_STRETCHES]) -> T) -> T {
        while self.is_locked.swap(true, Ordering::Acquire) {
            std::hint::spin_loop();
        }
        // SAFETY: the flag lets in one thread at a time; `look` is this module's, touches no shared
        // memory but the list, so that no fault comes meanwhile, and does not panic.
        let answer = look(unsafe { &mut *self.list.get() });
        self.is_locked.store(false, Ordering::Release);
        answer
    }
}

/// Installs the guard, once per process.
pub(crate) fn install() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // SAFETY: a plain question.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
        if let Ok(page) = usize::try_from(page) {
            PAGE_BYTES.store(page, Ordering::Relaxed);
        }
        // SAFETY: all-zero is a valid `sigaction`; the mask is filled by the call for it. `BEFORE`
        // is written here alone, before the handler that reads it is in place. The handler calls
        // nothing but what POSIX or Linux allows in handlers: open, read, close, mmap, sigaction,
        // raise, and atomics.
        unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = on_missing_page as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_RESTART;
            libc::sigemptyset(&mut action.sa_mask);
            let before = (*BEFORE.0.get()).as_mut_ptr();
            libc::sigaction(libc::SIGBUS, std::ptr::null(), before);
            libc::sigaction(libc::SIGBUS, &action, std::ptr::null_mut());
        }
    });
}

/// Does what may touch pages of `/dev/shm` for the first time: makes a service or a port. If a page
/// was missing, what was made is dropped again.
///
/// # Errors
/// That of `make`, and [`BusError::Memory`] if a page was missing.
pub(crate) fn guarded<T>(
    service: &str,
    need_bytes: u64,
    make: impl FnOnce() -> Result<T, BusError>,
) -> Result<T, BusError> {
    let before = N_MISSED.load(Ordering::Acquire);
    let made = make();
    if N_MISSED.load(Ordering::Acquire) == before {
        return made;
    }
    drop(made);
    forget_unmapped();
    Err(full(service, need_bytes))
}

/// Pages that were missing so far.
pub(crate) fn n_missed() -> usize {
    N_MISSED.load(Ordering::Acquire)
}

/// Makes sure that the slot of this payload, which the caller holds as a loan, and what iceoryx2
/// wrote into the same file are the segment's own. Costs one look at a number as long as no page of
/// the process is missing.
///
/// A page that is missing is given back to its segment with what it holds; what another thread
/// writes into the same page at that moment may be lost.
///
/// # Errors
/// [`BusError::Memory`] if there is still no room.
pub(crate) fn backed(service: &str, payload: *const u8, n_bytes: usize) -> Result<(), BusError> {
    if N_STRETCHES.load(Ordering::Acquire) == 0 {
        return Ok(());
    }
    // Pages were missing since the last look, perhaps of ports that are gone by now.
    let n_missed = n_missed();
    if N_LOOKED_AT.swap(n_missed, Ordering::AcqRel) != n_missed {
        forget_unmapped();
    }
    let address = (payload as usize).saturating_sub(HEAD_BYTES);
    let meets = |stretch: &Stretch| stretch.meets(address, n_bytes + HEAD_BYTES);
    let path = match first_where(meets) {
        Some(stretch) => Some(stretch.path().to_vec()),
        None => file_of(payload).map(|path| path.into_os_string().into_vec()),
    };
    let Some(path) = path else {
        return Ok(());
    };
    while let Some(stretch) = first_where(|stretch| stretch.path() == path) {
        if !give_back(&stretch) {
            return Err(full(service, n_bytes as u64));
        }
        forget(&stretch);
    }
    Ok(())
}

fn full(service: &str, need_bytes: u64) -> BusError {
    BusError::Memory {
        service: service.into(),
        need_bytes,
        free_bytes: shared_memory_free().unwrap_or(0),
    }
}

fn first_where(is_wanted: impl Fn(&Stretch) -> bool) -> Option<Stretch> {
    STRETCHES.with(|list| {
        let used = N_STRETCHES.load(Ordering::Acquire).min(list.len());
        list[..used]
            .iter()
            .find(|stretch| is_wanted(stretch))
            .copied()
    })
}

fn forget(gone: &Stretch) {
    STRETCHES.with(|list| {
        let used = N_STRETCHES.load(Ordering::Acquire).min(list.len());
        let place = list[..used].iter().position(|stretch| {
            stretch.address == gone.address && stretch.file_offset == gone.file_offset
        });
        if let Some(place) = place {
            list[place] = list[used - 1];
            N_STRETCHES.store(used - 1, Ordering::Release);
        }
    });
}

/// Forgets stretches whose memory is unmapped, or belongs to another file by now.
fn forget_unmapped() {
    let maps = std::fs::read("/proc/self/maps").unwrap_or_default();
    let is_there = |stretch: &Stretch| {
        let mut lines = maps.split(|byte| *byte == b'\n').filter_map(Line::read);
        lines.any(|line| line.holds(stretch.address) && line.path.is_empty())
    };
    while let Some(gone) = first_where(|stretch| !is_there(stretch)) {
        forget(&gone);
    }
}

/// Puts the segment's pages back under a stretch, with what the stretch holds. `false` if there is
/// no room for them.
fn give_back(stretch: &Stretch) -> bool {
    let is_ours = || {
        let maps = std::fs::read("/proc/self/maps").unwrap_or_default();
        let mut lines = maps.split(|byte| *byte == b'\n').filter_map(Line::read);
        lines.any(|line| line.holds(stretch.address) && line.path.is_empty())
    };
    if !is_ours() {
        // The memory was unmapped meanwhile and is another segment's now.
        return true;
    }
    let path = std::path::Path::new(std::ffi::OsStr::from_bytes(stretch.path()));
    let open = File::options().read(true).write(true).open(path);
    let Ok(file) = open else {
        return false;
    };
    if reserve(&file, stretch.file_offset, stretch.n_bytes as u64).is_err() {
        return false;
    }
    // SAFETY: the stretch is a mapping of this process (looked up above) that the caller's loan
    // keeps; it is readable, and copied from before anything else is put there.
    let held = unsafe { std::slice::from_raw_parts(stretch.address as *const u8, stretch.n_bytes) };
    if stretch.is_writable && file.write_all_at(held, stretch.file_offset).is_err() {
        return false;
    }
    let Ok(offset) = libc::off_t::try_from(stretch.file_offset) else {
        return false;
    };
    // SAFETY: the range is the stretch itself, inside the segment's mapping that the caller's loan
    // keeps; the file's pages that replace it hold the same bytes and were reserved.
    let mapped = unsafe {
        libc::mmap(
            stretch.address as *mut libc::c_void,
            stretch.n_bytes,
            stretch.protection(),
            libc::MAP_SHARED | libc::MAP_FIXED,
            file.as_raw_fd(),
            offset,
        )
    };
    mapped != libc::MAP_FAILED
}

/// Handles SIGBUS. It allocates nothing, locks nothing but the list, and leaves `errno` as it was.
extern "C" fn on_missing_page(
    signal: libc::c_int,
    info: *mut libc::siginfo_t,
    _context: *mut libc::c_void,
) {
    // SAFETY: the kernel passes a valid `siginfo_t`; the address is meant by faults only, whose
    // codes are positive.
    let (address, is_fault) = unsafe { ((*info).si_addr() as usize, (*info).si_code > 0) };
    // SAFETY: the calling thread's own `errno`.
    let errno = unsafe { *libc::__errno_location() };
    let is_replaced = is_fault && replace(address);
    // SAFETY: as above.
    unsafe { *libc::__errno_location() = errno };
    if is_replaced {
        return;
    }
    // SAFETY: written before the handler was installed. The fault happens again when this returns,
    // now without the guard; a signal that somebody sent is sent again.
    unsafe {
        libc::sigaction(signal, (*BEFORE.0.get()).as_ptr(), std::ptr::null_mut());
        if !is_fault {
            libc::raise(signal);
        }
    }
}

/// Puts a page of the process's own at the address, if a file of `/dev/shm` is mapped there.
fn replace(address: usize) -> bool {
    let page = PAGE_BYTES.load(Ordering::Relaxed);
    let address = address & !(page.wrapping_sub(1));
    let Some(mut missing) = mapped_at(address) else {
        return false;
    };
    missing.n_bytes = page;
    if !missing.path().starts_with(SHARED_MEMORY) || !note(&missing) {
        return false;
    }
    // SAFETY: one page inside a mapping of a file in `/dev/shm`, which the faulting instruction is
    // using, so it is mapped; it holds nothing, because the page could not be had.
    let mapped = unsafe {
        libc::mmap(
            address as *mut libc::c_void,
            page,
            missing.protection(),
            libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED,
            -1,
            0,
        )
    };
    N_MISSED.fetch_add(1, Ordering::AcqRel);
    mapped != libc::MAP_FAILED
}

/// Notes a missing page, as part of the stretch that ends where it begins if there is one. `false`
/// if the list is full.
fn note(missing: &Stretch) -> bool {
    STRETCHES.with(|list| {
        let used = N_STRETCHES.load(Ordering::Acquire).min(list.len());
        let continues = |known: &&mut Stretch| {
            known.address.wrapping_add(known.n_bytes) == missing.address
                && known.file_offset.wrapping_add(known.n_bytes as u64) == missing.file_offset
                && known.path() == missing.path()
        };
        let known = list.get_mut(..used).unwrap_or_default();
        if let Some(known) = known.iter_mut().find(continues) {
            known.n_bytes = known.n_bytes.wrapping_add(missing.n_bytes);
            return true;
        }
        let Some(free) = list.get_mut(used) else {
            return false;
        };
        *free = *missing;
        N_STRETCHES.store(used.wrapping_add(1), Ordering::Release);
        true
    })
}

/// What is mapped at an address, read from `/proc/self/maps` piece by piece without allocating.
fn mapped_at(address: usize) -> Option<Stretch> {
    // SAFETY: a constant path with its zero.
    let file = unsafe {
        libc::open(
            c"/proc/self/maps".as_ptr(),
            libc::O_RDONLY | libc::O_CLOEXEC,
        )
    };
    if file < 0 {
        return None;
    }
    let mut line = [0u8; MAX_LINE_BYTES];
    let mut line_bytes = 0usize;
    let mut found = None;
    let mut piece = [0u8; 1024];
    while found.is_none() {
        // SAFETY: the buffer has this length.
        let n = unsafe { libc::read(file, piece.as_mut_ptr().cast(), piece.len()) };
        let Some(read) = usize::try_from(n).ok().and_then(|n| piece.get(..n)) else {
            break;
        };
        if read.is_empty() {
            break;
        }
        for byte in read {
            if *byte != b'\n' {
                if let Some(place) = line.get_mut(line_bytes) {
                    *place = *byte;
                    line_bytes = line_bytes.wrapping_add(1);
                }
                continue;
            }
            let whole = line.get(..line_bytes).and_then(Line::read);
            line_bytes = 0;
            if let Some(whole) = whole.filter(|whole| whole.holds(address)) {
                found = whole.stretch_at(address);
                break;
            }
        }
    }
    // SAFETY: opened above.
    unsafe { libc::close(file) };
    found
}

/// A line of `/proc/self/maps`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Line<'a> {
    begin: usize,
    end: usize,
    is_writable: bool,
    file_offset: u64,
    path: &'a [u8],
}

impl<'a> Line<'a> {
    /// Reads `begin-end rwxp offset device inode path`, without allocating or panicking.
    fn read(text: &'a [u8]) -> Option<Line<'a>> {
        let (begin, rest) = hex(text)?;
        let (end, rest) = hex(rest.strip_prefix(b"-")?)?;
        let rest = rest.strip_prefix(b" ")?;
        let is_writable = *rest.get(1)? == b'w';
        let (file_offset, rest) = hex(rest.get(5..)?)?;
        let path = rest.iter().position(|byte| *byte == b'/');
        Some(Line {
            begin: usize::try_from(begin).ok()?,
            end: usize::try_from(end).ok()?,
            is_writable,
            file_offset,
            path: path.and_then(|at| rest.get(at..)).unwrap_or_default(),
        })
    }

    fn holds(&self, address: usize) -> bool {
        (self.begin..self.end).contains(&address)
    }

    fn stretch_at(&self, address: usize) -> Option<Stretch> {
        let mut stretch = Stretch {
            address,
            file_offset: self
                .file_offset
                .wrapping_add(address.wrapping_sub(self.begin) as u64),
            is_writable: self.is_writable,
            path_bytes: self.path.len(),
            ..Stretch::NONE
        };
        let mut room = stretch.path.get_mut(..self.path.len())?;
        room.write_all(self.path).ok()?;
        Some(stretch)
    }
}

/// A hexadecimal number at the front, and what follows it.
fn hex(text: &[u8]) -> Option<(u64, &[u8])> {
    let is_digit = |byte: &u8| byte.is_ascii_hexdigit();
    let n_digits = text.iter().take_while(|byte| is_digit(byte)).count();
    let (digits, rest) = text.split_at_checked(n_digits)?;
    if !(1..=16).contains(&n_digits) {
        return None;
    }
    let value = digits.iter().fold(0u64, |value, byte| {
        value << 4 | u64::from((*byte as char).to_digit(16).unwrap_or(0))
    });
    Some((value, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_maps_tells_range_rights_offset_and_path() {
        let text = b"7f1200000000-7f1200004000 rw-s 00003000 00:19 5                    /dev/shm/iox2_x.data";
        let line = Line::read(text).expect("well formed");
        assert_eq!((line.begin, line.end), (0x7f12_0000_0000, 0x7f12_0000_4000));
        assert!(line.is_writable && line.file_offset == 0x3000);
        assert_eq!(line.path, b"/dev/shm/iox2_x.data");
        let stretch = line.stretch_at(0x7f12_0000_1000).expect("it is short");
        assert_eq!((stretch.file_offset, stretch.n_bytes), (0x4000, 0));
        let own = Line::read(b"7f00-7f10 r--p 00000000 00:00 0").expect("well formed");
        assert!(own.path.is_empty() && !own.is_writable);
        assert_eq!(Line::read(b"nonsense"), None);
        assert_eq!(Line::read(b""), None);
    }

    #[test]
    fn what_is_mapped_at_an_address_is_found() {
        let value = Box::new(7u8);
        let found = mapped_at(&*value as *const u8 as usize);
        assert!(found.is_some_and(|found| found.is_writable && found.path().is_empty()));
        assert!(mapped_at(8).is_none());
    }

    #[test]
    fn stretches_meet_where_they_overlap() {
        let stretch = Stretch {
            address: 0x2000,
            n_bytes: 0x1000,
            ..Stretch::NONE
        };
        assert!(stretch.meets(0x1fff, 2) && stretch.meets(0x2fff, 1) && stretch.meets(0, 0x9000));
        assert!(!stretch.meets(0x1000, 0x1000) && !stretch.meets(0x3000, 1));
    }
}
