//! The rerun viewer as a child process: how it is found, started on 127.0.0.1 only, and ended with
//! its whole process group.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;

/// Version of the viewer that matches the SDK in this binary.
pub const RERUN_VERSION: &str = "0.36.3";
/// How long a viewer may take until it listens.
const START_TIMEOUT: Duration = Duration::from_secs(30);
/// How long a viewer may take to end before it is killed.
const STOP_TIMEOUT: Duration = Duration::from_secs(3);

/// How the viewer appears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewerKind {
    /// A window.
    Native,
    /// A page for the browser.
    Web,
}

/// A running viewer. Dropping it ends it.
#[derive(Debug)]
pub struct Viewer {
    child: Child,
    /// Where data goes: `rerun+http://127.0.0.1:PORT/proxy`.
    pub data_url: String,
    /// Page to open, for [`ViewerKind::Web`].
    pub page_url: Option<String>,
}

/// Looks for the `rerun` program: in `.venv/bin` of the working folder, beside this program (where
/// pip puts both), in `.venv/bin` above it, then on the search path.
///
/// # Errors
/// A sentence that says how to install it.
pub fn find_rerun(search_path: Option<&std::ffi::OsStr>) -> anyhow::Result<PathBuf> {
    let mut places = vec![PathBuf::from(".venv/bin")];
    places.extend(std::env::current_exe().ok().iter().flat_map(|exe| {
        let above = exe.ancestors().skip(1);
        let beside = above.clone().take(1).map(PathBuf::from);
        beside
            .chain(above.take(4).map(|folder| folder.join(".venv/bin")))
            .collect::<Vec<_>>()
    }));
    places.extend(
        search_path
            .iter()
            .flat_map(|paths| std::env::split_paths(paths)),
    );
    places.into_iter().map(|folder| folder.join("rerun")).find(|program| program.is_file()).with_context(|| {
        format!(
            "the rerun viewer is not installed; run `python3 -m venv .venv && .venv/bin/pip install rerun-sdk=={RERUN_VERSION}` here, \
             or use --save FILE.rrd and open the file on another machine"
        )
    })
}

/// Tells a rerun that has never run for this user to send nothing about its use, and so spares its
/// notice of that; a choice that the user has made stays. It heeds no environment variable.
pub fn decline_analytics(program: &Path) {
    let home = std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".config"));
    let folder = std::env::var_os("XDG_CONFIG_HOME")
        .map(PathBuf::from)
        .filter(|folder| folder.is_absolute())
        .or(home);
    let is_chosen = folder.is_none_or(|it| it.join("rerun/analytics.json").exists());
    if is_chosen {
        return;
    }
    let declined = Command::new(program)
        .args(["analytics", "disable"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    if let Err(error) = declined {
        tracing::debug!(%error, "rerun will show its notice");
    }
}

impl Viewer {
    /// Starts `program` and waits until it takes data. `memory_limit` is passed on, e.g. `2GB`, and
    /// a `blueprint` that divides the window.
    ///
    /// # Errors
    /// If it cannot be started, ends at once, or does not listen in time.
    pub fn start(
        program: &Path,
        kind: ViewerKind,
        memory_limit: &str,
        blueprint: Option<&Path>,
    ) -> anyhow::Result<Viewer> {
        decline_analytics(program);
        let port = free_port(9876)?;
        let mut command = Command::new(program);
        command.args([
            "--bind",
            "127.0.0.1",
            "--port",
            &port.to_string(),
            "--memory-limit",
            memory_limit,
            "--hide-welcome-screen",
        ]);
        let page_port = if kind == ViewerKind::Web {
            Some(free_port(9090)?)
        } else {
            None
        };
        if let Some(page_port) = page_port {
            command.args([
                "--serve-web",
                "--web-viewer-port",
                &page_port.to_string(),
                "--server-memory-limit",
                memory_limit,
            ]);
        }
        command.args(blueprint);
        if std::env::var_os("RUST_LOG").is_none() {
            command.env("RUST_LOG", "warn");
        }
        command
            .env("DO_NOT_TRACK", "1")
            .stdin(Stdio::null())
            .process_group(0);
        let child = command
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let data_url = format!("rerun+http://127.0.0.1:{port}/proxy");
        let page_url = page_port.map(|page| {
            format!(
                "http://127.0.0.1:{page}/?url={}",
                data_url
                    .replace(':', "%3A")
                    .replace('/', "%2F")
                    .replace('+', "%2B")
            )
        });
        let mut viewer = Viewer {
            child,
            data_url,
            page_url,
        };
        viewer.wait_until_it_listens(port)?;
        Ok(viewer)
    }

    fn wait_until_it_listens(&mut self, port: u16) -> anyhow::Result<()> {
        let start = Instant::now();
        let address = SocketAddr::from(([127, 0, 0, 1], port));
        while TcpStream::connect_timeout(&address, Duration::from_millis(200)).is_err() {
            if let Some(status) = self.child.try_wait()? {
                bail!(
                    "the rerun viewer ended at once ({status}); it needs a display and a GPU or lavapipe. Without a display use --web or --save FILE.rrd"
                );
            }
            if start.elapsed() > START_TIMEOUT {
                bail!(
                    "the rerun viewer does not listen on 127.0.0.1:{port} after {} s",
                    START_TIMEOUT.as_secs()
                );
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// Whether it still runs; somebody may have closed the window.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        // The `rerun` of the Python wheel is a wrapper that starts the real program as its child,
        // so the whole group must end.
        let group = Pid::from_raw(self.child.id() as i32);
        let _ = killpg(group, Signal::SIGTERM);
        let start = Instant::now();
        while killpg(group, None).is_ok() && start.elapsed() < STOP_TIMEOUT {
            let _ = self.child.try_wait();
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = killpg(group, Signal::SIGKILL);
        let _ = self.child.wait();
    }
}

/// The preferred port of 127.0.0.1 if nobody has it, else any free one.
fn free_port(preferred: u16) -> anyhow::Result<u16> {
    let bound = TcpListener::bind(("127.0.0.1", preferred))
        .or_else(|_| TcpListener::bind(("127.0.0.1", 0)));
    Ok(bound
        .context("no free port on 127.0.0.1")?
        .local_addr()?
        .port())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_missing_viewer_is_explained() {
        let empty = std::ffi::OsString::from("/nonexistent");
        if let Err(error) = find_rerun(Some(&empty)) {
            assert!(error.to_string().contains("rerun-sdk==0.36.3"), "{error}");
        }
    }

    #[test]
    fn ending_the_wrapper_ends_the_program_it_started() {
        let folder = std::env::temp_dir().join(format!("gantry-view-test-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let program = folder.join("wrapper");
        let mut file = std::fs::File::create(&program).unwrap();
        // A stand-in: a shell that starts a child which listens, as the wheel's wrapper does.
        write!(file, "#!/bin/sh\nexec 2>/dev/null\npython3 -c 'import socket,sys,time\ns=socket.create_server((\"127.0.0.1\",int(sys.argv[4])))\nopen(\"{}\",\"w\").write(str(__import__(\"os\").getpid()))\ntime.sleep(60)' \"$@\" &\nwait\n", folder.join("pid").display()).unwrap();
        drop(file);
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        let mut viewer = Viewer::start(&program, ViewerKind::Native, "1GB", None).unwrap();
        assert!(viewer.is_running());
        let pid: i32 = loop {
            // The file is there before the number is in it.
            let text = std::fs::read_to_string(folder.join("pid")).unwrap_or_default();
            match text.parse() {
                Ok(pid) => break pid,
                Err(_) => std::thread::sleep(Duration::from_millis(10)),
            }
        };
        drop(viewer);
        let gone = || {
            nix::sys::signal::kill(Pid::from_raw(pid), None).is_err()
                || std::fs::read_to_string(format!("/proc/{pid}/stat"))
                    .map_or(true, |stat| stat.contains(") Z "))
        };
        assert!(gone(), "the program below the wrapper still runs");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
