//! Whose folder iceoryx2's bookkeeping lies in. By default that is one folder for all users of the
//! machine, which belongs to whoever was first; everybody else gets one of their own.

use std::fs::Metadata;
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::sync::Once;

/// End of the names of files in shared memory that all nodes with one prefix share.
const SHARED_BY_NODES: &str = ".global_mgmt";
/// Where iceoryx2's segments lie.
pub(crate) const SHM: &str = "/dev/shm";

/// A user's own place.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct OwnPlace {
    /// Folder of the bookkeeping.
    pub root: PathBuf,
    /// Start of the names of files in shared memory.
    pub prefix: String,
}

/// The place that `user` has instead of `root` and `prefix`; `None` if these can be used. A place
/// that was used once is used as long as it is there, so that programs which start later meet those
/// that run.
///
/// # Errors
/// A sentence if there is no place that is this user's alone.
pub(crate) fn own_place(
    root: &Path,
    prefix: &str,
    shm: &Path,
    user: u32,
) -> Result<Option<OwnPlace>, String> {
    let name = root.file_name().unwrap_or_default().to_string_lossy();
    let own = OwnPlace {
        root: root.with_file_name(format!("{name}-{user}")),
        prefix: format!("{prefix}{user}_"),
    };
    let about = |path: &Path| std::fs::symlink_metadata(path).ok();
    if about(&own.root).is_some_and(|about| is_alone(&about, user)) {
        return Ok(Some(own));
    }
    let there = about(root);
    let other = other_user(shm, prefix, user);
    if there.as_ref().is_none_or(|there| is_alone(there, user)) && other.is_none() {
        return Ok(None);
    }
    let made = std::fs::DirBuilder::new().mode(0o700).create(&own.root);
    match made {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => {
            return Err(format!(
                "cannot make the folder {}: {error}",
                own.root.display()
            ));
        }
        _ => {}
    }
    if !about(&own.root).is_some_and(|about| is_alone(&about, user)) {
        return Err(format!(
            "neither {} nor {} belongs to user {user} alone; remove the second, or name another root-path in config/iceoryx2.toml",
            root.display(),
            own.root.display()
        ));
    }
    static SAID: Once = Once::new();
    SAID.call_once(|| {
        let of = there.map(|there| there.uid()).or(other).unwrap_or(user);
        tracing::info!(
            "{} or what lies in {} with it belongs to user {of}, so the shared-memory bus of user {user} is in {}",
            root.display(),
            shm.display(),
            own.root.display()
        );
    });
    Ok(Some(own))
}

/// Whether this is a folder that `user` owns and nobody else can write to.
fn is_alone(about: &Metadata, user: u32) -> bool {
    about.is_dir() && about.uid() == user && about.mode() & 0o022 == 0
}

/// Another user whose nodes share the file that all nodes with this prefix share, for example in
/// another container.
fn other_user(shm: &Path, prefix: &str, user: u32) -> Option<u32> {
    let entries = std::fs::read_dir(shm).ok()?;
    entries.flatten().find_map(|entry| {
        let name = entry.file_name();
        let name = name.to_str()?;
        let rest = name.strip_prefix(prefix)?.strip_suffix(SHARED_BY_NODES)?;
        // Behind a user's own prefix there is a number and one more underscore.
        let is_own_places = rest
            .split_once('_')
            .is_some_and(|(number, rest)| number.parse::<u32>().is_ok() && rest.contains('_'));
        let owner = entry.metadata().ok()?.uid();
        (owner != user && !is_own_places).then_some(owner)
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, chown, symlink};

    use super::*;

    struct Machine {
        folder: tempfile::TempDir,
        user: u32,
    }

    impl Machine {
        fn new() -> Machine {
            let folder = tempfile::tempdir().unwrap();
            std::fs::create_dir(folder.path().join("shm")).unwrap();
            let user = nix::unistd::geteuid().as_raw();
            Machine { folder, user }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.folder.path().join(name)
        }

        fn place(&self, user: u32) -> Result<Option<OwnPlace>, String> {
            own_place(&self.path("iceoryx2"), "iox2_", &self.path("shm"), user)
        }

        fn own(&self) -> Result<Option<OwnPlace>, String> {
            Ok(Some(OwnPlace {
                root: self.path(&format!("iceoryx2-{}", self.user)),
                prefix: format!("iox2_{}_", self.user),
            }))
        }
    }

    #[test]
    fn a_folder_that_is_ours_alone_is_used_and_one_that_is_not_is_left() {
        let machine = Machine::new();
        let root = machine.path("iceoryx2");
        assert_eq!(machine.place(machine.user), Ok(None), "it can be made");
        std::fs::create_dir(&root).unwrap();
        let mode = |mode| {
            std::fs::set_permissions(&root, std::fs::Permissions::from_mode(mode)).unwrap();
        };
        mode(0o750);
        assert_eq!(machine.place(machine.user), Ok(None));
        mode(0o777);
        assert_eq!(machine.place(machine.user), machine.own());
        mode(0o750);
        assert_eq!(machine.place(machine.user), machine.own(), "programs meet");
        std::fs::remove_dir(machine.path(&format!("iceoryx2-{}", machine.user))).unwrap();
        std::fs::remove_dir(&root).unwrap();
        symlink("/", &root).unwrap();
        assert_eq!(
            machine.place(machine.user),
            machine.own(),
            "a link is nobody's"
        );
    }

    #[test]
    fn another_users_folder_is_left_and_one_in_our_name_is_refused() {
        let machine = Machine::new();
        std::fs::create_dir(machine.path("iceoryx2")).unwrap();
        // To a user that is not ours both belong to somebody else.
        let other = machine.user + 1;
        std::fs::create_dir(machine.path(&format!("iceoryx2-{other}"))).unwrap();
        let error = machine.place(other).unwrap_err();
        assert!(
            error.contains("belongs to user") && error.contains("root-path"),
            "{error}"
        );
    }

    #[test]
    fn another_users_nodes_in_the_same_shared_memory_are_seen() {
        let machine = Machine::new();
        let shared = machine.path("shm/iox2_9204dd_node.0_10_0.global_mgmt");
        std::fs::write(&shared, b"").unwrap();
        std::fs::write(
            machine.path("shm/iox2_7_9204dd_node.0_10_0.global_mgmt"),
            b"",
        )
        .unwrap();
        assert_eq!(machine.place(machine.user), Ok(None), "it is ours");
        if chown(&shared, Some(machine.user + 1), None).is_err() {
            return; // Only root can give files away.
        }
        assert_eq!(machine.place(machine.user), machine.own());
    }
}
