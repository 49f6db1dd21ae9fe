//! Writes a small recording of made-up frames: `cargo run --example record_sample -- OUT.mcap
//! [TICKS [coded]]`.
//!
//! Every byte follows from the tick, so that a reader in another language
//! (`tests/oracle/read_sample.py`) can check all of them.

#[path = "../tests/it/sample.rs"]
mod sample;

use consumer_record::files::Files;
use consumer_record::options::{Coding, Split};
use consumer_record::writer::Target;
use schema_recording::write::ChunkCompression;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let target = args.next().unwrap_or_else(|| "sample.mcap".to_string());
    let n_ticks = args.next().map_or(Ok(20), |text| text.parse())?;
    let path = std::path::Path::new(&target);
    let coding = match args.next().as_deref() {
        Some("coded") => Coding::default(),
        _ => Coding::none(),
    };
    let files = Files::create(path, ChunkCompression::Lz4, Split::default())?;
    for (file, written) in sample::record_to(Target::Files(Box::new(files)), n_ticks, coding)? {
        println!(
            "{}: {} channels, {} bytes",
            file.display(),
            written.messages.len(),
            written.file_bytes
        );
    }
    Ok(())
}
