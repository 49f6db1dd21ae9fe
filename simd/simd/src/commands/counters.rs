//! Counters by name. They show tests and users whether work was done or avoided.

use std::collections::BTreeMap;

use schema_frames::CommandReply;

use crate::daemon::Daemon;

pub fn counters(daemon: &Daemon) -> CommandReply {
    let gpu = daemon.sensors.gpu();
    let gpu = gpu.map(|gpu| gpu.counters().counts()).unwrap_or_default();
    let of_workers = daemon.workers.totals();
    let mut counters = BTreeMap::from([
        ("ticks".to_owned(), daemon.tick.0),
        ("late_ticks".to_owned(), daemon.pace.n_late()),
        ("ticks_given_up".to_owned(), daemon.pace.n_given_up()),
        ("controls_refused".to_owned(), daemon.faults.controls.n()),
        (
            "control_samples_lost".to_owned(),
            daemon.ports.controls.n_lost(),
        ),
        (
            "control_samples_refused".to_owned(),
            daemon.ports.controls.n_faults(),
        ),
        ("acks_refused".to_owned(), daemon.faults.acks.n()),
        (
            "requests_refused".to_owned(),
            daemon.ports.commands.n_faults(),
        ),
        ("unsent".to_owned(), daemon.faults.n_unsent()),
        ("gpu_passes".to_owned(), gpu.passes),
        (
            "render_workers".to_owned(),
            daemon.workers.n_working() as u64,
        ),
        ("sent_by_workers".to_owned(), of_workers.n_sent),
        ("dropped_by_workers".to_owned(), of_workers.n_dropped),
        ("passes_of_workers".to_owned(), of_workers.n_passes),
        ("gpu_draws".to_owned(), gpu.draws),
        ("gpu_triangles".to_owned(), gpu.triangles),
        ("gpu_copies".to_owned(), gpu.copies),
        ("gpu_submissions".to_owned(), gpu.submissions),
        ("lidar_turns".to_owned(), daemon.sensors.n_lidar_turns()),
    ]);
    for topic in daemon.sensors.topics() {
        let (name, counts) = (&topic.name, &topic.counts);
        counters.insert(format!("sent {name}"), counts.n_sent);
        counters.insert(format!("dropped {name}"), counts.n_dropped);
        if counts.n_overflowed > 0 {
            counters.insert(format!("events_left_out {name}"), counts.n_overflowed);
        }
    }
    CommandReply::Counters { counters }
}
