//! What one test has for itself: a directory, a domain, an iceoryx2 root and prefix.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::process::Process;

/// Directory and names of one test; removed when dropped.
#[derive(Debug)]
pub struct Sandbox {
    dir: tempfile::TempDir,
    domain: String,
    prefix: String,
}

static COUNT: AtomicU32 = AtomicU32::new(0);

impl Sandbox {
    /// A fresh sandbox. `name` is part of its directory's name, for people who look for it.
    pub fn new(name: &str) -> Self {
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let dir = tempfile::Builder::new()
            .prefix(&format!("gantry-{name}-"))
            .tempdir()
            .expect("temporary directory");
        let prefix = format!("gt{}x{number}_", std::process::id());
        std::fs::create_dir_all(dir.path().join("config")).expect("config directory");
        std::fs::create_dir_all(dir.path().join("iox")).expect("iceoryx2 root");
        let config = format!(
            "[global]\nroot-path = {:?}\nprefix = {prefix:?}\n",
            dir.path().join("iox").display().to_string()
        );
        std::fs::write(dir.path().join("config/iceoryx2.toml"), config)
            .expect("iceoryx2 configuration");
        Sandbox {
            dir,
            domain: format!("t{}x{number}", std::process::id()),
            prefix,
        }
    }

    /// Working directory of every process of this test.
    pub fn dir(&self) -> &Path {
        self.dir.path()
    }

    /// A path inside it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Domain to pass with `--domain`.
    pub fn domain(&self) -> &str {
        &self.domain
    }

    /// Prefix of this sandbox's files in `/dev/shm`. A test that opens ports itself needs it.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Root folder of iceoryx2 in this sandbox. A test that opens ports itself needs it.
    pub fn iceoryx_root(&self) -> PathBuf {
        self.path("iox")
    }

    /// The iceoryx2 configuration file, `config/iceoryx2.toml` in the working directory, for
    /// programs that are told its path.
    pub fn iceoryx_config(&self) -> PathBuf {
        self.path("config/iceoryx2.toml")
    }

    /// Writes a file into the directory.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).expect("file in the sandbox");
        path
    }

    /// Starts one of the project's binaries in this sandbox.
    pub fn spawn(&self, binary: &str, args: &[&str]) -> Process {
        Process::start(binary, &binary_path(binary), args, self.dir.path(), &[])
    }

    /// Starts any program in this sandbox with extra environment.
    pub fn spawn_program(
        &self,
        name: &str,
        program: &Path,
        args: &[&str],
        env: &[(&str, &str)],
    ) -> Process {
        Process::start(name, program, args, self.dir.path(), env)
    }

    /// Shared-memory files that carry this sandbox's prefix.
    pub fn leftovers(&self) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir("/dev/shm") else {
            return Vec::new();
        };
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        // By design, iceoryx2 never removes its one management file of 16 bytes.
        let mut left: Vec<String> = names
            .filter(|n| n.starts_with(&self.prefix) && !n.ends_with(".global_mgmt"))
            .collect();
        left.sort();
        left
    }
}

impl Drop for Sandbox {
    fn drop(&mut self) {
        let Ok(entries) = std::fs::read_dir("/dev/shm") else {
            return;
        };
        for entry in entries.flatten() {
            if entry
                .file_name()
                .to_string_lossy()
                .starts_with(&self.prefix)
            {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// Path of a binary of the workspace. Cargo puts it beside the directory of the running test.
///
/// # Panics
/// With the command to run if it was not built.
pub fn binary_path(binary: &str) -> PathBuf {
    let test = std::env::current_exe().expect("path of the running test");
    let path = test
        .parent()
        .and_then(Path::parent)
        .expect("tests live in target/PROFILE/deps")
        .join(binary);
    assert!(
        path.exists(),
        "{binary} was not built; run: cargo build --release --workspace"
    );
    path
}

/// Root of the repository.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .canonicalize()
        .expect("repository root")
}
