//! What lines are, and how they are compared.

/// Points of a line: forward, left and up from the vehicle, metres.
pub type Line = Vec<[f64; 3]>;

/// What is scored.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The nearest step, metres ahead.
    pub from_m: f64,
    /// The range ends here, metres ahead.
    pub to_m: f64,
    /// Steps in the range; the first is its beginning, the last lies one step before its end.
    pub n_samples: usize,
    /// Distances at which F1 is taken, metres.
    pub thresholds_m: Vec<f64>,
    /// Share of steps that must lie within the distance.
    pub share: f64,
    /// Whether heights count; without, lines are compared on the ground.
    pub use_height: bool,
    /// Up to here errors are near, metres ahead.
    pub near_m: f64,
}

impl Default for Settings {
    /// OpenLane's: 100 steps from 3 m to 103 m, three quarters, near up to 40 m; at 0.5, 1 and its
    /// own 1.5 m.
    fn default() -> Self {
        Self {
            from_m: 3.0,
            to_m: 103.0,
            n_samples: 100,
            thresholds_m: vec![0.5, 1.0, 1.5],
            share: 0.75,
            use_height: true,
            near_m: 40.0,
        }
    }
}
