//! The processes of one scenario: their domain, their logs, and their end, whatever happens.

use std::fs::{self, File};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use schema_bus::{BusOptions, write_private_config};
use serde::{Deserialize, Serialize};

/// How often a process that was asked to end is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// How much of a log is quoted when a process fails.
const QUOTED_LINES: usize = 5;

/// A place of its own on the bus, in shared memory and in the file system.
#[derive(Debug)]
pub struct Quarters {
    folder: tempfile::TempDir,
    domain: String,
    prefix: String,
    /// Where it is written down who lives here.
    register: PathBuf,
}

/// Who lives in quarters, for whoever finds them after a kill.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Register {
    folder: PathBuf,
    prefix: String,
    /// Process ids and when they started, in the kernel's ticks.
    processes: Vec<(i32, u64)>,
}

impl Quarters {
    /// Takes quarters; `number` is unique in this process, and `register` a file that says so.
    ///
    /// # Errors
    /// If the temporary folder cannot be written.
    pub fn take(number: u64, register: &Path) -> anyhow::Result<Quarters> {
        // Sockets live below it, whose paths must be short.
        let folder = tempfile::Builder::new()
            .prefix("gantry-set-")
            .tempdir()
            .context("cannot make a temporary folder")?;
        let own = std::process::id();
        let quarters = Quarters {
            domain: format!("set{own}x{number}"),
            prefix: format!("gs{own}x{number}_"),
            register: register.to_owned(),
            folder,
        };
        fs::create_dir_all(quarters.iceoryx_root())?;
        write_private_config(
            quarters.folder.path(),
            &quarters.iceoryx_root(),
            &quarters.prefix,
        )?;
        quarters.write_register(&[])?;
        Ok(quarters)
    }

    /// The domain.
    pub fn domain(&self) -> &str {
        &self.domain
    }

    /// Options with which this process joins its bus.
    pub fn bus_options(&self) -> BusOptions {
        BusOptions {
            iceoryx_root: Some(self.iceoryx_root()),
            prefix: Some(self.prefix.clone()),
        }
    }

    fn iceoryx_root(&self) -> PathBuf {
        self.folder.path().join("iox")
    }

    fn write_register(&self, children: &[Running]) -> anyhow::Result<()> {
        let register = Register {
            folder: self.folder.path().to_owned(),
            prefix: self.prefix.clone(),
            processes: children
                .iter()
                .filter_map(|it| Some((it.child.id() as i32, started(it.child.id() as i32)?)))
                .collect(),
        };
        if let Some(folder) = self.register.parent() {
            fs::create_dir_all(folder)?;
        }
        fs::write(&self.register, serde_json::to_string(&register)?)
            .with_context(|| format!("cannot write {}", self.register.display()))
    }
}

impl Drop for Quarters {
    fn drop(&mut self) {
        // The processes are gone; what a killed one left in shared memory goes with them.
        remove_shared_memory(&self.prefix);
        let _ = fs::remove_file(&self.register);
    }
}

/// Ends what a killed run left behind: processes, shared memory and temporary folders of all
/// registers in `folder`.
pub fn clear_quarters(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let text = fs::read_to_string(&path).unwrap_or_default();
        if let Ok(register) = serde_json::from_str::<Register>(&text)
            && register.prefix.starts_with("gs")
        {
            for (pid, start) in register.processes {
                // A number that another process has by now is left alone.
                if started(pid) == Some(start) {
                    let _ = kill(Pid::from_raw(pid), Signal::SIGKILL);
                }
            }
            remove_shared_memory(&register.prefix);
            let is_ours = register
                .folder
                .file_name()
                .is_some_and(|name| name.to_string_lossy().starts_with("gantry-set-"));
            if is_ours {
                let _ = fs::remove_dir_all(&register.folder);
            }
        }
        let _ = fs::remove_file(&path);
    }
}

fn remove_shared_memory(prefix: &str) {
    let Ok(entries) = fs::read_dir("/dev/shm") else {
        return;
    };
    for entry in entries.flatten() {
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// When a process started, in ticks since the machine did; `None` if there is no such process.
fn started(pid: i32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in brackets may hold anything, so the fields are counted from its end.
    let after = stat.rsplit_once(") ")?.1;
    after.split(' ').nth(19)?.parse().ok()
}

/// A process that runs.
#[derive(Debug)]
struct Running {
    name: &'static str,
    child: Child,
    log: PathBuf,
}

/// The processes of a scenario; killed when dropped, the last first.
#[derive(Debug)]
pub struct Children {
    quarters: Quarters,
    running: Vec<Running>,
}

impl Children {
    /// No processes yet.
    pub fn new(quarters: Quarters) -> Children {
        Children {
            quarters,
            running: Vec::new(),
        }
    }

    /// Where they live.
    pub fn quarters(&self) -> &Quarters {
        &self.quarters
    }

    /// Starts a program; all that it prints goes into `log`.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(
        &mut self,
        name: &'static str,
        program: &Path,
        words: &[String],
        log: &Path,
    ) -> anyhow::Result<()> {
        let out = File::create(log).with_context(|| format!("cannot write {}", log.display()))?;
        let err = out.try_clone()?;
        let child = Command::new(program)
            .args(words)
            .args(["--domain", self.quarters.domain()])
            // A maker that is killed takes them with it. The thread that starts them outlives them.
            .args(["--parent", &std::process::id().to_string()])
            .current_dir(self.quarters.folder.path())
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(err)
            // Ctrl-C on the terminal is for the maker, which ends its processes in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        self.running.push(Running {
            name,
            child,
            log: log.to_owned(),
        });
        self.quarters.write_register(&self.running)
    }

    /// Fails if one of them has ended.
    ///
    /// # Errors
    /// Which, how, and what it said last.
    pub fn check(&mut self) -> anyhow::Result<()> {
        for running in &mut self.running {
            if let Some(status) = running.child.try_wait()? {
                anyhow::bail!("{}", running.obituary(status));
            }
        }
        Ok(())
    }

    /// Asks one to end, and waits for it; kills it after `within`.
    ///
    /// # Errors
    /// If it does not end with code 0 by itself.
    pub fn finish(&mut self, name: &str, within: Duration) -> anyhow::Result<()> {
        let at = self.running.iter().position(|it| it.name == name);
        let Some(at) = at else { return Ok(()) };
        let mut running = self.running.remove(at);
        match running.end(within)? {
            status if status.success() => Ok(()),
            status => anyhow::bail!("{}", running.obituary(status)),
        }
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        while let Some(mut running) = self.running.pop() {
            let _ = running.child.kill();
            let _ = running.child.wait();
        }
    }
}

impl Running {
    fn end(&mut self, within: Duration) -> anyhow::Result<ExitStatus> {
        let _ = kill(Pid::from_raw(self.child.id() as i32), Signal::SIGTERM);
        let start = Instant::now();
        while start.elapsed() < within {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            std::thread::sleep(LOOK_EVERY);
        }
        self.child.kill()?;
        Ok(self.child.wait()?)
    }

    fn obituary(&self, status: ExitStatus) -> String {
        let text = fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        let last = lines[lines.len().saturating_sub(QUOTED_LINES)..].join("\n  ");
        format!("{} ended ({status}); it said last:\n  {last}", self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sleeper(children: &mut Children, log: &Path) {
        let words = ["-c".to_owned(), "echo here; sleep 1000".to_owned()];
        children
            .start("sleeper", Path::new("/bin/sh"), &words, log)
            .unwrap();
    }

    #[test]
    fn what_a_killed_run_left_is_ended_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let registers = folder.path().join("running");
        let quarters = Quarters::take(1, &registers.join("a")).unwrap();
        let left = quarters.folder.path().to_owned();
        let mut children = Children::new(quarters);
        sleeper(&mut children, &folder.path().join("log"));
        children.check().unwrap();
        clear_quarters(&registers);
        let start = Instant::now();
        while children.check().is_ok() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(LOOK_EVERY);
        }
        let error = children.check().unwrap_err().to_string();
        assert!(error.contains("sleeper ended (signal: 9"), "{error}");
        assert!(!left.exists() && !registers.join("a").exists());
    }

    #[test]
    fn dropping_ends_everything() {
        let folder = tempfile::tempdir().unwrap();
        let quarters = Quarters::take(2, &folder.path().join("running/a")).unwrap();
        let mut children = Children::new(quarters);
        sleeper(&mut children, &folder.path().join("log"));
        let pid = children.running[0].child.id() as i32;
        assert!(started(pid).is_some());
        drop(children);
        assert_eq!(started(pid), None);
        assert!(!folder.path().join("running/a").exists());
    }
}
