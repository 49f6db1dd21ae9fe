//! What drivers see in a tick, besides themselves.

use schema_frames::LightState;

use crate::lanes::strangers::Strangers;
use crate::parameters::{Rules, Settings, VehicleParameters};
use crate::traffic::{Grid, Traffic};

/// What all drivers see in a tick.
#[derive(Clone, Copy)]
pub(crate) struct TickView<'t> {
    pub traffic: &'t Traffic,
    pub grid: &'t Grid,
    /// States by index of the signal.
    pub lights: &'t [LightState],
    pub strangers: &'t Strangers,
    pub settings: &'t Settings,
    /// What holds for vehicles for which nothing is set.
    pub plain: &'t VehicleParameters,
}

impl<'t> TickView<'t> {
    /// The same, as the driver of one vehicle reads it.
    pub fn of(&self, id: u32) -> View<'t> {
        View {
            traffic: self.traffic,
            grid: self.grid,
            lights: self.lights,
            strangers: self.strangers,
            rules: self.settings.rules(id, self.plain),
            seed: self.settings.seed,
        }
    }
}

/// What a driver sees in a tick, besides itself.
#[derive(Clone, Copy)]
pub(crate) struct View<'t> {
    pub traffic: &'t Traffic,
    pub grid: &'t Grid,
    /// States by index of the signal.
    pub lights: &'t [LightState],
    pub strangers: &'t Strangers,
    pub rules: Rules<'t>,
    pub seed: u64,
}
