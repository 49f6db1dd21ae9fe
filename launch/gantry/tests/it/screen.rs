//! `gantry top` on a terminal: keys, sizes, and that the terminal is as before whatever ends it.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::num::NonZero;
use std::os::fd::OwnedFd;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

use nix::pty::{Winsize, openpty};
use nix::sys::signal::{Signal, kill};
use nix::sys::termios::{Termios, tcgetattr};
use nix::unistd::Pid;
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox, eventually};

/// `gantry top` with a terminal of its own.
struct OnTerminal {
    child: Child,
    /// The keyboard.
    keys: File,
    /// The program's end of the terminal.
    theirs: OwnedFd,
    /// What the terminal shows.
    shown: Arc<Mutex<vt100::Parser>>,
    before: Termios,
}

impl OnTerminal {
    fn start(sandbox: &Sandbox, more: &[&str]) -> OnTerminal {
        let size = Winsize {
            ws_row: 30,
            ws_col: 120,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        let pair = openpty(Some(&size), None).unwrap();
        let before = tcgetattr(&pair.slave).unwrap();
        let end = || Stdio::from(pair.slave.try_clone().unwrap());
        let child = Command::new(env!("CARGO_BIN_EXE_gantry"))
            .args(["top", "--every", "100ms", "--domain", sandbox.domain()])
            .args(more)
            .current_dir(sandbox.dir())
            .env("TERM", "xterm-256color")
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .spawn()
            .unwrap();
        let shown = Arc::new(Mutex::new(vt100::Parser::new(nonzero(30), nonzero(120), 0)));
        let (mut output, theirs) = (File::from(pair.master.try_clone().unwrap()), shown.clone());
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(n @ 1..) = output.read(&mut bytes) {
                theirs.lock().unwrap().process(&bytes[..n]);
            }
        });
        OnTerminal {
            child,
            keys: File::from(pair.master),
            theirs: pair.slave,
            shown,
            before,
        }
    }

    fn contents(&self) -> String {
        self.shown.lock().unwrap().screen().contents()
    }

    fn wait_for(&self, text: &str) {
        eventually(&format!("{text:?} on the screen"), || {
            self.contents()
                .replace('\n', " ")
                .contains(text)
                .then_some(())
        });
    }

    fn wait_without(&self, text: &str) {
        eventually(&format!("no {text:?} on the screen"), || {
            (!self.contents().contains(text)).then_some(())
        });
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.child.id() as i32), signal).unwrap();
    }

    fn resize(&self, rows: u16, columns: u16) {
        // First what is shown, then the terminal: what the program draws anew fits, however soon.
        self.shown
            .lock()
            .unwrap()
            .screen_mut()
            .set_size(nonzero(rows), nonzero(columns));
        let size = [
            "rows".into(),
            rows.to_string(),
            "cols".into(),
            columns.to_string(),
        ];
        let end = Stdio::from(self.theirs.try_clone().unwrap());
        assert!(
            Command::new("stty")
                .args(size)
                .stdin(end)
                .status()
                .unwrap()
                .success()
        );
        self.signal(Signal::SIGWINCH);
    }

    /// Waits for the end, and checks that the terminal is as it was before.
    fn expect_end(mut self, code: i32) {
        let status = eventually("the end", || self.child.try_wait().unwrap());
        assert_eq!(status.code(), Some(code), "{}", self.contents());
        assert_eq!(
            tcgetattr(&self.theirs).unwrap(),
            self.before,
            "raw mode is left"
        );
        eventually("the terminal's own screen and cursor", || {
            let shown = self.shown.lock().unwrap();
            let screen = shown.screen();
            (!screen.alternate_screen() && !screen.hide_cursor()).then_some(())
        });
    }
}

impl Drop for OnTerminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn nonzero(n: u16) -> NonZero<u16> {
    NonZero::new(n).unwrap()
}

fn test_card(sandbox: &Sandbox) -> Process {
    let card = binary_path("examples/test_card");
    let args = [sandbox.domain(), "100000"];
    let mut card = sandbox.spawn_program("test_card", &card, &args, &[]);
    card.wait_line("test card on");
    card
}

#[test]
fn keys_select_filter_measure_and_quit() {
    let sandbox = Sandbox::new("screen");
    let _card = test_card(&sandbox);
    let mut top = OnTerminal::start(&sandbox, &[]);
    top.wait_for("ego/card/rgb");
    assert!(top.shown.lock().unwrap().screen().alternate_screen());
    top.wait_for("test_card");
    top.press("/imu");
    top.wait_for("filter: imu");
    top.press("\r");
    top.wait_for("Topics: 1 with \"imu\"");
    top.wait_without("ego/card/rgb ");
    // The arrow key selects, m asks to read; nobody reads the topic, so only M does.
    top.press("\x1b[B");
    top.press("m");
    top.wait_for("nobody reads ego/card/imu, so its sensor rests");
    top.press("M");
    top.wait_for("0●");
    top.wait_for("1/16");
    top.press("\r");
    top.wait_for("by top's own reader");
    top.press("m");
    top.wait_for("ego/card/imu is read no more");
    top.wait_for("0 of 16 places");
    top.press("g");
    top.wait_for("Who reads what");
    top.press("?");
    top.wait_for("places taken and places there are");
    top.press("q");
    top.expect_end(0);
}

#[test]
fn the_screen_follows_the_terminals_size() {
    let sandbox = Sandbox::new("size");
    let _card = test_card(&sandbox);
    let mut top = OnTerminal::start(&sandbox, &["--sort", "rate"]);
    top.wait_for("ego/card/rgb");
    top.resize(8, 40);
    top.wait_for("40 × 8 characters");
    top.resize(24, 100);
    top.wait_for("ego/card/");
    top.wait_for("q quit");
    // Ctrl-C is a key in a terminal that hands on every key.
    top.press("\x03");
    top.expect_end(0);
}

#[test]
fn signals_give_the_terminal_back() {
    let sandbox = Sandbox::new("signals");
    for signal in [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP] {
        let top = OnTerminal::start(&sandbox, &[]);
        top.wait_for("no simulator");
        top.signal(signal);
        top.expect_end(0);
    }
}

#[test]
fn one_screen_of_text_is_printed_on_a_terminal_too() {
    let sandbox = Sandbox::new("once");
    let _card = test_card(&sandbox);
    let pair = OnTerminal::start(&sandbox, &["--once"]);
    // With --once there is no screen to leave, even on a terminal.
    pair.wait_for("ego/card/rgb");
    pair.expect_end(0);
}
