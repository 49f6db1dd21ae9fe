//! Doors of a vehicle: which are asked to be open, and how far open they are.

use serde::{Deserialize, Serialize};

/// Number of doors: front left, front right, rear left, rear right.
pub(crate) const N_DOORS: usize = 4;
/// Time from shut to open, seconds.
const OPENING_SECS: f64 = 0.8;
/// Largest value of a door's opening in a snapshot (four bits).
const WIDE_OPEN: f32 = 15.0;

/// The doors of one vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Doors {
    /// One bit per door: asked to be open.
    asked: u8,
    /// 0 shut to 1 open.
    opening: [f32; N_DOORS],
}

impl Doors {
    /// Asks for doors to be open or shut, one bit each; they take their time.
    pub fn ask(&mut self, doors: u8, open: bool) {
        self.asked = if open {
            self.asked | doors
        } else {
            self.asked & !doors
        };
    }

    /// Moves the doors for one tick.
    pub fn step(&mut self, dt_secs: f64) {
        for (door, opening) in self.opening.iter_mut().enumerate() {
            let way = (dt_secs / OPENING_SECS) as f32;
            let asked = self.asked >> door & 1 != 0;
            *opening = if asked {
                (*opening + way).min(1.0)
            } else {
                (*opening - way).max(0.0)
            };
        }
    }

    /// Whether all doors are shut, so that the body mesh without doors can be shown.
    pub fn are_shut(&self) -> bool {
        self.opening == [0.0; N_DOORS]
    }

    /// How far a door is shown open, 0 to 1: it starts and ends gently.
    pub fn visible(&self, door: usize) -> f64 {
        let opening = f64::from(self.opening[door]);
        opening * opening * (3.0 - 2.0 * opening)
    }

    /// Bits 16 to 31 of a vehicle's flags in a snapshot: four for each door.
    pub fn flags(&self) -> u32 {
        // Rounded up, so that a door that is barely open does not read as shut.
        let level = |opening: &f32| (opening * WIDE_OPEN).ceil() as u32;
        self.opening
            .iter()
            .enumerate()
            .map(|(door, opening)| level(opening) << (16 + 4 * door))
            .sum()
    }
}
