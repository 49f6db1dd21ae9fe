//! Doors of vehicles: which are asked to be open, and how far they are.

use schema_types::ActorId;
use serde::{Deserialize, Serialize};
use simd_body::BodyStyle;

use crate::models::VehicleModel;
use crate::world::{ActorError, World};

/// Doors of a vehicle: front left, front right, rear left, rear right.
pub(crate) const N_DOORS: usize = 4;
/// Time from shut to open, seconds.
const OPENING_SECS: f64 = 0.8;
/// Largest value of a door's opening in a snapshot.
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
    /// Moves them for a tick.
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

    /// Whether the plain body will do.
    pub fn are_shut(&self) -> bool {
        self.opening == [0.0; N_DOORS]
    }

    /// How far a door is, as one sees it: it starts and ends gently.
    pub fn visible(&self, door: usize) -> f64 {
        let opening = f64::from(self.opening[door]);
        opening * opening * (3.0 - 2.0 * opening)
    }

    /// Bits 16 to 31 of a vehicle's flags in a snapshot: four for each door.
    pub fn flags(&self) -> u32 {
        // A door that is ajar is not shut.
        let level = |opening: &f32| (opening * WIDE_OPEN).ceil() as u32;
        self.opening
            .iter()
            .enumerate()
            .map(|(door, opening)| level(opening) << (16 + 4 * door))
            .sum()
    }
}

impl VehicleModel {
    /// Whether its doors open: cars and vans of the second generation, as in CARLA.
    pub fn has_dynamic_doors(&self) -> bool {
        use BodyStyle::{Hatch, Microbus, Saloon, Suv, Van};
        self.generation == 2 && matches!(self.style, Saloon | Hatch | Suv | Van | Microbus)
    }
}

impl World {
    /// Opens or shuts doors of a vehicle, one bit each: 1 front left, 2 front right, 4 rear left, 8
    /// rear right. They take their time.
    pub fn set_doors(&mut self, actor: ActorId, doors: u8, open: bool) -> Result<(), ActorError> {
        let vehicle = self.vehicle_mut(actor)?;
        if !vehicle.model.has_dynamic_doors() {
            let type_id = vehicle.model.type_id.to_owned();
            return Err(ActorError::WrongKind {
                actor,
                type_id,
                needed: "vehicle whose has_dynamic_doors is true",
            });
        }
        if doors == 0 || doors > 15 {
            return Err(ActorError::Value {
                actor,
                what: "doors",
                problem: "must be a sum of 1, 2, 4 and 8 (front left to rear right)",
            });
        }
        vehicle.doors.asked = if open {
            vehicle.doors.asked | doors
        } else {
            vehicle.doors.asked & !doors
        };
        Ok(())
    }
}
