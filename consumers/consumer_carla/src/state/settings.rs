//! CARLA's settings of an episode, of which the simulator keeps only the mode and the length of a
//! tick.

/// Longest and shortest physics sub-step of the simulator, seconds; the longest is CARLA's default
/// too.
const SUBSTEP_SECS: (f64, f64) = (1e-4, 0.01);

/// CARLA's settings besides the mode and the length of a tick.
#[derive(Clone, Debug)]
pub struct Settings {
    pub(crate) no_rendering: bool,
    /// Whether a client fixed the length of a tick; Gantry's is always fixed.
    pub(crate) fixed: bool,
    /// The length of a tick before a client fixed another one, to which clients can return.
    pub(crate) own_period_nanos: Option<u64>,
    pub(crate) substepping: bool,
    pub(crate) max_substep_secs: f64,
    pub(crate) max_substeps: i32,
    pub(crate) max_culling_distance_m: f32,
    pub(crate) deterministic_ragdolls: bool,
    pub(crate) tile_stream_distance_m: f32,
    pub(crate) actor_active_distance_m: f32,
    pub(crate) spectator_as_ego: bool,
}

impl Settings {
    /// The longest physics sub-step. CARLA's physics does one step per tick when sub-stepping is
    /// off, and falls behind when there are too few sub-steps for a tick; Gantry always simulates
    /// the whole tick, in as many sub-steps as needed.
    pub(crate) fn longest_substep_nanos(&self) -> u64 {
        let (least, most) = SUBSTEP_SECS;
        let asked = if self.substepping {
            self.max_substep_secs
        } else {
            most
        };
        // A value that is not a length (0, negative, NaN) asks for no particular length.
        let taken = if asked > 0.0 {
            asked.clamp(least, most)
        } else {
            most
        };
        (taken * 1e9).round() as u64
    }

    /// Sentences about what is done differently from what these settings ask for.
    pub(crate) fn differences(&self, period_nanos: u64) -> Vec<String> {
        let mut sentences = Vec::new();
        if !self.substepping {
            return sentences;
        }
        let (given, (least, most)) = (self.max_substep_secs, SUBSTEP_SECS);
        if !(least..=most).contains(&given) {
            let taken = self.longest_substep_nanos() as f64 * 1e-9;
            sentences.push(format!(
                "max_substep_delta_time is {given} s; {taken} s is taken: give {least} to {most}"
            ));
        }
        let (tick_secs, reach_secs) = (
            period_nanos as f64 * 1e-9,
            given * f64::from(self.max_substeps),
        );
        if tick_secs > reach_secs + 1e-9 {
            let n = self.max_substeps;
            sentences.push(format!(
                "a tick of {tick_secs} s is longer than max_substeps ({n}) × max_substep_delta_time ({given} s); more sub-steps are done"
            ));
        }
        sentences
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            no_rendering: false,
            fixed: false,
            own_period_nanos: None,
            substepping: true,
            max_substep_secs: 0.01,
            max_substeps: 10,
            max_culling_distance_m: 0.0,
            deterministic_ragdolls: true,
            tile_stream_distance_m: 3000.0,
            actor_active_distance_m: 2000.0,
            spectator_as_ego: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substeps_outside_of_what_physics_takes_are_the_nearest_inside_and_said() {
        let tick_nanos = 50_000_000;
        for (given, substepping, taken_nanos, said) in [
            (0.01, true, 10_000_000, ""),
            (
                1e-4,
                true,
                100_000,
                "a tick of 0.05 s is longer than max_substeps (499)",
            ),
            (
                1e-5,
                true,
                100_000,
                "max_substep_delta_time is 0.00001 s; 0.0001 s is taken: give 0.0001 to 0.01",
            ),
            (
                0.0,
                true,
                10_000_000,
                "max_substep_delta_time is 0 s; 0.01 s is taken",
            ),
            (
                -1.0,
                true,
                10_000_000,
                "max_substep_delta_time is -1 s; 0.01 s is taken",
            ),
            (
                f64::NAN,
                true,
                10_000_000,
                "max_substep_delta_time is NaN s; 0.01 s is taken",
            ),
            (
                0.05,
                true,
                10_000_000,
                "max_substep_delta_time is 0.05 s; 0.01 s is taken",
            ),
            (0.05, false, 10_000_000, ""),
        ] {
            let max_substeps = if given == 1e-4 { 499 } else { 1_000_000_000 };
            let settings = Settings {
                substepping,
                max_substep_secs: given,
                max_substeps,
                ..Settings::default()
            };
            assert_eq!(
                settings.longest_substep_nanos(),
                taken_nanos,
                "{given} {substepping}"
            );
            let sentences = settings.differences(tick_nanos).join("\n");
            assert!(
                if said.is_empty() {
                    sentences.is_empty()
                } else {
                    sentences.contains(said)
                },
                "{given} {substepping}: {sentences}"
            );
        }
    }
}
