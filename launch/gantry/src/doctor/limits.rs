//! Limits that the kernel, the shell or a container sets: open files, file sizes, processes,
//! mappings, watches, memory.

use std::path::Path;

use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};

use super::finding::Finding;
use super::install::as_root;

/// File descriptors that the daemon may need for a dozen sensors with eight readers each.
const OPEN_FILES: u64 = 4096;
/// Threads of all programs of a quickstart together, with a margin for the viewer's.
const THREADS: u64 = 1024;
/// Every reader of a topic maps its segment; the kernel's own default is 65 530.
const MAPPINGS: u64 = 16_384;
/// Files and folders that the viewer's program watches at a time.
const WATCHES: u64 = 1024;
/// Address space of the daemon with a software renderer, bytes: segments and heaps are mapped at
/// several times the size that is used.
const ADDRESS_SPACE: u64 = 16 << 30;
/// Memory besides shared memory that the quickstart's programs take, bytes.
const PROGRAMS_BYTES: u64 = 1 << 30;

/// All of them. `shared_need` is the shared memory of the quickstart, bytes.
pub fn look(shared_need: u64) -> Vec<Finding> {
    let hard = |resource| getrlimit(resource).map(|(_, hard)| hard).ok();
    let soft = |resource| getrlimit(resource).map(|(soft, _)| soft).ok();
    let pids = cgroup("pids.max");
    [
        Some(open_files(hard(Resource::RLIMIT_NOFILE))),
        file_size(soft(Resource::RLIMIT_FSIZE)),
        address_space(soft(Resource::RLIMIT_AS)),
        Some(threads(soft(Resource::RLIMIT_NPROC), pids)),
        Some(mappings(number("/proc/sys/vm/max_map_count"))),
        watches(
            number("/proc/sys/fs/inotify/max_user_instances"),
            number("/proc/sys/fs/inotify/max_user_watches"),
            inotify_in_use(),
        ),
        Some(memory(
            available(&read("/proc/meminfo")),
            cgroup("memory.max"),
            shared_need + PROGRAMS_BYTES,
        )),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn read(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

fn number(path: &str) -> Option<u64> {
    read(path).trim().parse().ok()
}

/// A limit of the container or service that this process is in; `None` where there is none.
fn cgroup(file: &str) -> Option<u64> {
    let own = read("/proc/self/cgroup");
    let path = own.lines().find_map(|line| line.strip_prefix("0::"))?;
    let folder = Path::new("/sys/fs/cgroup").join(path.trim_start_matches('/'));
    read(folder.join(file)).trim().parse().ok()
}

fn open_files(hard: Option<u64>) -> Finding {
    const WHAT: &str = "open files";
    match hard {
        Some(hard) if hard >= OPEN_FILES => Finding::ok(WHAT, format!("a process may have {hard}")),
        Some(hard) => Finding::warn(
            WHAT,
            format!("a process may have {hard}; many sensors need {OPEN_FILES}"),
            format!(
                "{}, or `* hard nofile {OPEN_FILES}` in /etc/security/limits.conf and log in again",
                as_root(&format!(
                    "prlimit --pid $$ --nofile={OPEN_FILES}:{OPEN_FILES}"
                ))
            ),
        ),
        None => Finding::warn(WHAT, "the limit cannot be read", ""),
    }
}

fn file_size(soft: Option<u64>) -> Option<Finding> {
    let soft = soft.filter(|soft| *soft != RLIM_INFINITY)?;
    Some(Finding::warn(
        "file size",
        format!(
            "a file may have {} MiB; recordings and shared memory stop there",
            soft >> 20
        ),
        "ulimit -f unlimited",
    ))
}

fn address_space(soft: Option<u64>) -> Option<Finding> {
    let soft = soft.filter(|soft| *soft < ADDRESS_SPACE)?;
    Some(Finding::warn(
        "address space",
        format!(
            "a process may have {} MiB; shared memory is mapped as a whole and may be refused",
            soft >> 20
        ),
        "ulimit -v unlimited",
    ))
}

fn threads(of_user: Option<u64>, of_container: Option<u64>) -> Finding {
    const WHAT: &str = "threads";
    let limit = [of_user, of_container].into_iter().flatten().min();
    match limit {
        Some(limit) if limit < THREADS => {
            let fix = if of_container == Some(limit) {
                format!("in a container: --pids-limit {THREADS} or more")
            } else {
                format!("ulimit -u {THREADS}, or more")
            };
            let text =
                format!("{limit} are allowed in all; with viewer and gateway it needs {THREADS}");
            Finding::warn(WHAT, text, fix)
        }
        Some(limit) if limit != RLIM_INFINITY => {
            Finding::ok(WHAT, format!("{limit} are allowed in all"))
        }
        _ => Finding::ok(WHAT, "no limit"),
    }
}

fn mappings(limit: Option<u64>) -> Finding {
    const WHAT: &str = "mappings";
    match limit {
        Some(limit) if limit >= MAPPINGS => {
            Finding::ok(WHAT, format!("a process may have {limit}"))
        }
        Some(limit) => Finding::warn(
            WHAT,
            format!("a process may have {limit}; many topics with many readers need {MAPPINGS}"),
            as_root("sysctl -w vm.max_map_count=65530"),
        ),
        None => Finding::warn(WHAT, "the limit cannot be read", ""),
    }
}

/// The viewer watches files. `in_use`: instances that this user has already.
fn watches(instances: Option<u64>, watches: Option<u64>, in_use: u64) -> Option<Finding> {
    const WHAT: &str = "file watches";
    let (instances, watches) = (instances?, watches?);
    let text = format!("{in_use} of {instances} watchers are in use, with up to {watches} files");
    if in_use + 2 > instances {
        let fix = as_root("sysctl -w fs.inotify.max_user_instances=512");
        return Some(Finding::warn(WHAT, text, fix));
    }
    if watches < WATCHES {
        let fix = as_root("sysctl -w fs.inotify.max_user_watches=65536");
        return Some(Finding::warn(WHAT, text, fix));
    }
    Some(Finding::ok(WHAT, text))
}

/// Watchers of files that processes of this user hold, as far as /proc shows them.
fn inotify_in_use() -> u64 {
    let own = nix::unistd::geteuid().as_raw();
    let is_own = |path: &Path| {
        use std::os::unix::fs::MetadataExt as _;
        path.metadata().is_ok_and(|about| about.uid() == own)
    };
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .map(|process| process.path())
        .filter(|path| is_own(path))
        .flat_map(|path| std::fs::read_dir(path.join("fd")).into_iter().flatten())
        .flatten()
        .filter(|file| {
            std::fs::read_link(file.path())
                .is_ok_and(|link| link.to_string_lossy().contains("inotify"))
        })
        .count() as u64
}

/// Memory that can be had without swapping, bytes.
fn available(meminfo: &str) -> Option<u64> {
    let line = meminfo
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}

/// Shared memory counts as memory, and in a container as the container's.
fn memory(available: Option<u64>, of_container: Option<u64>, need: u64) -> Finding {
    const WHAT: &str = "memory";
    let need_mib = need >> 20;
    if let Some(limit) = of_container.filter(|limit| *limit < need) {
        return Finding::warn(
            WHAT,
            format!(
                "this container may have {} MiB, shared memory included; the quickstart takes {need_mib} MiB",
                limit >> 20
            ),
            format!("in Docker --memory={}g", need.div_ceil(1 << 30) + 1),
        );
    }
    match available {
        Some(free) if free >= need => Finding::ok(
            WHAT,
            format!(
                "{} MiB available, the quickstart takes {need_mib} MiB",
                free >> 20
            ),
        ),
        Some(free) => Finding::warn(
            WHAT,
            format!(
                "{} MiB available, the quickstart takes {need_mib} MiB",
                free >> 20
            ),
            "end other programs (`ps -eo rss,args --sort -rss | head` shows the largest), or take launch/minimal.toml",
        ),
        None => Finding::warn(WHAT, "cannot be read", ""),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn low_limits_are_warnings_with_the_command_that_raises_them() {
        let wrong = [
            (open_files(Some(1024)), "nofile=4096"),
            (file_size(Some(100 << 20)).unwrap(), "ulimit -f unlimited"),
            (address_space(Some(4 << 30)).unwrap(), "ulimit -v unlimited"),
            (threads(Some(100), None), "ulimit -u 1024"),
            (threads(Some(50_000), Some(100)), "--pids-limit 1024"),
            (mappings(Some(1000)), "vm.max_map_count"),
            (
                watches(Some(128), Some(65_536), 127).unwrap(),
                "max_user_instances",
            ),
            (
                watches(Some(128), Some(100), 3).unwrap(),
                "max_user_watches",
            ),
            (memory(Some(8 << 30), Some(1 << 30), 2 << 30), "--memory=3g"),
            (memory(Some(1 << 30), None, 2 << 30), "launch/minimal.toml"),
        ];
        for (finding, fix) in wrong {
            assert_eq!(finding.grade, Grade::Warn, "{finding:?}");
            assert!(finding.fix.contains(fix), "{finding:?}");
        }
    }

    #[test]
    fn usual_limits_are_fine() {
        assert_eq!(open_files(Some(4096)).grade, Grade::Ok);
        assert!(file_size(Some(RLIM_INFINITY)).is_none());
        assert!(address_space(Some(RLIM_INFINITY)).is_none());
        assert_eq!(threads(Some(RLIM_INFINITY), None).grade, Grade::Ok);
        assert_eq!(mappings(Some(65_530)).grade, Grade::Ok);
        assert_eq!(
            watches(Some(128), Some(65_536), 3).unwrap().grade,
            Grade::Ok
        );
        assert_eq!(memory(Some(8 << 30), None, 2 << 30).grade, Grade::Ok);
    }

    #[test]
    fn meminfo_is_in_kibibytes() {
        assert_eq!(
            available("MemTotal: 9 kB\nMemAvailable:   2048 kB\n"),
            Some(2 << 20)
        );
        assert_eq!(available("MemTotal: 9 kB\n"), None);
    }
}
