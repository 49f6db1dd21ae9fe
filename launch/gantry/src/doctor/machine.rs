//! Shared memory and the bus: how much room there is, whose it is, and who is on it.

use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use super::finding::Finding;
use super::install::as_root;
use crate::bus::Bus;

/// Where all frames live.
const SHM: &str = "/dev/shm";

/// `need`: the shared memory of the quickstart, bytes.
pub fn look(domain: &str, need: u64) -> Vec<Finding> {
    let mut findings = vec![shared_memory(schema_bus::shared_memory_free(), need)];
    findings.extend(owner(Path::new(SHM)));
    findings.extend(bus(domain));
    findings
}

fn shared_memory(free: Option<u64>, need: u64) -> Finding {
    const WHAT: &str = "shared memory";
    let Some(free) = free else {
        return Finding::fail(
            WHAT,
            "/dev/shm cannot be looked at",
            as_root("mount -t tmpfs tmpfs /dev/shm"),
        );
    };
    let (free_mib, need_mib) = (free >> 20, need.div_ceil(1 << 20));
    let text = format!("/dev/shm has {free_mib} MiB free, the quickstart needs {need_mib} MiB");
    if free >= need {
        return Finding::ok(WHAT, text);
    }
    let size = need.div_ceil(1 << 30) + 1;
    let fix = format!(
        "in Docker --shm-size={size}g, else {}",
        as_root(&format!("mount -o remount,size={size}G {SHM}"))
    );
    // A warning only, because smaller rigs still run.
    if free_mib < 32 {
        Finding::fail(WHAT, text, fix)
    } else {
        Finding::warn(WHAT, text, fix)
    }
}

/// Whether this user may make files there, and whether the kernel keeps them in memory.
fn owner(folder: &Path) -> Option<Finding> {
    const WHAT: &str = "its owner";
    let about = folder.metadata().ok()?;
    let (user, mode) = (about.uid(), about.mode() & 0o7777);
    let text = format!("user {user}, mode {mode:o}");
    let may_write = nix::unistd::access(folder, nix::unistd::AccessFlags::W_OK).is_ok();
    if !may_write {
        let fix = as_root(&format!("chmod 1777 {}", folder.display()));
        return Some(Finding::fail(
            WHAT,
            format!("{text}: this user may not make files there"),
            fix,
        ));
    }
    let kind = nix::sys::statfs::statfs(folder).ok()?.filesystem_type();
    if kind != nix::sys::statfs::TMPFS_MAGIC {
        return Some(Finding::warn(
            WHAT,
            format!("{text}: it lies on a disk, so frames are written to it"),
            as_root("mount -t tmpfs -o mode=1777 tmpfs /dev/shm"),
        ));
    }
    Some(Finding::ok(WHAT, text))
}

fn bus(domain: &str) -> Vec<Finding> {
    const WHAT: &str = "bus";
    let bus = match Bus::open(domain) {
        Ok(bus) => bus,
        Err(error) => {
            return vec![Finding::fail(
                WHAT,
                format!("{error:#}"),
                "`ls -ld /dev/shm /tmp/iceoryx2* $XDG_RUNTIME_DIR/iceoryx2*; df /dev/shm /tmp` shows whose they are and their free space",
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

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;
    use crate::up::quickstart_bytes;

    #[test]
    fn a_folder_on_a_disk_is_slow_and_one_without_rights_is_useless() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir_in(env!("CARGO_MANIFEST_DIR")).unwrap();
        let kind = nix::sys::statfs::statfs(folder.path()).unwrap();
        // The repository may lie in memory, too.
        if kind.filesystem_type() != nix::sys::statfs::TMPFS_MAGIC {
            let finding = owner(folder.path()).unwrap();
            assert_eq!(finding.grade, Grade::Warn, "{finding:?}");
            assert!(finding.fix.contains("mount -t tmpfs"), "{finding:?}");
        }
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o555)).unwrap();
        // Root may write anywhere.
        if !nix::unistd::geteuid().is_root() {
            let finding = owner(folder.path()).unwrap();
            assert_eq!(finding.grade, Grade::Fail, "{finding:?}");
        }
        assert!(owner(Path::new("/no/such/folder")).is_none());
    }

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
