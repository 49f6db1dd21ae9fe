//! What lies where in a CARLA folder.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

/// The folder of the front's file, as in a CARLA release.
pub const PROGRAM_FOLDER: &str = "CarlaUE4/Binaries/Linux";
/// Name of the front's file, by which programs find CARLA's processes and kill them.
pub const PROGRAM: &str = "CarlaUE4-Linux-Shipping";
/// What servers are.
pub const LAUNCH_FILE: &str = "launch.toml";

/// The made folder of a front that was called by this path.
pub fn root_of(front: &Path) -> anyhow::Result<PathBuf> {
    let root = std::path::absolute(front)?
        .ancestors()
        .nth(4)
        .map(Path::to_owned)
        .filter(|root| root.join(LAUNCH_FILE).is_file());
    root.with_context(|| {
        format!(
            "there is no {LAUNCH_FILE} four folders above {}; start it by its whole path, or run `gantry carla-root DIR` again",
            front.display()
        )
    })
}
