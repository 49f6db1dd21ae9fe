//! What the time of processes goes into between two looks.

use std::collections::BTreeMap;
use std::time::Instant;

use schema_stages::read::{Look, Process, REST};

use super::view::{ProcessRow, StageRow};

/// What was seen of processes so far, by their id.
#[derive(Debug, Default)]
pub struct Stages {
    processes: BTreeMap<u32, (Process, Look, Instant)>,
    tick: Option<u64>,
}

impl Stages {
    /// Fills in the stages of these processes since the last call; `tick` is the world's newest.
    pub fn look(&mut self, rows: &mut [ProcessRow], tick: Option<u64>) {
        let mut before = std::mem::take(&mut self.processes);
        let n_ticks = tick
            .zip(self.tick)
            .and_then(|(now, then)| now.checked_sub(then))
            .filter(|n| *n > 0);
        self.tick = tick;
        for row in rows {
            let known = before.remove(&row.pid);
            let (mut process, last) = match known {
                Some((process, look, at)) => (process, Some((look, at))),
                None => (Process::new(row.pid), None),
            };
            let (Some(look), now) = (process.look(), Instant::now()) else {
                continue;
            };
            if let Some((last, at)) = last {
                let secs = now.duration_since(at).as_secs_f64();
                row.stages = stages(&look.since(&last), secs, n_ticks);
            }
            self.processes.insert(row.pid, (process, look, now));
        }
    }
}

/// The most expensive first; nothing of a process that counts no stages.
fn stages(took: &Look, secs: f64, n_ticks: Option<u64>) -> Vec<StageRow> {
    if took.stages.keys().all(|name| name == REST) {
        return Vec::new();
    }
    let row = |(name, sums): (&String, &schema_stages::Sums)| StageRow {
        stage: name.clone(),
        cpu_percent: sums.cpu_nanos as f64 / 1e7 / secs.max(1e-3),
        cpu_ms_per_tick: n_ticks.map(|n| sums.cpu_nanos as f64 / 1e6 / n as f64),
    };
    let mut rows: Vec<StageRow> = took.stages.iter().map(row).collect();
    rows.sort_by(|a, b| b.cpu_percent.total_cmp(&a.cpu_percent));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_stages::Sums;

    #[test]
    fn stages_are_shares_of_a_core_and_of_a_tick() {
        let sums = |cpu_nanos| Sums {
            cpu_nanos,
            ..Sums::default()
        };
        let mut took = Look {
            cpu_nanos: 500_000_000,
            stages: [("rest".to_owned(), sums(100_000_000))].into(),
            ..Look::default()
        };
        assert_eq!(stages(&took, 2.0, Some(10)), [], "a process without stages");
        took.stages.insert("physics".to_owned(), sums(400_000_000));
        let rows = stages(&took, 2.0, Some(10));
        let shown: Vec<_> = rows
            .iter()
            .map(|row| (row.stage.as_str(), row.cpu_percent, row.cpu_ms_per_tick))
            .collect();
        assert_eq!(
            shown,
            [("physics", 20.0, Some(40.0)), ("rest", 5.0, Some(10.0))]
        );
        assert_eq!(stages(&took, 2.0, None)[0].cpu_ms_per_tick, None);
    }
}
