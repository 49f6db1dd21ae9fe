//! Reads a camera on the GPU that it was drawn on, and copies nothing but four bytes: the pixel in
//! the middle of every frame. `mean_colour [TOPIC] [DOMAIN]`.

use std::time::Duration;

use consumer_gpu::{Device, GpuTopic};

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let topic = arguments.next().unwrap_or("ego/front/rgb".into());
    let domain = arguments.next().unwrap_or("gantry".into());
    let bus = schema_bus::Bus::open(&domain, "mean-colour")?;
    let mut camera = GpuTopic::open(&bus, &topic, Device::Cuda)?;
    if let Some(why) = camera.fallback() {
        eprintln!("frames are uploaded: {why}");
    }
    while let Some(frame) = camera.wait(&bus, Duration::from_secs(10))? {
        let header = frame.header();
        let pixels = frame.to_bytes()?;
        let mean =
            pixels.iter().map(|byte| u64::from(*byte)).sum::<u64>() as f64 / pixels.len() as f64;
        println!(
            "tick {}: {} × {}, mean {mean:.1}",
            header.tick, header.width, header.height
        );
    }
    Ok(())
}
