//! What one test has for itself: a directory, a domain, an iceoryx2 root and prefix, and folders for
//! data, caches and runtime files.

use std::ffi::OsStr;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
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
        let root = dir.path().join("iox");
        std::fs::create_dir_all(&root).expect("iceoryx2 root");
        schema_bus::write_private_config(dir.path(), &root, &prefix)
            .expect("iceoryx2 configuration");
        // Programs accept a runtime folder only if nobody else may enter it.
        std::fs::DirBuilder::new()
            .mode(0o700)
            .create(dir.path().join("run"))
            .expect("runtime folder");
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

    /// Folders of a user who has never used Gantry, so that a test does not depend on the maps and
    /// recordings that the developer has.
    fn own_folders(&self) -> [(&'static str, PathBuf); 4] {
        // Compiled shaders stay where they are: they depend on nothing that a test is about, and
        // compiling them takes seconds.
        let user = |variable: &str| {
            std::env::var_os(variable)
                .filter(|path| !path.is_empty())
                .map(PathBuf::from)
        };
        let caches = user("XDG_CACHE_HOME")
            .or_else(|| Some(user("HOME")?.join(".cache")))
            .unwrap_or_else(|| self.path("cache"));
        let shaders = user("MESA_SHADER_CACHE_DIR").unwrap_or(caches);
        [
            ("XDG_DATA_HOME", self.path("data")),
            ("XDG_CACHE_HOME", self.path("cache")),
            ("XDG_RUNTIME_DIR", self.path("run")),
            ("MESA_SHADER_CACHE_DIR", shaders),
        ]
    }

    /// Starts one of the project's binaries in this sandbox.
    pub fn spawn(&self, binary: &str, args: &[&str]) -> Process {
        self.spawn_program(binary, &binary_path(binary), args, &[])
    }

    /// Runs `gantry up` on a launch file of this text, which is written as `test.toml`.
    pub fn up(&self, launch: &str, more: &[&str]) -> Process {
        let file = self.write("test.toml", launch);
        let (file, data) = (file.display().to_string(), self.path("data"));
        let data = data.display().to_string();
        let words = ["up", &file, "--data", &data, "--domain", &self.domain];
        self.spawn("gantry", &[&words[..], more].concat())
    }

    /// Starts any program in this sandbox with extra environment.
    pub fn spawn_program(
        &self,
        name: &str,
        program: &Path,
        args: &[&str],
        env: &[(&str, &str)],
    ) -> Process {
        self.spawn_at(self.dir.path(), name, program, args, env)
    }

    /// As [`Sandbox::spawn_program`], in another working directory.
    pub(crate) fn spawn_at(
        &self,
        place: &Path,
        name: &str,
        program: &Path,
        args: &[&str],
        env: &[(&str, &str)],
    ) -> Process {
        let own = self.own_folders();
        let own = own.iter().map(|(key, path)| (*key, path.as_os_str()));
        let given = env.iter().map(|(key, value)| (*key, OsStr::new(*value)));
        let env: Vec<(&str, &OsStr)> = own.chain(given).collect();
        Process::start(name, program, args, place, &env)
    }

    /// Makes a folder of links to everything in `folder`, for a program that reads files beside it:
    /// started there, it finds them, and is on this sandbox's bus. What it writes there is gone
    /// with the sandbox, unless it changes a file that a link leads to.
    pub fn links_to(&self, folder: &Path) -> PathBuf {
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let place = self.path(&format!("links{number}"));
        std::fs::create_dir_all(place.join("config")).expect("folder of links");
        link_entries(folder, &place);
        let own = folder.join("config");
        if own.is_dir() {
            link_entries(&own, &place.join("config"));
        }
        // In place of the folder's own, if it has one.
        let config = place.join("config/iceoryx2.toml");
        let _ = std::fs::remove_file(&config);
        std::fs::copy(self.iceoryx_config(), config).expect("iceoryx2 configuration");
        place
    }

    /// iceoryx2's files and folders of nodes and services in this sandbox.
    pub fn bookkeeping(&self) -> Vec<String> {
        let mut kept = Vec::new();
        let mut folders = vec![self.path("iox/nodes"), self.path("iox/services")];
        while let Some(folder) = folders.pop() {
            // A folder that is gone has nothing.
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
            for path in entries.map(|entry| entry.path()) {
                let mode = std::fs::symlink_metadata(&path).map(|about| about.mode() & 0o7777);
                kept.push(format!("{} {:o}", path.display(), mode.unwrap_or_default()));
                if path.is_dir() {
                    folders.push(path);
                }
            }
        }
        kept.sort();
        kept
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

/// Links to the entries of `folder`, without those that `place` has.
fn link_entries(folder: &Path, place: &Path) {
    let folder = folder
        .canonicalize()
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let entries = std::fs::read_dir(&folder).expect("a folder can be read");
    for entry in entries.flatten() {
        let link = place.join(entry.file_name());
        if !link.exists() {
            std::os::unix::fs::symlink(entry.path(), link).expect("a link");
        }
    }
}

/// The file of one of Gantry's programs: in `first` if it is given, else beside the running test
/// where a workspace has them, in the checkout that this crate was built from, and on `PATH`.
///
/// # Panics
/// With the places that were looked at and what to do.
pub fn find_program(name: &str, first: Option<&Path>) -> PathBuf {
    let mut places: Vec<PathBuf> = Vec::new();
    if let Some(first) = first {
        places.push(first.to_path_buf());
    } else {
        let test = std::env::current_exe().expect("path of the running test");
        places.extend(test.parent().and_then(Path::parent).map(Path::to_path_buf));
        places.push(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/release"));
        let path = std::env::var_os("PATH").unwrap_or_default();
        places.extend(std::env::split_paths(&path));
    }
    let found = places.iter().map(|place| place.join(name));
    found
        .into_iter()
        .find(|path| path.is_file())
        .unwrap_or_else(|| {
            let places: Vec<_> = places.iter().map(|at| at.display().to_string()).collect();
            panic!(
                "there is no program {name:?} in {}; build Gantry with `cargo build --release --workspace`, put its programs on PATH, or give their folder",
                places.join(", ")
            )
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_have_folders_of_their_own() {
        let sandbox = Sandbox::new("folders");
        let line = "echo data $XDG_DATA_HOME cache $XDG_CACHE_HOME run $XDG_RUNTIME_DIR; test -w $XDG_RUNTIME_DIR";
        let shell = Path::new("/bin/sh");
        let ended = sandbox
            .spawn_program("sh", shell, &["-c", line], &[])
            .wait()
            .expect_code(0);
        let at = sandbox.dir().display();
        assert!(
            ended.says(&format!("data {at}/data cache {at}/cache run {at}/run")),
            "{:?}",
            ended.lines
        );
        // What a test gives counts.
        let given = [("XDG_DATA_HOME", "/elsewhere")];
        let ended = sandbox
            .spawn_program("sh", shell, &["-c", line], &given)
            .wait();
        assert!(ended.says("data /elsewhere cache"), "{:?}", ended.lines);
    }
}
