//! What a figure was measured on: a number without its machine is no figure.
//! Benchmarks write it into their JSON, from which `docs/benchmarks` is built.

use serde::Serialize;

/// The machine and the build.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// CPU model.
    pub cpu: String,
    /// Cores this process may use.
    pub n_cores: usize,
    /// Kernel release.
    pub kernel: String,
    /// Frequency governor; "none" on most virtual machines.
    pub governor: String,
    /// Load average of the last minute when the run began: neighbours make tails.
    pub load_1min: String,
    /// Commit that this was packaged from, else that of the working tree it ran in; "unknown" elsewhere.
    pub commit: String,
    /// Version of this binary.
    pub version: &'static str,
    /// Command line.
    pub command: String,
}

impl Machine {
    /// Reads everything now.
    pub fn read() -> Self {
        Machine {
            cpu: cpu_model(&read("/proc/cpuinfo")),
            n_cores: std::thread::available_parallelism().map_or(1, |n| n.get()),
            kernel: or_unknown(read("/proc/sys/kernel/osrelease")),
            governor: Some(read(
                "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor",
            ))
            .filter(|g| !g.is_empty())
            .unwrap_or("none".into()),
            load_1min: read("/proc/loadavg")
                .split(' ')
                .next()
                .unwrap_or_default()
                .to_owned(),
            commit: commit(),
            version: env!("CARGO_PKG_VERSION"),
            command: std::env::args()
                .skip(1)
                .fold(program(), |all, word| all + " " + &word),
        }
    }

    /// Two lines above a table.
    pub fn heading(&self) -> String {
        format!(
            "{}, {} cores, kernel {}, governor {}, load {}\ncommit {}, version {}: {}\n",
            self.cpu,
            self.n_cores,
            self.kernel,
            self.governor,
            self.load_1min,
            self.commit,
            self.version,
            self.command
        )
    }
}

/// A small text file without its line end; empty if it cannot be read.
fn read(path: &str) -> String {
    std::fs::read_to_string(path)
        .map(|text| text.trim().to_owned())
        .unwrap_or_default()
}

/// File name of this program.
fn program() -> String {
    let path = std::env::args().next().unwrap_or_default();
    let name = std::path::Path::new(&path).file_name();
    name.unwrap_or_default().to_string_lossy().into_owned()
}

fn or_unknown(text: String) -> String {
    if text.is_empty() {
        "unknown".into()
    } else {
        text
    }
}

fn cpu_model(cpuinfo: &str) -> String {
    let line = cpuinfo.lines().find(|line| line.starts_with("model name"));
    or_unknown(
        line.and_then(|line| line.split_once(": "))
            .map(|(_, model)| model.to_owned())
            .unwrap_or_default(),
    )
}

fn commit() -> String {
    if let Some(commit) = crate::build_info::COMMIT {
        return commit.to_owned();
    }
    let git = std::process::Command::new("git")
        .args(["describe", "--always", "--dirty", "--abbrev=10"])
        .output();
    let text = git
        .ok()
        .filter(|out| out.status.success())
        .map(|out| String::from_utf8_lossy(&out.stdout).trim().to_owned());
    or_unknown(text.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_is_found_in_cpuinfo() {
        assert_eq!(
            cpu_model("processor\t: 0\nmodel name\t: Some CPU @ 2 GHz\nflags : x"),
            "Some CPU @ 2 GHz"
        );
        assert_eq!(cpu_model("processor : 0"), "unknown");
    }
}
