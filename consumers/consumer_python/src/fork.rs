//! Forked children: what they inherit is not theirs.
//!
//! A child would take samples away from its parent's ports, and would remove the parent's shared
//! memory when it ends. It is therefore refused, and drops nothing.

#![expect(unsafe_code, reason = "pthread_atfork has no safe form")]

use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use pyo3::PyResult;

use crate::errors;

static FORKED: AtomicBool = AtomicBool::new(false);

extern "C" fn in_child() {
    FORKED.store(true, Ordering::Relaxed);
}

/// Notices every fork of this process from now on.
pub fn watch() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // SAFETY: the handler lives as long as the process, because Python never unloads an
        // extension, and storing into an atomic is allowed in a child of a process with threads.
        unsafe { libc::pthread_atfork(None, None, Some(in_child)) };
    });
}

fn forked() -> bool {
    FORKED.load(Ordering::Relaxed)
}

/// Fails in a forked child of a process that had loaded this module.
pub fn check() -> PyResult<()> {
    if forked() {
        return Err(errors::gantry(
            "this process was forked from one that uses gantry, and shared memory does not survive a fork; start it with multiprocessing.get_context(\"spawn\"), or import gantry only after the fork",
        ));
    }
    Ok(())
}

/// What a process owns on the bus. A forked child forgets it instead of dropping it.
#[derive(Debug)]
pub struct Owned<T>(ManuallyDrop<T>);

impl<T> Owned<T> {
    /// Takes what this process has made.
    pub fn new(it: T) -> Self {
        Owned(ManuallyDrop::new(it))
    }

    /// Gives it out, for what consumes it.
    pub fn into_inner(mut self) -> T {
        // SAFETY: `self` is forgotten in the next line, so that nobody takes or drops it again.
        let it = unsafe { ManuallyDrop::take(&mut self.0) };
        std::mem::forget(self);
        it
    }
}

impl<T> Deref for Owned<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T> DerefMut for Owned<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        if !forked() {
            // SAFETY: this is the only place that drops the content, and `drop` runs once.
            unsafe { ManuallyDrop::drop(&mut self.0) };
        }
    }
}
