//! Makes an .rrd of a made-up drive without any daemon: `cargo run --example view_sample -- OUT.rrd
//! [MAP.xodr]`.
//!
//! For checking layout and colours by eye.

mod sample;

use consumer_view::look::Look;
use consumer_view::rerun;
use consumer_view::stage::Stage;

fn main() -> anyhow::Result<()> {
    let out = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "sample.rrd".to_string());
    let mut stage = Stage::new(
        rerun::RecordingStreamBuilder::new("gantry").save(&out)?,
        Look::default(),
    )?;
    let topics = sample::MODALITIES.map(sample::topic);
    stage.set_topics(topics.iter().map(String::as_str))?;
    if let Some(map) = std::env::args().nth(2) {
        stage.set_map(&std::fs::read_to_string(map)?)?;
    }
    stage.set_actors(&sample::actors());
    for tick in 1..=40u64 {
        let (header, records) = sample::snapshot(tick);
        stage.remember(&header, &records);
        stage.show_snapshot(&header, &records)?;
        stage.hurry()?;
        for modality in sample::MODALITIES {
            let (header, payload) = sample::frame(modality, tick);
            stage.show_frame(
                &sample::topic(modality),
                &header,
                &payload,
                80_000 + tick * 1000,
            )?;
        }
    }
    stage.flush(std::time::Duration::from_secs(20))?;
    println!("{out}");
    Ok(())
}
