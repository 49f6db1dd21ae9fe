//! Counters by name. They show tests and users whether work was done or avoided.

use std::collections::BTreeMap;

use schema_frames::CommandReply;

use crate::clock::Clock;
use crate::faults::Faults;
use crate::files::Files;
use crate::ports::Ports;
use crate::sensing::Sensing;

pub fn counters(
    sensing: &Sensing,
    ports: &Ports,
    clock: &Clock,
    files: &Files,
    faults: &Faults,
) -> CommandReply {
    let sensors = sensing.sensors();
    let gpu = sensors.gpu();
    let gpu = gpu.map(|gpu| gpu.counters().counts()).unwrap_or_default();
    let (of_workers, late) = (sensing.of_workers(), clock.late_ticks());
    let (intake, moves) = (ports.intake_counts(), sensors.moves());
    let mut counters = BTreeMap::from([
        ("ticks".to_owned(), clock.tick().0),
        ("late_ticks".to_owned(), late.n_late),
        ("ticks_given_up".to_owned(), late.n_given_up),
        ("controls_refused".to_owned(), faults.n_refused_controls()),
        ("control_samples_lost".to_owned(), intake.n_controls_lost),
        (
            "control_samples_refused".to_owned(),
            intake.n_controls_refused,
        ),
        ("acks_refused".to_owned(), faults.n_refused_acks()),
        ("requests_refused".to_owned(), intake.n_requests_refused),
        ("file_requests".to_owned(), files.n_waiting() as u64),
        ("unsent".to_owned(), faults.n_unsent()),
        ("gpu_passes".to_owned(), gpu.passes),
        ("render_workers".to_owned(), sensing.n_workers() as u64),
        ("sent_by_workers".to_owned(), of_workers.n_sent),
        ("dropped_by_workers".to_owned(), of_workers.n_dropped),
        ("passes_of_workers".to_owned(), of_workers.n_passes),
        ("sensors_moved".to_owned(), moves.n_sensors),
        ("batches_moved".to_owned(), moves.n_batches),
        ("gpu_draws".to_owned(), gpu.draws),
        ("gpu_triangles".to_owned(), gpu.triangles),
        ("gpu_copies".to_owned(), gpu.copies),
        ("gpu_submissions".to_owned(), gpu.submissions),
        ("lidar_turns".to_owned(), sensors.n_lidar_turns()),
    ]);
    for topic in sensors.topics() {
        let (name, counts) = (&topic.name, &topic.counts);
        counters.insert(format!("sent {name}"), counts.n_sent);
        counters.insert(format!("dropped {name}"), counts.n_dropped);
        if counts.n_overflowed > 0 {
            counters.insert(format!("events_left_out {name}"), counts.n_overflowed);
        }
    }
    CommandReply::Counters { counters }
}
