//! Memory that was freed, back to the system.

/// Gives freed memory back to the system, where the C library does not by itself.
///
/// GNU's keeps what lies below the last block in use, so a daemon that loads one map after another
/// grows by the gaps between what lives on. Call it after much was freed; it takes some
/// milliseconds.
pub fn give_back() {
    #[cfg(target_env = "gnu")]
    {
        #[expect(unsafe_code, reason = "a system call without a wrapper")]
        // SAFETY: it takes a number, and may be called at any time from any thread.
        unsafe {
            nix::libc::malloc_trim(0);
        }
    }
}
