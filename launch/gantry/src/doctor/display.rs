//! Where the viewer can show itself: a window, or a page for a browser.

use std::net::TcpListener;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;

use super::finding::Finding;

/// Ports that programs take unless told otherwise: what for, and the flag that names another.
const PORTS: [(u16, &str, Taken); 5] = [
    (9876, "the viewer's data", Taken::NextIsUsed),
    (9090, "the viewer's page", Taken::NextIsUsed),
    (2000, "CARLA's clients", Taken::Flag("gantry-carla --port")),
    (
        2001,
        "the sensors of CARLA's clients",
        Taken::Flag("gantry-carla --stream-port"),
    ),
    (
        8000,
        "CARLA's Traffic Manager",
        Taken::Flag("gantry-drive --serve"),
    ),
];

/// What follows if a port is taken.
#[derive(Clone, Copy)]
enum Taken {
    /// The program looks for another by itself.
    NextIsUsed,
    /// The program ends with an error unless this flag names another.
    Flag(&'static str),
}

pub fn look() -> Vec<Finding> {
    let variable = |name| std::env::var(name).ok().filter(|text| !text.is_empty());
    let mut findings = vec![display(
        variable("WAYLAND_DISPLAY"),
        variable("DISPLAY"),
        variable("XDG_RUNTIME_DIR"),
    )];
    findings.extend(PORTS.map(|(number, purpose, taken)| port(number, purpose, taken)));
    findings
}

/// A variable that names a display which nobody serves makes the viewer fail to open its window.
fn display(wayland: Option<String>, x11: Option<String>, runtime: Option<String>) -> Finding {
    const WHAT: &str = "display";
    if let Some(name) = &wayland {
        let socket = PathBuf::from(runtime.unwrap_or_default()).join(name);
        return if UnixStream::connect(&socket).is_ok() {
            Finding::ok(WHAT, format!("Wayland, {}", socket.display()))
        } else {
            dead(&format!("WAYLAND_DISPLAY={name}"), &socket)
        };
    }
    let Some(name) = x11 else {
        return Finding::ok(WHAT, "none; the viewer is a page for a browser");
    };
    // `host:0` is another machine's, which a look would wait for.
    let Some(number) = name.strip_prefix(':') else {
        return Finding::ok(WHAT, format!("DISPLAY={name}, not looked at"));
    };
    let number = number.split('.').next().unwrap_or_default();
    let socket = PathBuf::from(format!("/tmp/.X11-unix/X{number}"));
    if UnixStream::connect(&socket).is_ok() {
        Finding::ok(WHAT, format!("X11, {}", socket.display()))
    } else {
        dead(&format!("DISPLAY={name}"), &socket)
    }
}

fn dead(variable: &str, socket: &std::path::Path) -> Finding {
    let name = variable.split('=').next().unwrap_or_default();
    Finding::warn(
        "display",
        format!("{variable}, but nobody answers at {}", socket.display()),
        format!("gantry up --view web, or unset {name}"),
    )
}

fn port(number: u16, purpose: &str, taken: Taken) -> Finding {
    const WHAT: &str = "port";
    let error = match TcpListener::bind(("127.0.0.1", number)) {
        Ok(_) => return Finding::ok(WHAT, format!("{number} is free for {purpose}")),
        Err(error) => error,
    };
    let who = format!("`ss -ltnp 'sport = :{number}'` says who has it");
    match taken {
        Taken::NextIsUsed => Finding::warn(
            WHAT,
            format!("{number} is not free ({error}); the viewer takes another"),
            who,
        ),
        Taken::Flag(flag) => Finding::warn(
            WHAT,
            format!("{number}, for {purpose}, is not free ({error})"),
            format!("name another with {flag}; {who}"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    fn words(text: &str) -> Option<String> {
        Some(text.to_owned())
    }

    #[test]
    fn a_display_that_nobody_serves_is_named() {
        let none = display(None, None, None);
        assert_eq!(none.grade, Grade::Ok, "a page needs no display");
        let finding = display(None, words(":7731.0"), None);
        assert_eq!(finding.grade, Grade::Warn);
        assert!(finding.text.contains("/tmp/.X11-unix/X7731"), "{finding:?}");
        assert!(finding.fix.contains("unset DISPLAY"), "{finding:?}");
        let finding = display(words("wayland-9"), words(":0"), words("/nowhere"));
        assert!(finding.text.contains("/nowhere/wayland-9"), "{finding:?}");
        assert_eq!(display(None, words("far:10"), None).grade, Grade::Ok);
    }

    #[test]
    fn a_served_display_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("wayland-1");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let runtime = words(&folder.path().display().to_string());
        assert_eq!(display(words("wayland-1"), None, runtime).grade, Grade::Ok);
    }

    #[test]
    fn a_port_in_use_says_who_has_it_and_how_to_take_another() {
        let other = TcpListener::bind("127.0.0.1:0").unwrap();
        let number = other.local_addr().unwrap().port();
        let finding = port(
            number,
            "CARLA's clients",
            Taken::Flag("gantry-carla --port"),
        );
        assert_eq!(finding.grade, Grade::Warn);
        assert!(finding.fix.contains("gantry-carla --port"), "{finding:?}");
        assert!(finding.fix.contains(&format!(":{number}'")), "{finding:?}");
        drop(other);
        assert_eq!(port(0, "x", Taken::NextIsUsed).grade, Grade::Ok);
    }
}
