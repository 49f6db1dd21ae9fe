//! Shared memory, the bus, ports, limits.

use std::net::TcpListener;

use nix::sys::resource::{Resource, getrlimit};

use super::finding::Finding;
use crate::bus::Bus;
use crate::up::quickstart_bytes;

/// File descriptors that the daemon may need for a dozen sensors with eight readers each.
const OPEN_FILES: u64 = 4096;
/// Ports of the viewer: data, and the page for the browser.
const VIEWER_PORTS: [u16; 2] = [9876, 9090];

pub fn look(domain: &str) -> Vec<Finding> {
    let mut findings = vec![shared_memory(
        schema_bus::shared_memory_free(),
        quickstart_bytes(),
    )];
    findings.extend(bus(domain));
    findings.extend(VIEWER_PORTS.map(port));
    findings.push(open_files());
    findings.push(cpus());
    findings
}

fn shared_memory(free: Option<u64>, need: u64) -> Finding {
    const WHAT: &str = "shared memory";
    let Some(free) = free else {
        return Finding::fail(
            WHAT,
            "/dev/shm cannot be looked at",
            "mount -t tmpfs tmpfs /dev/shm (as root)",
        );
    };
    let (free_mib, need_mib) = (free >> 20, need.div_ceil(1 << 20));
    let text = format!("/dev/shm has {free_mib} MiB free, the quickstart needs {need_mib} MiB");
    if free >= need {
        return Finding::ok(WHAT, text);
    }
    let size = need.div_ceil(1 << 30) + 1;
    let fix = format!(
        "in Docker --shm-size={size}g, else mount -o remount,size={size}G /dev/shm (as root)"
    );
    // A warning only, because smaller rigs still run.
    if free_mib < 32 {
        Finding::fail(WHAT, text, fix)
    } else {
        Finding::warn(WHAT, text, fix)
    }
}

fn bus(domain: &str) -> Vec<Finding> {
    const WHAT: &str = "bus";
    let bus = match Bus::open(domain) {
        Ok(bus) => bus,
        Err(error) => {
            return vec![Finding::fail(
                WHAT,
                format!("{error:#}"),
                "check who owns /dev/shm and /tmp/iceoryx2, and their free space",
            )];
        }
    };
    let cleaned = bus.clean();
    let others: Vec<String> = bus
        .programs()
        .into_iter()
        .filter(|program| program != "gantry")
        .collect();
    let running = if others.is_empty() {
        "nobody is on it".to_owned()
    } else {
        format!("on it: {}", others.join(", "))
    };
    let dead = if cleaned == 0 {
        String::new()
    } else {
        format!("; cleaned up after {cleaned} that had been killed")
    };
    let daemon = match bus.daemon_alive() {
        Ok(true) => Finding::ok("simulator", format!("runs on domain {domain:?}")),
        Ok(false) => Finding::ok("simulator", format!("does not run on domain {domain:?}")),
        Err(error) => Finding::warn(
            "simulator",
            format!("{error:#}"),
            "stop all programs of this domain, or use another with --domain",
        ),
    };
    vec![Finding::ok(WHAT, format!("{running}{dead}")), daemon]
}

fn port(number: u16) -> Finding {
    const WHAT: &str = "port";
    match TcpListener::bind(("127.0.0.1", number)) {
        Ok(_) => Finding::ok(WHAT, format!("{number} is free for the viewer")),
        Err(error) => Finding::warn(
            WHAT,
            format!("{number} is not free ({error}); the viewer takes another"),
            format!("`ss -ltnp 'sport = :{number}'` says who has it"),
        ),
    }
}

fn open_files() -> Finding {
    const WHAT: &str = "open files";
    match getrlimit(Resource::RLIMIT_NOFILE) {
        Ok((_, hard)) if hard >= OPEN_FILES => {
            Finding::ok(WHAT, format!("a process may have {hard}"))
        }
        Ok((_, hard)) => Finding::warn(
            WHAT,
            format!("a process may have {hard}; many sensors need {OPEN_FILES}"),
            format!("ulimit -Hn {OPEN_FILES} (as root)"),
        ),
        Err(error) => Finding::warn(WHAT, format!("the limit cannot be read: {error}"), ""),
    }
}

fn cpus() -> Finding {
    match std::thread::available_parallelism() {
        Ok(n) if n.get() >= 2 => Finding::ok("processors", n.to_string()),
        Ok(n) => Finding::warn(
            "processors",
            n.to_string(),
            "with one processor readers and the simulator wait for each other; give the machine two",
        ),
        Err(error) => Finding::warn("processors", format!("cannot be counted: {error}"), ""),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn dockers_64_mib_are_too_little_for_the_quickstart() {
        let need = quickstart_bytes();
        assert_eq!(shared_memory(Some(need), need).grade, Grade::Ok);
        let finding = shared_memory(Some(64 << 20), need);
        assert_eq!(finding.grade, Grade::Warn);
        assert!(finding.fix.contains("--shm-size=2g"), "{}", finding.fix);
        assert_eq!(shared_memory(Some(1 << 20), need).grade, Grade::Fail);
    }
}
