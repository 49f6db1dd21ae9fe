//! What processes of these tests run with: Python, its package, and namespaces.

use std::path::PathBuf;

use parking_lot::Mutex;
use test_kit::sandbox::{binary_path, repository};

/// A program of the repository's own Python environment.
///
/// # Panics
/// With the command that makes the environment, if it is not there.
pub fn venv_program(name: &str) -> PathBuf {
    let program = repository().join(".venv/bin").join(name);
    assert!(
        program.exists(),
        "{} is missing: run ./gantry test, which makes the Python environment .venv",
        program.display()
    );
    program
}

/// The folder of the Python package `gantry`, for PYTHONPATH. Its native module is a link to the one
/// that was built, also in a tree that `./gantry` has not set up.
///
/// # Panics
/// With the command to run if the module was not built.
pub fn python_package() -> PathBuf {
    let folder = repository().join("consumers/consumer_python/python");
    let (built, link) = (
        binary_path("libconsumer_python.so"),
        folder.join("gantry/_native.abi3.so"),
    );
    // Tests of one program are threads of one process.
    static LINKING: Mutex<()> = Mutex::new(());
    let _linking = LINKING.lock();
    if std::fs::read_link(&link).ok().as_deref() != Some(built.as_path()) {
        // Renamed into place, because tests run beside one another.
        let own = folder.join(format!("gantry/_native.so.{}", std::process::id()));
        let _ = std::fs::remove_file(&own);
        std::os::unix::fs::symlink(&built, &own)
            .and_then(|()| std::fs::rename(&own, &link))
            .expect("the package's folder can be written");
    }
    folder
}

/// Arguments of `unshare` for a mount namespace of one's own. Who is not root may mount in a user
/// namespace.
pub fn mount_namespace() -> &'static [&'static str] {
    match nix::unistd::geteuid().is_root() {
        true => &["--mount"],
        false => &["--user", "--map-root-user", "--mount"],
    }
}

/// Says on the terminal that a test did not test, and why: what tests print is shown only when they
/// fail.
pub fn not_tested(what: &str, why: &str) {
    use std::io::Write as _;
    // A test whose terminal is gone has nobody to tell.
    let _ = writeln!(std::io::stderr(), "NOT TESTED: {what}, because {why}");
}
