//! Flies the spectator: shows `spectator/rgb` on a screen of our own, because the rerun viewer tells
//! nobody about keys and mouse, and moves the spectator over the bus. A crate beside `consumer_view`,
//! so that who flies without rerun is built without it.
//!
//! Modules in reading order: [`input`] (keys and mouse as intentions), [`pilot`] (from intentions to
//! poses), [`helm`] (sends poses to the simulator), [`screen`] (where the image is shown), of which
//! there are a `window` and a `terminal`.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod helm;
pub mod input;
pub mod pilot;
mod scale;
pub mod screen;
pub mod terminal;
pub mod window;

use std::time::{Duration, Instant};

use consumer_kit::{FollowedDocument, Follower, Take, WorldAt};
use schema_bus::{Bus, names};
use schema_frames::{ActorKind, ActorList};

use helm::Helm;
pub use helm::Options;
use input::Input;
use pilot::Pilot;
use screen::{Picture, Screen};

/// Longest wait for a frame before keys and mouse are looked at.
const LOOK_AT_KEYS: Duration = Duration::from_millis(10);
/// How often the line of text is renewed.
const SAY_EVERY: Duration = Duration::from_millis(200);
/// Longest step of a flight: after a pause of the program it does not leap.
const LONGEST_STEP_SECS: f64 = 0.2;

/// Keys, for people.
pub const KEYS: &str = "\
W A S D   fly forward, left, back, right (top view: move)   Q E   up, down   Shift   faster
mouse     drag to look around; arrow keys do the same       wheel speed, or distance and height
N P       follow the next, the previous vehicle or walker   F     fly freely
T         top view, also of who is followed                 Esc, X  end";

/// What a flight was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flown {
    /// Images shown.
    pub n_images: u64,
}

/// Shows and flies until the screen is closed or `stop` says so.
///
/// # Errors
/// If the bus cannot be joined, or the screen fails.
pub fn fly(
    options: &Options,
    screen: &mut dyn Screen,
    stop: &mut dyn FnMut() -> bool,
) -> anyhow::Result<Flown> {
    let program = format!("gantry-view-fly-{}", std::process::id());
    let bus = Bus::open_with(&options.domain, &program, &options.bus)?;
    let mut follower = Follower::on(bus);
    let topic = follower.follow(names::SPECTATOR_RGB, Take::Newest);
    let mut actors = FollowedDocument::new(names::WORLD_ACTORS);
    let helm = Helm::start(options)?;
    let mut pilot = Pilot::default();
    let mut flown = Flown::default();
    let mut rate = Rate::default();
    let (mut stepped, mut said) = (Instant::now(), None::<Instant>);
    while !stop() {
        follower.wait(LOOK_AT_KEYS)?;
        for input in screen.poll()? {
            if input == Input::Close {
                return Ok(flown);
            }
            pilot.take(input);
        }
        if let Some(list) = actors.changed(follower.bus())? {
            pilot.set_actors(&list.json::<ActorList>()?);
        }
        let world = follower.newest_world()?;
        let now = Instant::now();
        let step_secs = (now - stepped).as_secs_f64().min(LONGEST_STEP_SECS);
        stepped = now;
        if let Some(world) = &world {
            let wish = pilot.advance(step_secs, world);
            if let (Some(spectator), Some(pose)) = (spectator_of(world), wish) {
                helm.steer(spectator, pose);
            }
        }
        if let Some(frame) = follower.take(topic)? {
            let header = frame.header();
            flown.n_images += 1;
            rate.count(now);
            screen.show(&Picture {
                width_px: header.width,
                height_px: header.height,
                stride_bytes: header.row_stride as usize,
                bgra: &frame,
            })?;
        }
        if said.is_none_or(|at| at.elapsed() >= SAY_EVERY) {
            said = Some(now);
            let trouble = helm.trouble();
            screen.say(&line(options, &pilot, world.as_deref(), &rate, trouble))?;
        }
    }
    Ok(flown)
}

/// The spectator among the actors of a tick.
fn spectator_of(world: &WorldAt) -> Option<u32> {
    let is_spectator =
        |record: &&schema_frames::ActorRecord| record.kind() == Some(ActorKind::Spectator);
    world
        .records
        .iter()
        .find(is_spectator)
        .map(|record| record.id)
}

/// The line of text below the image.
fn line(
    options: &Options,
    pilot: &Pilot,
    world: Option<&WorldAt>,
    rate: &Rate,
    trouble: Option<String>,
) -> String {
    let Some(world) = world else {
        return format!(
            "no simulator on domain {:?} yet; start one with gantry up",
            options.domain
        );
    };
    let mut line = format!(
        "{} | tick {} | {:.0} images/s",
        pilot.describe(),
        world.header.tick,
        rate.hz()
    );
    if spectator_of(world).is_none() || rate.hz() == 0.0 {
        line += " | no images: the world stands still, or nobody publishes spectator/rgb";
    }
    if let Some(trouble) = trouble {
        line += &format!(" | {trouble}");
    }
    line
}

/// Images of the last seconds.
#[derive(Debug, Default)]
struct Rate {
    times: std::collections::VecDeque<Instant>,
}

impl Rate {
    const WINDOW: Duration = Duration::from_secs(2);

    fn count(&mut self, now: Instant) {
        self.times.push_back(now);
        self.times.retain(|at| now - *at <= Self::WINDOW);
    }

    fn hz(&self) -> f64 {
        let n = self
            .times
            .iter()
            .filter(|at| at.elapsed() <= Self::WINDOW)
            .count();
        n as f64 / Self::WINDOW.as_secs_f64()
    }
}
