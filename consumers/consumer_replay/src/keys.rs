//! Keys of the terminal, and the line that shows where the replay is. Only a terminal in whose
//! foreground this process runs is touched, and it is as before when the replay ends.

use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use nix::sys::termios::{
    LocalFlags, SetArg, SpecialCharacterIndices, Termios, tcgetattr, tcsetattr,
};
use schema_frames::StepMode;

/// How often the line is written at most.
const SHOW_EVERY: Duration = Duration::from_millis(200);

/// What a key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Stop, or go on.
    Pause,
    /// One tick.
    Step,
    /// So many seconds further, or back.
    Seek(i32),
    /// Faster.
    Faster,
    /// Slower.
    Slower,
    /// End.
    Quit,
}

/// The terminal while its keys are read one by one.
pub struct Keys {
    before: Termios,
    pressed: Receiver<Key>,
    shown_at: Option<Instant>,
    shown: String,
}

impl Keys {
    /// Takes the keys; `None` if the standard input is no terminal, or another job's.
    pub fn open() -> Option<Keys> {
        let stdin = std::io::stdin();
        let foreground = nix::unistd::tcgetpgrp(stdin.as_fd()).ok()?;
        if foreground != nix::unistd::getpgrp() {
            return None;
        }
        let before = tcgetattr(stdin.as_fd()).ok()?;
        let mut raw = before.clone();
        raw.local_flags
            .remove(LocalFlags::ICANON | LocalFlags::ECHO);
        raw.control_chars[SpecialCharacterIndices::VMIN as usize] = 1;
        raw.control_chars[SpecialCharacterIndices::VTIME as usize] = 0;
        tcsetattr(stdin.as_fd(), SetArg::TCSANOW, &raw).ok()?;
        let (send, pressed) = channel();
        let reading = std::thread::Builder::new()
            .name("keys".into())
            .spawn(move || {
                let mut buffer = [0u8; 64];
                loop {
                    match std::io::stdin().lock().read(&mut buffer) {
                        Ok(n) if n > 0 => {
                            if keys(&buffer[..n])
                                .into_iter()
                                .any(|key| send.send(key).is_err())
                            {
                                return;
                            }
                        }
                        _ => return,
                    }
                }
            });
        let keys = Keys {
            before,
            pressed,
            shown_at: None,
            shown: String::new(),
        };
        reading.ok()?;
        eprintln!("space pause, n one tick, ← → 1 s, ↓ ↑ 10 s, + - speed, q end");
        Some(keys)
    }

    /// The next key that was pressed.
    pub fn next(&self) -> Option<Key> {
        self.pressed.try_recv().ok()
    }

    /// Shows where the replay is.
    pub fn show(&mut self, sim_nanos: u64, last_nanos: u64, mode: StepMode, ratio: Option<f64>) {
        let is_early = self.shown_at.is_some_and(|at| at.elapsed() < SHOW_EVERY);
        let state = match mode {
            StepMode::FreeRunning => "▶",
            StepMode::Stepped => "⏸",
        };
        let speed = ratio.map_or_else(|| "max".to_owned(), |ratio| format!("×{ratio:.2}"));
        let secs = |nanos: u64| nanos as f64 * 1e-9;
        let line = format!(
            "{state} {:.2} s of {:.2} s {speed}",
            secs(sim_nanos),
            secs(last_nanos)
        );
        if is_early || line == self.shown {
            return;
        }
        eprint!("\r\x1b[2K{line}");
        let _ = std::io::stderr().flush();
        (self.shown_at, self.shown) = (Some(Instant::now()), line);
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        let stdin = std::io::stdin();
        let _ = tcsetattr(stdin.as_fd(), SetArg::TCSANOW, &self.before);
        if self.shown_at.is_some() {
            eprintln!();
        }
    }
}

/// The keys that these bytes of a terminal are.
fn keys(mut bytes: &[u8]) -> Vec<Key> {
    let arrows: [(&[u8], Key); 8] = [
        (b"\x1b[C", Key::Seek(1)),
        (b"\x1b[D", Key::Seek(-1)),
        (b"\x1b[A", Key::Seek(10)),
        (b"\x1b[B", Key::Seek(-10)),
        (b"\x1bOC", Key::Seek(1)),
        (b"\x1bOD", Key::Seek(-1)),
        (b"\x1bOA", Key::Seek(10)),
        (b"\x1bOB", Key::Seek(-10)),
    ];
    let mut found = Vec::new();
    while let Some((first, rest)) = bytes.split_first() {
        if let Some((sequence, key)) = arrows.iter().find(|(of, _)| bytes.starts_with(of)) {
            found.push(*key);
            bytes = &bytes[sequence.len()..];
            continue;
        }
        found.extend(match first {
            b' ' => Some(Key::Pause),
            b'n' | b'.' => Some(Key::Step),
            b'+' | b'=' => Some(Key::Faster),
            b'-' => Some(Key::Slower),
            b'q' => Some(Key::Quit),
            _ => None,
        });
        bytes = rest;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_told_apart_and_others_are_passed_over() {
        assert_eq!(
            keys(b" n\x1b[C\x1b[D\x1bOA\x1b[Bx+-q"),
            [
                Key::Pause,
                Key::Step,
                Key::Seek(1),
                Key::Seek(-1),
                Key::Seek(10),
                Key::Seek(-10),
                Key::Faster,
                Key::Slower,
                Key::Quit
            ]
        );
        assert_eq!(keys(b"\x1b[5~\xff\xfe"), []);
    }
}
