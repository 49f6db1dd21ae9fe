//! Which process has a port on the bus, so that a sentence about a broken sample can name it.

/// The process behind a port. Shown, it reads `process 4242 (python3)`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// Id of the process; `None` if the port has been removed since.
    pub pid: Option<u32>,
    /// Name of its program as the kernel has it; empty if the process has ended or belongs to
    /// another container.
    pub program: String,
    /// Name of the port; empty if it was given none. Writers on `control/ack` are called as their
    /// participant.
    pub port: String,
}

impl Origin {
    pub(crate) fn new(pid: Option<u32>, port: &str) -> Origin {
        let program = pid.and_then(|pid| std::fs::read_to_string(format!("/proc/{pid}/comm")).ok());
        Origin {
            pid,
            program: program.unwrap_or_default().trim().to_owned(),
            port: port.to_owned(),
        }
    }

    /// Whether the process is stopped by a signal or a debugger. `false` if it has ended or cannot
    /// be looked at.
    pub fn is_stopped(&self) -> bool {
        let stat = self
            .pid
            .and_then(|pid| std::fs::read_to_string(format!("/proc/{pid}/stat")).ok());
        // The state is the first letter after the program's name, which stands in brackets and may
        // hold brackets itself.
        stat.as_deref()
            .and_then(|stat| stat.rsplit_once(") "))
            .is_some_and(|(_, rest)| rest.starts_with(['T', 't']))
    }
}

/// A process, told from a later one with the same id by when it began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Life {
    pid: u32,
    /// Clock ticks from the start of the machine.
    began: u64,
}

impl Origin {
    /// The life of the process; `None` if it has ended or cannot be looked at, as in another
    /// container.
    pub fn life(&self) -> Option<Life> {
        let pid = self.pid?;
        let (_, began) = state_of(pid)?;
        Some(Life { pid, began })
    }
}

impl Life {
    /// Whether it goes on. A process that was killed and not yet taken note of by its parent has
    /// ended.
    pub fn goes_on(&self) -> bool {
        state_of(self.pid)
            .is_some_and(|(state, began)| began == self.began && !matches!(state, 'Z' | 'X' | 'x'))
    }
}

/// State of a process, and when it began.
fn state_of(pid: u32) -> Option<(char, u64)> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // Fields count from the program's name on, which is in brackets and may hold brackets itself.
    let (_, rest) = stat.rsplit_once(") ")?;
    let mut fields = rest.split(' ');
    let state = fields.next()?.chars().next()?;
    let began = fields.nth(18)?.parse().ok()?;
    Some((state, began))
}

impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.pid {
            None => f.write_str("a process that has closed its port"),
            Some(pid) if self.program.is_empty() => write!(f, "process {pid}"),
            Some(pid) => write!(f, "process {pid} ({})", self.program),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_named_by_number_and_program() {
        let mut origin = Origin {
            pid: Some(4242),
            program: "python3".into(),
            port: "planner".into(),
        };
        assert_eq!(origin.to_string(), "process 4242 (python3)");
        origin.program.clear();
        assert_eq!(origin.to_string(), "process 4242");
        assert_eq!(
            Origin::default().to_string(),
            "a process that has closed its port"
        );
    }

    #[test]
    fn a_life_ends_with_its_process() {
        let of = |pid| Origin {
            pid: Some(pid),
            ..Origin::default()
        };
        let own = of(std::process::id()).life().unwrap();
        assert!(own.goes_on());
        let later = Life {
            began: own.began + 1,
            ..own
        };
        assert!(!later.goes_on());
        let mut child = std::process::Command::new("sleep")
            .arg("60")
            .spawn()
            .unwrap();
        let life = of(child.id()).life().unwrap();
        assert!(life.goes_on());
        child.kill().unwrap();
        let deadline = std::time::Instant::now() + std::time::Duration::from_secs(120);
        while life.goes_on() {
            assert!(std::time::Instant::now() < deadline);
            std::thread::yield_now();
        }
        child.wait().unwrap();
        assert!(!life.goes_on());
    }

    #[test]
    fn this_process_runs_and_a_missing_one_is_not_stopped() {
        let this = Origin {
            pid: Some(std::process::id()),
            ..Origin::default()
        };
        assert!(!this.is_stopped() && !Origin::default().is_stopped());
    }
}
