//! Locks that outlive a panic: a call that panicked must not end those that come after it.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Takes a lock, whoever panicked while holding it.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
