//! Publishes a made-up drive on a domain in real time, in the daemon's place: `cargo run --example
//! publish_sample -- DOMAIN [MAP.xodr] [TICKS]`.
//!
//! For trying viewer, recorder and readers in other languages without the simulator.

mod sample;

use std::time::{Duration, Instant};

use schema_bus::{Bus, FrameTopic, mono_now, names};

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let bus = Bus::open(
        &args.next().unwrap_or_else(|| "sample".to_string()),
        "publish-sample",
    )?;
    let map = args
        .next()
        .filter(|path| path != "-")
        .map(std::fs::read_to_string)
        .transpose()?;
    let n_ticks = args.next().map_or(Ok(u64::MAX), |text| text.parse())?;
    let epoch = mono_now().0 | 1;
    let topics = sample::MODALITIES.map(|modality| {
        let (_, payload) = sample::frame(modality, 1);
        Ok::<_, anyhow::Error>((
            modality,
            bus.frame_publisher(
                &sample::topic(modality),
                FrameTopic::new(modality, payload.len() * 2 + 100_000),
            )?,
        ))
    });
    let topics = topics.into_iter().collect::<Result<Vec<_>, _>>()?;
    let snapshots = bus.snapshot_publisher(16)?;
    let snapshot_wake = bus.notifier(names::WORLD_SNAPSHOT)?;
    let mut events = vec![bus.notifier(&names::rig_tick("ego"))?];
    for (_, publisher) in &topics {
        events.push(bus.notifier(publisher.topic())?);
    }
    let mut actors = bus.document_publisher(names::WORLD_ACTORS)?;
    actors.send_json(&sample::actors(), epoch, 0)?;
    let mut map_publisher = bus.document_publisher(names::WORLD_MAP)?;
    if let Some(map) = &map {
        map_publisher.send(map, epoch, 0)?;
    }
    let start = Instant::now();
    for tick in 1..=n_ticks {
        let (header, records) = sample::snapshot(tick);
        snapshots.send(schema_frames::SnapshotHeader { epoch, ..header }, &records)?;
        snapshot_wake.notify();
        for (modality, publisher) in &topics {
            if publisher.n_readers() == 0 {
                continue;
            }
            let (header, payload) = sample::frame(*modality, tick);
            let mut loan = publisher.loan(payload.len())?;
            loan.payload_mut().copy_from_slice(&payload);
            *loan.header_mut() = schema_frames::FrameHeader { epoch, ..header };
            loan.send()?;
        }
        events.iter().for_each(|event| {
            event.notify_listeners();
        });
        [&actors, &map_publisher]
            .iter()
            .for_each(|document| document.greet());
        snapshots.greet();
        std::thread::sleep(
            (start + Duration::from_nanos(tick * sample::PERIOD_NANOS))
                .saturating_duration_since(Instant::now()),
        );
    }
    Ok(())
}
