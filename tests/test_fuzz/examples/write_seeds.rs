//! Writes every target's seeds into `FOLDER/TARGET/`, where cargo-fuzz begins its search.
//!
//! `cargo run --release -p test_fuzz --example write_seeds -- fuzz/corpus`

use std::path::Path;

fn main() -> std::io::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or("fuzz/corpus".into());
    for target in test_fuzz::TARGETS {
        let place = Path::new(&folder).join(target.name);
        std::fs::create_dir_all(&place)?;
        for (idx, seed) in (target.seeds)().into_iter().enumerate() {
            std::fs::write(place.join(format!("seed{idx}")), seed)?;
        }
    }
    Ok(())
}
