//! Process limits: one whose default in a login shell is too low, and one that must not kill.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;
use nix::sys::resource::{Resource, getrlimit, setrlimit};

/// Raises the soft limit of open files to the hard one and returns it. Every topic and its readers
/// hold several descriptors.
///
/// # Errors
/// When the kernel does not allow the limit to be read or changed.
pub fn raise_file_limit() -> anyhow::Result<u64> {
    let (soft, hard) =
        getrlimit(Resource::RLIMIT_NOFILE).context("cannot read the limit of open files")?;
    if soft < hard {
        setrlimit(Resource::RLIMIT_NOFILE, hard, hard)
            .with_context(|| format!("cannot raise the limit of open files from {soft} to {hard}; try `ulimit -n {hard}` before"))?;
    }
    Ok(hard)
}

/// Turns writes beyond the limit of a file's size (`ulimit -f`) into errors: by default they end the
/// process by SIGXFSZ, without a word and with its files half-written.
pub fn heed_file_size_limit() {
    // Nobody looks at the flag: that there is a handler is what makes the write fail.
    let unread = Arc::new(AtomicBool::new(false));
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, unread);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_soft_limit_meets_the_hard_one() {
        let limit = raise_file_limit().unwrap();
        assert_eq!(getrlimit(Resource::RLIMIT_NOFILE).unwrap().0, limit);
    }
}
