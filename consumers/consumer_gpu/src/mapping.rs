//! Memory of a software adapter, mapped: what CI reads in the place of a GPU.

use std::fs::File;
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::fs::FileExt as _;

/// A mapping of another process's memory, for reading.
#[derive(Debug)]
pub struct Mapping {
    base: *mut libc::c_void,
    n_bytes: usize,
    /// Where the memory begins in its file.
    begin: usize,
}

/// Why memory cannot be mapped, as a clause.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// More bytes than this process can address.
    #[error("it is too long")]
    TooLong,
    /// The descriptor is of no file.
    #[error(transparent)]
    Descriptor(#[from] std::io::Error),
    /// The file's header cannot be read.
    #[error("its descriptor cannot be read ({0})")]
    Header(std::io::Error),
    /// The header is not Mesa's.
    #[error("its driver keeps it in another way than the Mesa that this program knows")]
    Layout,
    /// A file that would fault when it is read.
    #[error("its descriptor has {found} bytes, but the writer says {told}")]
    Short {
        /// Bytes of the file.
        found: u64,
        /// Bytes that the writer names.
        told: usize,
    },
    /// The kernel refuses.
    #[error("it cannot be mapped ({0}); only a software adapter's can")]
    Refused(std::io::Error),
}

/// Where the memory begins in a file of Mesa's, which starts with its length and that place.
fn begin_of(file: &File, file_bytes: u64) -> Result<u64, MapError> {
    let mut header = [0; 16];
    file.read_exact_at(&mut header, 0)
        .map_err(MapError::Header)?;
    let [length, begin] = [&header[..8], &header[8..]]
        .map(|number| u64::from_le_bytes(number.try_into().expect("a half of sixteen bytes")));
    let is_known = length == file_bytes && begin >= 32 && begin.is_multiple_of(64);
    match is_known && begin < file_bytes {
        true => Ok(begin),
        false => Err(MapError::Layout),
    }
}

// SAFETY: an address range that lives as long as the value; it is only read, and others write to it
// through their own mappings.
unsafe impl Send for Mapping {}
// SAFETY: as above.
unsafe impl Sync for Mapping {}

impl Mapping {
    /// Maps `n_bytes` of a descriptor, which must have as many.
    ///
    /// # Errors
    /// [`MapError`].
    pub fn new(descriptor: &OwnedFd, n_bytes: u64) -> Result<Mapping, MapError> {
        let n_bytes = usize::try_from(n_bytes).map_err(|_| MapError::TooLong)?;
        let file = File::from(descriptor.try_clone()?);
        let found = file.metadata()?.len();
        let begin = begin_of(&file, found)?;
        // A shorter file would fault when it is read.
        if found < n_bytes as u64 + begin {
            return Err(MapError::Short {
                found,
                told: n_bytes,
            });
        }
        let (begin, n_bytes) = (begin as usize, n_bytes + begin as usize);
        // SAFETY: a new mapping of an open descriptor at an address that the kernel chooses.
        let base = unsafe {
            libc::mmap(
                std::ptr::null_mut(),
                n_bytes,
                libc::PROT_READ,
                libc::MAP_SHARED,
                descriptor.as_raw_fd(),
                0,
            )
        };
        if base == libc::MAP_FAILED {
            return Err(MapError::Refused(std::io::Error::last_os_error()));
        }
        Ok(Mapping {
            base,
            n_bytes,
            begin,
        })
    }

    /// Address of the first byte.
    pub fn address(&self) -> u64 {
        (self.base as usize + self.begin) as u64
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: mapped by `new` with this length, and nobody has addresses in it any more.
        unsafe { libc::munmap(self.base, self.n_bytes) };
    }
}
