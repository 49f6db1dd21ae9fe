//! What the device reports besides results: that it was lost, that memory was short, that a command
//! was refused. wgpu's own answer to these is a panic.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once};

use parking_lot::Mutex;

use crate::queue::{N_WAIT_SLICES, WAIT_SLICE};

/// Why a wait ended without its submission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The device is gone, or refused a command; with its words.
    Lost(String),
    /// The submission took longer than [`crate::MAX_GPU_WAIT`].
    Hung,
}

/// What was reported so far. Clones are the same state.
#[derive(Clone, Debug, Default)]
pub(crate) struct Health(Arc<State>);

#[derive(Debug, Default)]
struct State {
    is_ill: AtomicBool,
    fault: Mutex<Option<Fault>>,
    is_closing: AtomicBool,
}

thread_local! {
    /// Whether this thread is in a call of wgpu whose panic is turned into an error.
    static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

impl Health {
    /// Follows what `device` reports from now on.
    pub fn of(device: &wgpu::Device) -> Health {
        let health = Health::default();
        let of_loss = health.clone();
        device.set_device_lost_callback(move |reason, words| {
            if !of_loss.0.is_closing.load(Ordering::Acquire) {
                let words = words.trim();
                let words = if words.is_empty() {
                    "the driver gave no reason"
                } else {
                    words
                };
                of_loss.note(Fault::Lost(format!(
                    "the device was lost ({reason:?}: {words})"
                )));
            }
        });
        let of_errors = health.clone();
        device.on_uncaptured_error(Arc::new(move |error| of_errors.note_error(&error)));
        health
    }

    fn note_error(&self, error: &wgpu::Error) {
        // What follows the loss of a device says nothing new.
        if self.fault().is_some() {
            return;
        }
        self.note(Fault::Lost(match error {
            wgpu::Error::OutOfMemory { .. } => "its memory is full".to_owned(),
            wgpu::Error::Validation { description, .. }
            | wgpu::Error::Internal { description, .. } => one_line(description),
        }));
    }

    /// Notes why the device can no longer be used, unless something is noted already.
    pub fn note(&self, fault: Fault) {
        let mut noted = self.0.fault.lock();
        noted.get_or_insert(fault);
        self.0.is_ill.store(true, Ordering::Release);
    }

    /// Why the device can no longer be used; `None` while it can.
    pub fn fault(&self) -> Option<Fault> {
        if !self.0.is_ill.load(Ordering::Acquire) {
            return None;
        }
        let noted = self.0.fault.lock();
        noted.clone()
    }

    /// From here on the end of the device is meant.
    pub fn close(&self) {
        self.0.is_closing.store(true, Ordering::Release);
    }

    /// Waits for a submission, or for all; at most [`crate::MAX_GPU_WAIT`], and not at all on a
    /// device that hangs.
    pub fn wait(
        &self,
        device: &wgpu::Device,
        submission: Option<&wgpu::SubmissionIndex>,
    ) -> Result<(), Fault> {
        for _ in 0..N_WAIT_SLICES {
            if let Some(Fault::Hung) = self.fault() {
                return Err(Fault::Hung);
            }
            let wait = wgpu::PollType::Wait {
                submission_index: submission.cloned(),
                timeout: Some(WAIT_SLICE),
            };
            match self.poll(device, wait) {
                Ok(_) => return self.fault().map_or(Ok(()), Err),
                Err(wgpu::PollError::Timeout) => {}
                // A submission that a lost device never took.
                Err(wgpu::PollError::WrongSubmissionIndex(..)) => {
                    let words = "a submission was not taken".to_owned();
                    return Err(self.fault().unwrap_or(Fault::Lost(words)));
                }
            }
        }
        self.note(Fault::Hung);
        Err(Fault::Hung)
    }

    /// As [`wgpu::Device::poll`], but that wgpu panics about a lost device is noted instead.
    pub fn poll(
        &self,
        device: &wgpu::Device,
        wait: wgpu::PollType,
    ) -> Result<wgpu::PollStatus, wgpu::PollError> {
        silence_caught_panics();
        let before = IS_CAUGHT.replace(true);
        let polled = catch_unwind(AssertUnwindSafe(|| device.poll(wait)));
        IS_CAUGHT.set(before);
        polled.unwrap_or_else(|panic| {
            let words = panic.downcast_ref::<String>().map_or("", String::as_str);
            self.note(Fault::Lost(one_line(words)));
            Ok(wgpu::PollStatus::Poll)
        })
    }
}

/// The words of an error of several lines as one.
fn one_line(text: &str) -> String {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    lines.collect::<Vec<_>>().join(" ")
}

/// Panics that become errors are not reported as panics.
fn silence_caught_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !IS_CAUGHT.get() {
                report(panic);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_fault_stays() {
        let health = Health::default();
        assert_eq!(health.fault(), None);
        health.note(Fault::Hung);
        health.note(Fault::Lost("later".into()));
        assert_eq!(health.fault(), Some(Fault::Hung));
    }

    #[test]
    fn errors_of_several_lines_become_one() {
        assert_eq!(
            one_line("Validation Error\n\nCaused by:\n  In x\n"),
            "Validation Error Caused by: In x"
        );
    }
}
