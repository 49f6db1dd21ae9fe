//! What a set will cost, before anything starts: disk, memory, and how many scenarios fit beside one
//! another.

use std::path::Path;

use launch_cli::wrong_usage;
use launch_spec::Launch;
use schema_bus::{FrameTopic, shared_memory_free, shared_memory_needed};
use schema_frames::Modality;

use crate::matrix::Scenario;

/// Memory of a simulator with its map, its driver and its recorder besides shared memory, as
/// measured on towns with a software renderer.
const PROCESS_BYTES: u64 = 1500 << 20;
/// Share of raw images that their lossless recording takes at most, measured on rainy towns.
const RECORDED_SHARE: f64 = 0.6;
/// Memory that is left to everything else.
const SPARE_BYTES: u64 = 1 << 30;

/// What scenarios need.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Estimate {
    /// Bytes of all recordings and exports together, at most.
    pub disk_bytes: u64,
    /// Memory of the largest scenario, shared memory included.
    pub memory_bytes: u64,
    /// Shared memory of the largest scenario.
    pub shared_bytes: u64,
}

/// What the machine has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Free bytes where the set goes.
    pub disk_bytes: u64,
    /// Free memory.
    pub memory_bytes: u64,
    /// Free bytes of `/dev/shm`.
    pub shared_bytes: u64,
    /// Processor cores.
    pub cores: usize,
}

impl Estimate {
    /// Adds a scenario; `n_exports` formats are written of it.
    pub fn add(&mut self, scenario: &Scenario, launch: &Launch, n_exports: usize) {
        let ticks = scenario.frames as f64;
        let mut raw = 0.0;
        let mut segments = Vec::new();
        for sensor in launch.placed_sensors() {
            let rate_hz = sensor.spec.rate_hz().unwrap_or(scenario.tick_hz);
            let n_frames = ticks * (rate_hz / scenario.tick_hz).min(1.0);
            for modality in sensor.spec.modalities() {
                let most = sensor
                    .spec
                    .max_payload_bytes(modality, 1.0 / scenario.tick_hz);
                segments.push(FrameTopic::new(modality, most).segment_bytes(modality));
                raw += usual_bytes(modality, most) * n_frames;
            }
        }
        let shared = shared_memory_needed(segments);
        let disk = raw * RECORDED_SHARE * (1 + n_exports) as f64;
        self.disk_bytes = self.disk_bytes.saturating_add(disk as u64 + (8 << 20));
        self.shared_bytes = self.shared_bytes.max(shared);
        self.memory_bytes = self.memory_bytes.max(shared + PROCESS_BYTES);
    }

    /// How many scenarios run beside one another: as many as were asked for, or one for every two
    /// cores, as far as memory goes.
    pub fn jobs(&self, asked: Option<usize>, n_scenarios: usize, room: &Room) -> usize {
        let by_cores = room.cores.div_ceil(2);
        let by_memory = room.memory_bytes.saturating_sub(SPARE_BYTES) / self.memory_bytes.max(1);
        let by_shared = room.shared_bytes / self.shared_bytes.max(1);
        let most = by_memory.min(by_shared) as usize;
        asked
            .unwrap_or(by_cores.min(most))
            .clamp(1, n_scenarios.max(1))
    }

    /// Refuses what cannot fit.
    ///
    /// # Errors
    /// [`wrong_usage`]: what is short, how much there is, and what helps.
    pub fn check(&self, jobs: usize, room: &Room, out: &Path) -> anyhow::Result<()> {
        let jobs_bytes = |bytes: u64| bytes.saturating_mul(jobs as u64);
        let short = |what: String, need: u64, free: u64, help: &str| {
            Err(wrong_usage(format!(
                "{what} needs about {}, but {} is free; {help}, or go ahead with --anyway",
                size(need),
                size(free)
            )))
        };
        if self.disk_bytes > room.disk_bytes {
            let what = format!("this set in {}", out.display());
            let help = "give another --out, take fewer scenarios or frames, or smaller images";
            return short(what, self.disk_bytes, room.disk_bytes, help);
        }
        let need = jobs_bytes(self.shared_bytes);
        if need > room.shared_bytes {
            let what = format!("shared memory of {jobs} scenarios at a time in /dev/shm");
            return short(
                what,
                need,
                room.shared_bytes,
                "take fewer --jobs, or smaller sensors",
            );
        }
        let need = jobs_bytes(self.memory_bytes);
        if need > room.memory_bytes {
            let what = format!("memory of {jobs} scenarios at a time");
            return short(what, need, room.memory_bytes, "take fewer --jobs");
        }
        Ok(())
    }
}

/// Bytes of a frame as it usually is: lists are much shorter than they may be.
fn usual_bytes(modality: Modality, most: usize) -> f64 {
    let share = match modality {
        Modality::Dvs => 0.05,
        modality if modality.is_image() => 1.0,
        _ => 0.7,
    };
    most as f64 * share
}

impl Room {
    /// Looks at the machine; the disk is that of `folder` or of the nearest folder above that is
    /// there.
    pub fn look(folder: &Path) -> Room {
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let found = folder.ancestors().find(|folder| folder.exists());
        let disk = found.and_then(|folder| nix::sys::statvfs::statvfs(folder).ok());
        let meminfo = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
        Room {
            disk_bytes: disk.map_or(u64::MAX, |it| {
                it.blocks_available().saturating_mul(it.fragment_size())
            }),
            memory_bytes: available(&meminfo).unwrap_or(u64::MAX),
            shared_bytes: shared_memory_free().unwrap_or(u64::MAX),
            cores: std::thread::available_parallelism().map_or(1, |n| n.get()),
        }
    }
}

/// `MemAvailable` of `/proc/meminfo`, bytes.
fn available(meminfo: &str) -> Option<u64> {
    let line = meminfo
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Bytes in words.
pub fn size(bytes: u64) -> String {
    let (unit, name) = match bytes {
        1_000_000_000_000.. => (1e12, "TB"),
        1_000_000_000.. => (1e9, "GB"),
        _ => (1e6, "MB"),
    };
    format!("{:.1} {name}", bytes as f64 / unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Room = Room {
        disk_bytes: 10 << 30,
        memory_bytes: 9 << 30,
        shared_bytes: 2 << 30,
        cores: 16,
    };

    #[test]
    fn jobs_follow_from_cores_memory_and_what_there_is_to_do() {
        let small = Estimate {
            disk_bytes: 1,
            memory_bytes: 2 << 30,
            shared_bytes: 1 << 28,
        };
        assert_eq!(small.jobs(None, 100, &ROOM), 4, "memory");
        assert_eq!(small.jobs(None, 3, &ROOM), 3, "scenarios");
        assert_eq!(small.jobs(Some(7), 100, &ROOM), 7, "asked");
        let two_cores = Room { cores: 2, ..ROOM };
        assert_eq!(small.jobs(None, 100, &two_cores), 1);
    }

    #[test]
    fn what_does_not_fit_is_said_with_figures() {
        let large = Estimate {
            disk_bytes: 20 << 30,
            memory_bytes: 5 << 30,
            shared_bytes: 3 << 30,
        };
        let sentence = |estimate: Estimate, jobs| {
            let checked = estimate.check(jobs, &ROOM, Path::new("set"));
            checked.unwrap_err().to_string()
        };
        assert!(sentence(large, 1).contains("21.5 GB"));
        let disk = Estimate {
            disk_bytes: 1,
            ..large
        };
        assert!(sentence(disk, 1).contains("/dev/shm"));
        let shared = Estimate {
            shared_bytes: 1,
            ..disk
        };
        assert!(sentence(shared, 2).contains("--jobs"));
        assert!(shared.check(1, &ROOM, Path::new("set")).is_ok());
    }

    #[test]
    fn free_memory_is_read_in_bytes() {
        assert_eq!(
            available("MemFree: 1 kB\nMemAvailable:   2048 kB\n"),
            Some(2 << 20)
        );
        assert_eq!(available("MemFree: 1 kB"), None);
    }
}
