//! What a driver sees in a tick, besides itself.

use schema_frames::LightState;

use crate::parameters::Rules;
use crate::strangers::Strangers;
use crate::traffic::{Grid, Traffic};

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
