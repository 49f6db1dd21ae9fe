//! What processes use: processor time and memory of their groups, from `/proc`.

use std::collections::BTreeMap;
use std::fs;
use std::time::{Duration, Instant};

use schema_bus::mono_now;

use crate::capture::Usage;

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(500);

/// Looks at groups of processes from time to time.
#[derive(Debug)]
pub struct Meter {
    next: Instant,
    ticks_per_sec: f64,
    /// Time of processes of a group that have ended, seconds, and what they had at the last look.
    before: BTreeMap<String, Group>,
}

#[derive(Debug, Default)]
struct Group {
    ended_secs: f64,
    living_secs: BTreeMap<u32, f64>,
}

impl Meter {
    /// No look yet.
    pub fn new() -> Meter {
        let hz = nix::unistd::sysconf(nix::unistd::SysconfVar::CLK_TCK);
        Meter {
            next: Instant::now(),
            ticks_per_sec: hz.ok().flatten().unwrap_or(100) as f64,
            before: BTreeMap::new(),
        }
    }

    /// Looks, if it is time to or `now` says so. Groups are those of these processes, by name; a name
    /// that is gone was ended.
    pub fn look(&mut self, leaders: &BTreeMap<String, u32>, now: bool, into: &mut Vec<Usage>) {
        if Instant::now() < self.next && !now {
            return;
        }
        self.next = Instant::now() + EVERY;
        let all = processes();
        for (name, leader) in leaders {
            let members = all.iter().filter(|process| process.group == *leader);
            let group = self.before.entry(name.clone()).or_default();
            let mut living = BTreeMap::new();
            let mut own_bytes = 0;
            for member in members {
                living.insert(member.pid, member.ticks as f64 / self.ticks_per_sec);
                own_bytes += own_memory(member.pid);
            }
            for (pid, secs) in &group.living_secs {
                if !living.contains_key(pid) {
                    group.ended_secs += secs;
                }
            }
            group.living_secs = living;
            into.push(Usage {
                process: name.clone(),
                mono_nanos: mono_now().0,
                cpu_secs: group.ended_secs + group.living_secs.values().sum::<f64>(),
                own_bytes,
            });
        }
    }
}

impl Default for Meter {
    fn default() -> Self {
        Meter::new()
    }
}

/// A process.
#[derive(Debug)]
struct Process {
    pid: u32,
    group: u32,
    /// Processor time of its own, in the kernel's ticks.
    ticks: u64,
}

fn processes() -> Vec<Process> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter_map(|entry| {
            let pid = entry.file_name().to_str()?.parse().ok()?;
            process(pid, &fs::read_to_string(entry.path().join("stat")).ok()?)
        })
        .collect()
}

/// Reads `/proc/PID/stat`.
fn process(pid: u32, stat: &str) -> Option<Process> {
    // The name in brackets may hold anything, so the fields are counted from its end.
    let fields: Vec<&str> = stat.rsplit_once(") ")?.1.split(' ').collect();
    let number = |at: usize| fields.get(at)?.parse::<u64>().ok();
    Some(Process {
        pid,
        group: number(2)? as u32,
        ticks: number(11)? + number(12)?,
    })
}

/// `RssAnon` of a process, bytes.
fn own_memory(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("RssAnon:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_group_and_the_time_stand_behind_any_name() {
        let stat = "7 (a) b (c) S 1 42 42 0 -1 4194560 100 0 0 0 250 50 9 9 20 0 1 0 123";
        let process = process(7, stat).unwrap();
        assert_eq!((process.group, process.ticks), (42, 300));
    }

    #[test]
    fn this_process_uses_time_and_memory() {
        let own = nix::unistd::getpgrp().as_raw().cast_unsigned();
        let leaders = BTreeMap::from([("me".to_owned(), own)]);
        let (mut meter, mut usage) = (Meter::new(), Vec::new());
        meter.look(&leaders, true, &mut usage);
        let start = Instant::now();
        let mut sum = 0.0_f64;
        while start.elapsed() < Duration::from_millis(100) {
            sum += f64::sin(sum);
        }
        meter.look(&leaders, true, &mut usage);
        assert!(usage[1].cpu_secs > usage[0].cpu_secs && usage[1].own_bytes > 100_000);
    }
}
