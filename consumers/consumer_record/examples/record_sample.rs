//! Writes a small recording of made-up frames: `cargo run --example record_sample -- OUT.mcap
//! [TICKS]`.
//!
//! Every byte follows from the tick, so that a reader in another language
//! (`tests/oracle/read_sample.py`) can check all of them.

#[path = "../tests/sample/mod.rs"]
mod sample;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let target = args.next().unwrap_or_else(|| "sample.mcap".to_string());
    let n_ticks = args.next().map_or(Ok(20), |text| text.parse())?;
    let written = sample::record(
        std::path::Path::new(&target),
        n_ticks,
        schema_recording::write::ChunkCompression::Lz4,
    )?;
    println!(
        "{target}: {} channels, {} bytes",
        written.messages.len(),
        written.file_bytes
    );
    Ok(())
}
