//! Locks whose owners cannot leave things half done.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks, also after another thread panicked with it: nothing here is left between two states.
pub fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
