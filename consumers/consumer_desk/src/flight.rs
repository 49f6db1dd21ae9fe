//! The spectator's picture for pages, rendered while somebody looks, and flown by keys and mouse of
//! the page.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use consumer_fly::input::{Held, Input, of_letter};
use consumer_fly::screen::{Picture, Screen};
use consumer_forms::picture::jpeg::{Pixels, jpeg};
use parking_lot::{Condvar, Mutex};
use serde::Deserialize;

/// Quality of the pictures.
const QUALITY: u8 = 75;
/// How long the picture is still rendered when nobody looks any more.
const LINGER: Duration = Duration::from_secs(3);
/// Most intentions of pages that wait.
const MAX_WAITING: usize = 1000;
/// How often it is looked for pages.
const TURN: Duration = Duration::from_millis(100);

/// What pages ask of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Asked {
    /// A letter or `shift`, `up`, `down`, `left`, `right` went down or up.
    Key(Key, bool),
    /// The mouse was dragged, radians to the left and down.
    Turn(f64, f64),
    /// The wheel turned by so many notches, away from the user.
    Wheel(f64),
    /// Follow this actor.
    Follow(u32),
    /// Follow nobody.
    Free,
    /// Look from above, or no longer.
    Top,
    /// The page lost the keyboard.
    Release,
}

/// A key of a page.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Key {
    /// Forward.
    W,
    /// Left.
    A,
    /// Back.
    S,
    /// Right.
    D,
    /// Up.
    Q,
    /// Down.
    E,
    /// Next actor.
    N,
    /// Previous actor.
    P,
    /// Faster.
    Shift,
    /// Look up.
    Up,
    /// Look down.
    Down,
    /// Look to the left.
    Left,
    /// Look to the right.
    Right,
}

impl Asked {
    fn input(self) -> Option<Input> {
        let usable = |x: f64| x.is_finite() && x.abs() < 100.0;
        Some(match self {
            Asked::Key(key, down) => return key.input(down),
            Asked::Turn(yaw_rad, pitch_rad) if usable(yaw_rad) && usable(pitch_rad) => {
                Input::Turn { yaw_rad, pitch_rad }
            }
            Asked::Wheel(notches) if usable(notches) => Input::Wheel(notches),
            Asked::Turn(..) | Asked::Wheel(_) => return None,
            Asked::Follow(id) => Input::FollowActor(id),
            Asked::Free => Input::Free,
            Asked::Top => Input::Top,
            Asked::Release => Input::ReleaseAll,
        })
    }
}

impl Key {
    fn input(self, down: bool) -> Option<Input> {
        let letter = match self {
            Key::W => 'w',
            Key::A => 'a',
            Key::S => 's',
            Key::D => 'd',
            Key::Q => 'q',
            Key::E => 'e',
            Key::N => 'n',
            Key::P => 'p',
            Key::Shift => return Some(Input::Hold(Held::Fast, down)),
            Key::Up => return Some(Input::Hold(Held::LookUp, down)),
            Key::Down => return Some(Input::Hold(Held::LookDown, down)),
            Key::Left => return Some(Input::Hold(Held::TurnLeft, down)),
            Key::Right => return Some(Input::Hold(Held::TurnRight, down)),
        };
        of_letter(letter, down)
    }
}

#[derive(Default)]
struct Newest {
    number: u64,
    jpeg: Arc<Vec<u8>>,
    line: String,
    inputs: Vec<Input>,
}

/// What pages and the flight share.
#[derive(Default)]
pub struct Flight {
    newest: Mutex<Newest>,
    shown: Condvar,
    n_watchers: AtomicUsize,
}

impl Flight {
    /// Says what a page asks for.
    pub fn ask(&self, asked: &[Asked]) {
        let mut newest = self.newest.lock();
        let room = MAX_WAITING.saturating_sub(newest.inputs.len());
        let inputs = asked.iter().filter_map(|asked| asked.input()).take(room);
        newest.inputs.extend(inputs);
    }

    /// Where the spectator is, in words.
    pub fn line(&self) -> String {
        self.newest.lock().line.clone()
    }

    /// Counts somebody who looks, until the value is dropped.
    pub fn watch(&self) -> Watcher<'_> {
        self.n_watchers.fetch_add(1, Ordering::AcqRel);
        Watcher(self)
    }

    /// The first picture after `number`, if one comes `within` that time.
    pub fn after(&self, number: u64, within: Duration) -> Option<(u64, Arc<Vec<u8>>)> {
        let mut newest = self.newest.lock();
        let waits = |newest: &mut Newest| newest.number <= number;
        self.shown.wait_while_for(&mut newest, waits, within);
        (newest.number > number).then(|| (newest.number, newest.jpeg.clone()))
    }

    /// Flies while somebody looks, until `ends`.
    ///
    /// # Errors
    /// If the bus cannot be joined.
    pub fn serve(&self, domain: &str, ends: &AtomicBool) -> anyhow::Result<()> {
        let options = consumer_fly::Options {
            domain: domain.to_owned(),
            bus: Default::default(),
        };
        while !ends.load(Ordering::Acquire) {
            if self.n_watchers.load(Ordering::Acquire) == 0 {
                std::thread::sleep(TURN);
                continue;
            }
            let mut seen = Instant::now();
            let mut stop = || {
                if self.n_watchers.load(Ordering::Acquire) > 0 {
                    seen = Instant::now();
                }
                ends.load(Ordering::Acquire) || seen.elapsed() > LINGER
            };
            consumer_fly::fly(&options, &mut Page(self), &mut stop)?;
        }
        Ok(())
    }
}

/// Somebody who looks.
pub struct Watcher<'f>(&'f Flight);

impl Drop for Watcher<'_> {
    fn drop(&mut self) {
        self.0.n_watchers.fetch_sub(1, Ordering::AcqRel);
    }
}

/// The pages as a screen.
struct Page<'f>(&'f Flight);

impl Screen for Page<'_> {
    fn poll(&mut self) -> anyhow::Result<Vec<Input>> {
        Ok(std::mem::take(&mut self.0.newest.lock().inputs))
    }

    fn show(&mut self, picture: &Picture<'_>) -> anyhow::Result<()> {
        let mut pixels = Vec::with_capacity(picture.bgra.len());
        for row in (0..picture.height_px).map_while(|y| picture.row(y)) {
            pixels.extend_from_slice(row.as_flattened());
        }
        let size = [picture.width_px, picture.height_px];
        let file = jpeg(size, Pixels::Bgra, &pixels, QUALITY).map_err(anyhow::Error::msg)?;
        let mut newest = self.0.newest.lock();
        newest.number += 1;
        newest.jpeg = Arc::new(file);
        drop(newest);
        self.0.shown.notify_all();
        Ok(())
    }

    fn say(&mut self, line: &str) -> anyhow::Result<()> {
        self.0.newest.lock().line = line.to_owned();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_pages_ask_reads_as_the_page_writes_it() {
        let text = r#"[{"key":["w",true]},{"key":["n",true]},{"turn":[0.1,-0.2]},{"wheel":1},{"follow":7},"free","top","release"]"#;
        let asked: Vec<Asked> = serde_json::from_str(text).unwrap();
        let flight = Flight::default();
        flight.ask(&asked);
        let inputs = Page(&flight).poll().unwrap();
        assert_eq!(inputs.len(), 8);
        assert_eq!(inputs[0], Input::Hold(Held::Forward, true));
        assert_eq!(inputs[4], Input::FollowActor(7));
        flight.ask(&[Asked::Wheel(f64::INFINITY), Asked::Turn(f64::NAN, 0.0)]);
        assert_eq!(Page(&flight).poll().unwrap(), []);
        assert!(serde_json::from_str::<Vec<Asked>>(r#"["land"]"#).is_err());
    }
}
