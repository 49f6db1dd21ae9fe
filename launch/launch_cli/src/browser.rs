//! The user's display and browser.

use std::process::{Command, Stdio};

/// Whether there is a display, of X11 or Wayland.
pub fn has_display() -> bool {
    is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

/// Whether there is a display of X11, which Wayland's desktops have too.
pub fn has_x11_display() -> bool {
    is_set("DISPLAY")
}

/// Opens a page in the user's browser, `BROWSER` or the desktop's. Nothing happens where there is
/// none: whoever calls this has printed the address.
pub fn open_page(page: &str) {
    let browser = std::env::var("BROWSER").unwrap_or_else(|_| "xdg-open".to_owned());
    let opened = Command::new(&browser)
        .arg(page)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    match opened {
        // Nobody waits for the browser, which may stay for as long as the user likes.
        Ok(mut child) => drop(std::thread::spawn(move || child.wait())),
        Err(error) => tracing::debug!(browser, %error, "the page is not opened"),
    }
}

fn is_set(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| !value.is_empty())
}
