//! What a process keeps: memory, descriptors and threads, read from `/proc`.

/// What one process keeps at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Memory that is the process's own and not shared, KiB.
    pub own_kib: u64,
    /// Open descriptors.
    pub descriptors: usize,
    /// Threads.
    pub threads: usize,
}

impl Kept {
    /// Reads it; `None` for a process that has ended.
    pub fn of(pid: u32) -> Option<Kept> {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let number = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key))?;
            line.split_whitespace().next()?.parse::<u64>().ok()
        };
        Some(Kept {
            own_kib: number("RssAnon:")?,
            descriptors: std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count(),
            threads: number("Threads:")? as usize,
        })
    }
}
