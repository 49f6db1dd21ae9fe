//! Prints a town's OpenDRIVE text: `cargo run --release -p simd_town --example open_drive --
//! Town10HD 1 > town.xodr`.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_else(|| "Town10HD".to_owned());
    let seed = args.next().map_or(Ok(1), |text| text.parse())?;
    print!("{}", simd_town::Town::open_drive(&name, seed)?);
    Ok(())
}
