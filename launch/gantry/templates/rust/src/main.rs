//! Publishes boxes round the cars that the front camera sees, for every image.

mod detect;

use std::error::Error;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use consumer_kit::schema_frames::Box2d;
use consumer_kit::{Follower, MAX_WAIT, Publisher, Take, default_domain};
use signal_hook::consts::{SIGINT, SIGTERM};

/// What is read. A detector of your own reads ego/front/rgb, whose pixels are B G R A.
const CAMERA: &str = "ego/front/semantic";
/// What is published; `gantry topic hz` and the viewer show it by this name.
const BOXES: &str = "{{name}}/boxes";

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    // Ctrl-C and the launcher's end: the ports close in order.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())?;
    }
    let mut follower = Follower::open(&default_domain(), "{{name}}")?;
    // Every image in order; `Take::Newest` skips those that came while this program was busy.
    let camera = follower.follow(CAMERA, Take::All);
    let boxes = Publisher::<Box2d>::open(follower.bus(), BOXES)?;
    while !stop.load(Ordering::Relaxed) {
        follower.wait(MAX_WAIT)?;
        while let Some(image) = follower.take(camera)? {
            let rows: Vec<&[u8]> = (0..image.header().height)
                .filter_map(|y| image.row(y))
                .collect();
            // Naming the image makes latency measurable, and places the boxes in the viewer.
            boxes.send(&detect::cars(&rows), &[&image])?;
        }
    }
    for report in follower.reports() {
        println!("{report}");
    }
    Ok(())
}
