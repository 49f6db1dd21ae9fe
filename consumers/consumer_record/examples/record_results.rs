//! Writes a small recording of made-up results of users' programs: `cargo run --example
//! record_results -- OUT.mcap [TICKS]`, for `tests/oracle/read_results.py`.

#[path = "../tests/it/sample/results.rs"]
mod sample;

use consumer_forms::foxglove::results::ResultConverter;
use consumer_kit::items::ResultParts;
use schema_frames::{InputRecord, ResultHeader, ResultType};
use schema_recording::messages::Batch;
use schema_recording::write::{ChunkCompression, Recording};

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let target = args.next().unwrap_or_else(|| "results.mcap".to_string());
    let n_ticks: u64 = args.next().map_or(Ok(20), |text| text.parse())?;
    let mut recording = Recording::create(std::path::Path::new(&target), ChunkCompression::Zstd)?;
    let mut converter = ResultConverter::default();
    for (tick, kind) in
        (1..=n_ticks).flat_map(|tick| ResultType::ALL.iter().map(move |it| (tick, *it)))
    {
        let (topic, about, body) = (
            sample::topic(kind),
            sample::about(kind),
            sample::body(kind, tick),
        );
        let mut header = ResultHeader::new(kind);
        sample::describe(&mut header, kind, body.len());
        (header.tick, header.seq, header.n_inputs) = (tick, tick, 1);
        header.sim_nanos = tick * 50_000_000;
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, 1);
        let mut input = InputRecord::new("ego/front/rgb");
        (input.tick, input.seq) = (tick, tick);
        let parts = ResultParts {
            topic: &topic,
            header: &header,
            kind,
            body: &body,
            inputs: &[input],
            about: &about,
        };
        recording.write(&Batch {
            source: topic.as_str().into(),
            sequence: tick as u32,
            log_nanos: header.sim_nanos,
            publish_nanos: header.sim_nanos,
            entries: converter.entries(&parts, header.sim_nanos, &mut |n| Vec::with_capacity(n)),
        })?;
    }
    let written = recording.finish()?;
    println!(
        "{target}: {} channels, {} bytes",
        written.messages.len(),
        written.file_bytes
    );
    Ok(())
}
