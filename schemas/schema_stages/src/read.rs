//! What a process has posted about its stages, and what the kernel knows of its threads.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use crate::block::{Block, MAX_BYTES, NAME, decode};
use crate::span::Sums;

/// Threads that a graphics driver has made in a process run no code of ours, so no span can see
/// them: the beginning of their names, and the stage that they are.
const DRIVER_THREADS: [(&str, &str); 1] = [("llvmpipe", "render")];
/// The stage of everything that is in no other.
pub const REST: &str = "rest";

/// The stages of one process at one time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Look {
    /// Tick that it works on; `None` of a process that posts none.
    pub tick: Option<u64>,
    /// Processor time of all its threads, those that have ended included, nanoseconds.
    pub cpu_nanos: u64,
    /// Sums of its stages, by name.
    pub stages: BTreeMap<String, Sums>,
}

/// One process whose stages are read.
#[derive(Debug)]
pub struct Process {
    pid: u32,
    folder: PathBuf,
    posted: Option<File>,
}

impl Process {
    /// The process of this id; whether it is there shows when it is looked at.
    pub fn new(pid: u32) -> Process {
        Process {
            pid,
            folder: Path::new("/proc").join(pid.to_string()),
            posted: None,
        }
    }

    /// Its id.
    pub fn pid(&self) -> u32 {
        self.pid
    }

    /// Looks at it now; `None` if it has ended. A process that posts nothing, or is another user's,
    /// has no stages but the rendering of a software renderer.
    pub fn look(&mut self) -> Option<Look> {
        let cpu_nanos = cpu_nanos(&self.folder)?;
        if self.posted.is_none() {
            self.posted = find_posted(&self.folder);
        }
        let block = self
            .posted
            .as_ref()
            .and_then(read_block)
            .unwrap_or_default();
        let mut stages: BTreeMap<String, Sums> = block.rows.into_iter().collect();
        for (name, sums) in driver_threads(&self.folder) {
            let of_stage = stages.entry(name.to_owned()).or_default();
            // The block may hold any number.
            of_stage.cpu_nanos = of_stage.cpu_nanos.saturating_add(sums.cpu_nanos);
            of_stage.n_spans = of_stage.n_spans.max(sums.n_spans);
        }
        Some(Look {
            tick: (block.tick > 0).then_some(block.tick),
            cpu_nanos,
            stages,
        })
    }
}

impl Look {
    /// What happened since an earlier look: sums of that time, and [`REST`] for what no stage took.
    pub fn since(&self, before: &Look) -> Look {
        let mut stages: BTreeMap<String, Sums> = BTreeMap::new();
        for (name, now) in &self.stages {
            let then = before.stages.get(name).copied().unwrap_or_default();
            let took = Sums {
                cpu_nanos: now.cpu_nanos.saturating_sub(then.cpu_nanos),
                wall_nanos: now.wall_nanos.saturating_sub(then.wall_nanos),
                n_spans: now.n_spans.saturating_sub(then.n_spans),
            };
            stages.insert(name.clone(), took);
        }
        let cpu_nanos = self.cpu_nanos.saturating_sub(before.cpu_nanos);
        let cpu_of_stages = stages.values().map(|sums| sums.cpu_nanos);
        let known = cpu_of_stages.fold(0, u64::saturating_add);
        let rest = Sums {
            cpu_nanos: cpu_nanos.saturating_sub(known),
            ..Sums::default()
        };
        stages.insert(REST.to_owned(), rest);
        let n_ticks = |tick: u64| tick.saturating_sub(before.tick.unwrap_or(0));
        Look {
            tick: self.tick.map(n_ticks),
            cpu_nanos,
            stages,
        }
    }
}

/// The file that a process posts in, found among its descriptors.
fn find_posted(folder: &Path) -> Option<File> {
    let wanted = format!("/memfd:{NAME}");
    let entries = std::fs::read_dir(folder.join("fd")).ok()?.flatten();
    let is_it = |path: &PathBuf| {
        let target = std::fs::read_link(path).unwrap_or_default();
        target.to_string_lossy().starts_with(&wanted)
    };
    let path = entries.map(|entry| entry.path()).find(is_it)?;
    File::open(path).ok()
}

/// Reads a block; the second time if the first one was half-written.
fn read_block(file: &File) -> Option<Block> {
    let mut bytes = vec![0; MAX_BYTES];
    (0..3).find_map(|_| {
        let n_bytes = file.read_at(&mut bytes, 0).ok()?;
        decode(&bytes[..n_bytes])
    })
}

/// Processor time of a process, nanoseconds, from `/proc/PID/stat`, which counts in hundredths of a
/// second; `None` if it is gone or a zombie.
fn cpu_nanos(folder: &Path) -> Option<u64> {
    const NANOS_A_CENTISECOND: u64 = 10_000_000;
    let stat = std::fs::read_to_string(folder.join("stat")).ok()?;
    // The name in parentheses may hold anything.
    let (_, after) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = after.split_whitespace().collect();
    let number = |i: usize| fields.get(i)?.parse::<u64>().ok();
    (fields.first() != Some(&"Z")).then_some(())?;
    Some((number(11)? + number(12)?) * NANOS_A_CENTISECOND)
}

/// Processor time of the threads of graphics drivers, by their stage.
fn driver_threads(folder: &Path) -> Vec<(&'static str, Sums)> {
    let tasks = std::fs::read_dir(folder.join("task")).into_iter().flatten();
    let of_task = |task: PathBuf| {
        let name = std::fs::read_to_string(task.join("comm")).ok()?;
        let is_its = |(start, _): &&(&str, &str)| name.starts_with(start);
        let (_, stage) = DRIVER_THREADS.iter().find(is_its)?;
        let times = std::fs::read_to_string(task.join("schedstat")).ok()?;
        let sums = Sums {
            cpu_nanos: times.split_whitespace().next()?.parse().ok()?,
            ..Sums::default()
        };
        Some((*stage, sums))
    };
    tasks
        .flatten()
        .filter_map(|task| of_task(task.path()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Stage, post};

    static SHOWN: Stage = Stage::new("shown");

    #[test]
    fn a_process_sees_what_it_posted_itself() {
        SHOWN.add(5_000_000, 6_000_000);
        // Another test may have posted less than 100 ms ago.
        std::thread::sleep(std::time::Duration::from_millis(110));
        post(17);
        let mut own = Process::new(std::process::id());
        let look = own.look().expect("this process lives");
        assert_eq!(look.tick, Some(17));
        assert_eq!(look.stages["shown"].wall_nanos, 6_000_000);
    }

    #[test]
    fn a_process_that_is_not_there_has_no_stages() {
        assert_eq!(Process::new(u32::MAX).look(), None);
    }

    #[test]
    fn what_no_stage_took_is_the_rest() {
        let look = |tick, cpu_nanos, physics| Look {
            tick: Some(tick),
            cpu_nanos,
            stages: [(
                "physics".to_owned(),
                Sums {
                    cpu_nanos: physics,
                    wall_nanos: 0,
                    n_spans: 1,
                },
            )]
            .into(),
        };
        let took = look(30, 1000, 400).since(&look(10, 100, 50));
        assert_eq!((took.tick, took.cpu_nanos), (Some(20), 900));
        assert_eq!(took.stages["physics"].cpu_nanos, 350);
        assert_eq!(took.stages[REST].cpu_nanos, 550);
        let mut wild = look(30, 1000, u64::MAX);
        wild.stages
            .insert("tyres".to_owned(), wild.stages["physics"]);
        let took = wild.since(&look(10, 100, 50));
        assert_eq!(took.stages[REST].cpu_nanos, 0, "whatever a process posts");
    }
}
