//! A consumer in a screenful: follows one topic and prints what arrives, with its way through
//! shared memory in microseconds.
//!
//! `cargo run --release -p consumer_kit --example watch_topic -- ego/front/rgb [DOMAIN]`

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use consumer_kit::{Follower, MAX_WAIT, Take};
use schema_types::MonoTime;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let topic = args
        .next()
        .ok_or("usage: watch_topic RIG/SENSOR/MODALITY [DOMAIN]")?;
    let domain = args
        .next()
        .unwrap_or_else(schema_bus::names::default_domain);

    // A consumer that is killed leaves its place to the next clean-up; one that drops its ports
    // leaves nothing.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())?;
    }

    let mut follower = Follower::open(&domain, "watch_topic")?;
    let id = follower.follow(&topic, Take::All);
    while !stop.load(Relaxed) {
        follower.wait(MAX_WAIT)?;
        while let Some(frame) = follower.take(id)? {
            let header = frame.header();
            let age_us =
                schema_bus::mono_now().nanos_since(MonoTime(header.published_mono_nanos)) / 1000;
            let actors = follower
                .world_at(header.tick)?
                .map_or(0, |world| world.records.len());
            println!(
                "tick {:>6}  {:>9.3} s  {} × {}  {:>8} bytes  {age_us:>5} µs  {actors} actors",
                header.tick,
                header.sim_nanos as f64 * 1e-9,
                header.width,
                header.height,
                frame.len()
            );
        }
    }
    for report in follower.reports() {
        println!("{report}");
    }
    Ok(())
}
