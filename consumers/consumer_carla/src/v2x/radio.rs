//! How strongly a radio message arrives: path loss, which depends on what stands between the
//! antennas, and fading.
//!
//! Formulas: ETSI TR 103 257-1 (WINNER+ path loss, fading), two-ray interference over ground,
//! knife-edge diffraction of ITU-R P.526.

use crate::wire::description::Attributes;
use crate::wire::fields::Wrong;

const LIGHT_MPS: f64 = 299_792_458.0;
/// Relative permittivity of the ground in the two-ray model.
const GROUND_PERMITTIVITY: f64 = 1.02;
/// Antennas that are nearer count as this far apart, metres.
const NEAREST_M: f64 = 0.1;

/// What stands between two antennas.
#[derive(Clone, Debug, PartialEq)]
pub enum Path {
    /// Nothing.
    Free,
    /// Vehicles: for each its distances from the sender and from the receiver, and how far it
    /// reaches above the straight line, metres.
    BehindVehicles(Vec<[f64; 3]>),
    /// A building or a wall.
    BehindBuilding,
}

/// The surroundings, on which fading depends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scenario {
    Highway,
    Rural,
    Urban,
}

/// A station's radio.
#[derive(Clone, Debug)]
pub struct Radio {
    /// Power of its own messages, dBm.
    pub transmit_dbm: f64,
    sensitivity_dbm: f64,
    frequency_ghz: f64,
    gain_dbi: f64,
    exponent: f64,
    reference_m: f64,
    farthest_m: f64,
    is_winner: bool,
    scenario: Scenario,
    /// Standard deviation of fading, dB; `None` for ETSI's values.
    fading_db: Option<f64>,
}

/// Where the antennas are.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// Distance between the antennas, metres.
    pub distance_m: f64,
    /// Heights of the antennas above the lower of the two actors' ground points, metres.
    pub heights_m: [f64; 2],
}

impl Radio {
    /// Reads a station's attributes.
    ///
    /// # Errors
    /// If a value is impossible.
    pub fn of(given: &Attributes<'_>) -> Result<Radio, Wrong> {
        let positive = |name: &str, default: f64| match given.float(name, default) {
            value if value > 0.0 => Ok(value),
            value => Err(Wrong::Value(format!(
                "{name} is {value}, but must be more than 0"
            ))),
        };
        let scenario = match given.text("scenario").unwrap_or("highway") {
            "highway" => Scenario::Highway,
            "rural" => Scenario::Rural,
            "urban" => Scenario::Urban,
            other => {
                return Err(Wrong::Value(format!(
                    "scenario is {other:?}, but must be highway, rural or urban"
                )));
            }
        };
        let is_winner = match given.text("path_loss_model").unwrap_or("geometric") {
            "winner" => true,
            "geometric" => false,
            other => {
                return Err(Wrong::Value(format!(
                    "path_loss_model is {other:?}, but must be winner or geometric"
                )));
            }
        };
        let custom_db = given.float("custom_fading_stddev", 0.0);
        if custom_db < 0.0 {
            return Err(Wrong::Value(format!(
                "custom_fading_stddev is {custom_db}, but must be 0 or more"
            )));
        }
        Ok(Radio {
            transmit_dbm: given.float("transmit_power", 21.5),
            sensitivity_dbm: given.float("receiver_sensitivity", -99.0),
            frequency_ghz: positive("frequency_ghz", 5.9)?,
            gain_dbi: given.float("combined_antenna_gain", 10.0),
            exponent: given.float("path_loss_exponent", 2.7),
            reference_m: positive("d_ref", 1.0)?,
            farthest_m: given.float("filter_distance", 500.0),
            is_winner,
            scenario,
            fading_db: (!given.bool("use_etsi_fading", true)).then_some(custom_db),
        })
    }

    /// Whether senders at this distance are considered at all.
    pub fn reaches(&self, distance_m: f64) -> bool {
        distance_m < self.farthest_m
    }

    /// The power at which a message arrives, dBm; `None` if it is too weak. `fading` is a draw of
    /// the standard normal distribution.
    pub fn received_dbm(
        &self,
        transmit_dbm: f64,
        link: &Link,
        path: &Path,
        fading: f64,
    ) -> Option<f64> {
        let power_dbm = transmit_dbm + self.gain_dbi
            - self.loss_db(link, path)
            - fading * self.fading_stddev_db(path);
        (power_dbm >= self.sensitivity_dbm).then_some(power_dbm)
    }

    fn wavelength_m(&self) -> f64 {
        LIGHT_MPS / (self.frequency_ghz * 1e9)
    }

    /// Path loss without fading.
    fn loss_db(&self, link: &Link, path: &Path) -> f64 {
        let distance_m = link.distance_m.max(NEAREST_M);
        let base_db = match (path, self.is_winner) {
            (Path::BehindBuilding, true) => {
                36.85 + 30.0 * distance_m.log10() + 18.9 * self.frequency_ghz.log10()
            }
            (_, true) if self.scenario == Scenario::Highway => {
                32.4 + 20.0 * distance_m.log10() + 20.0 * self.frequency_ghz.log10()
            }
            (_, true) => 38.77 + 16.7 * distance_m.log10() + 18.2 * self.frequency_ghz.log10(),
            (Path::BehindBuilding, false) => {
                self.free_space_db(self.reference_m)
                    + 10.0 * self.exponent * (distance_m / self.reference_m).log10()
            }
            (Path::BehindVehicles(_), false) => self.free_space_db(distance_m),
            (Path::Free, false) => self.two_ray_db(distance_m, link.heights_m),
        };
        let Path::BehindVehicles(vehicles) = path else {
            return base_db;
        };
        base_db
            + vehicles
                .iter()
                .map(|edge| self.knife_edge_db(*edge))
                .fold(0.0, f64::max)
    }

    fn free_space_db(&self, distance_m: f64) -> f64 {
        20.0 * (4.0 * std::f64::consts::PI * distance_m / self.wavelength_m()).log10()
    }

    /// Interference of the direct ray with the one that the ground reflects.
    fn two_ray_db(&self, distance_m: f64, [a_m, b_m]: [f64; 2]) -> f64 {
        let along_m = (distance_m.powi(2) - (a_m - b_m).powi(2))
            .max(NEAREST_M.powi(2))
            .sqrt();
        let reflected_m = (along_m.powi(2) + (a_m + b_m).powi(2)).sqrt();
        let (sin, cos) = ((a_m + b_m) / reflected_m, along_m / reflected_m);
        let root = (GROUND_PERMITTIVITY - cos.powi(2)).sqrt();
        let reflection = (sin - root) / (sin + root);
        let phase_rad = std::f64::consts::TAU * (distance_m - reflected_m) / self.wavelength_m();
        let sum = (1.0 + reflection * phase_rad.cos()).hypot(reflection * phase_rad.sin());
        self.free_space_db(along_m) - 20.0 * sum.max(1e-6).log10()
    }

    /// Loss over an edge that reaches `above_m` over the straight line.
    fn knife_edge_db(&self, [from_m, to_m, above_m]: [f64; 3]) -> f64 {
        let (from_m, to_m) = (from_m.max(NEAREST_M), to_m.max(NEAREST_M));
        let v = above_m * (2.0 * (from_m + to_m) / (self.wavelength_m() * from_m * to_m)).sqrt();
        if v <= -0.78 {
            0.0
        } else {
            6.9 + 20.0 * (((v - 0.1).powi(2) + 1.0).sqrt() + v - 0.1).log10()
        }
    }

    fn fading_stddev_db(&self, path: &Path) -> f64 {
        self.fading_db.unwrap_or(match (path, self.scenario) {
            (Path::BehindBuilding, _) => 6.8,
            (Path::Free, Scenario::Highway) => 3.3,
            (Path::Free, Scenario::Urban) => 5.2,
            (Path::BehindVehicles(_), Scenario::Highway) => 3.8,
            (Path::BehindVehicles(_), Scenario::Urban) => 5.3,
            // The report has no rural values; these are the means of the other two.
            (Path::Free, Scenario::Rural) => 4.25,
            (Path::BehindVehicles(_), Scenario::Rural) => 4.55,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::description::{Attribute, Description};

    fn radio(attributes: &[(&str, &str)]) -> Result<Radio, Wrong> {
        let attribute = |(name, value): &(&str, &str)| Attribute {
            name: (*name).into(),
            kind: 4,
            value: (*value).into(),
        };
        let description = Description {
            type_id: "sensor.other.v2x".into(),
            attributes: attributes.iter().map(attribute).collect(),
        };
        Radio::of(&Attributes::of(&description))
    }

    /// Hand calculations: 20 lg(4π·1 m·5.9 GHz/c) = 47.865 dB.
    #[test]
    fn losses_are_those_of_the_formulas() {
        let geometric = radio(&[]).unwrap();
        let link = |distance_m: f64| Link {
            distance_m,
            heights_m: [1.5, 1.5],
        };
        assert!((geometric.free_space_db(1.0) - 47.865).abs() < 2e-3);
        assert!(
            (geometric.loss_db(&link(100.0), &Path::BehindBuilding) - (47.865 + 54.0)).abs() < 2e-3
        );
        let winner = radio(&[("path_loss_model", "winner")]).unwrap();
        assert!((winner.loss_db(&link(100.0), &Path::Free) - 87.817).abs() < 2e-3);
        assert!(
            (winner.loss_db(&link(10.0), &Path::BehindBuilding) - (66.85 + 14.569)).abs() < 2e-3
        );
        let urban = radio(&[("path_loss_model", "winner"), ("scenario", "urban")]).unwrap();
        assert!((urban.loss_db(&link(100.0), &Path::Free) - (72.17 + 14.029)).abs() < 2e-3);
    }

    /// An edge that touches the line costs 6 dB, and the two-ray model falls with the fourth power
    /// of large distances.
    #[test]
    fn edges_and_far_rays_have_their_known_limits() {
        let radio = radio(&[]).unwrap();
        assert!((radio.knife_edge_db([50.0, 50.0, 0.0]) - 6.03).abs() < 0.02);
        assert_eq!(radio.knife_edge_db([50.0, 50.0, -5.0]), 0.0);
        assert!(radio.knife_edge_db([50.0, 50.0, 2.0]) > radio.knife_edge_db([50.0, 50.0, 1.0]));
        let far = |distance_m: f64| {
            radio.loss_db(
                &Link {
                    distance_m,
                    heights_m: [1.5, 1.5],
                },
                &Path::Free,
            )
        };
        let by_formula = 40.0 * 1e5f64.log10() - 20.0 * (1.5f64 * 1.5).log10();
        assert!(
            (far(1e5) - by_formula).abs() < 0.1,
            "{} {by_formula}",
            far(1e5)
        );
        assert!((far(2e5) - far(1e5) - 12.04).abs() < 0.05);
    }

    #[test]
    fn weak_messages_do_not_arrive_and_impossible_radios_are_sentences() {
        let radio = radio(&[("use_etsi_fading", "false")]).unwrap();
        let link = |distance_m: f64| Link {
            distance_m,
            heights_m: [1.5, 1.5],
        };
        assert!(
            radio
                .received_dbm(21.5, &link(50.0), &Path::Free, 3.0)
                .is_some()
        );
        assert!(
            radio
                .received_dbm(21.5, &link(5000.0), &Path::BehindBuilding, 0.0)
                .is_none()
        );
        assert!(radio.reaches(499.0) && !radio.reaches(501.0));
        for wrong in [
            ("d_ref", "0"),
            ("frequency_ghz", "-1"),
            ("scenario", "moon"),
            ("path_loss_model", "x"),
            ("custom_fading_stddev", "-2"),
        ] {
            let error = self::radio(&[wrong]).unwrap_err().to_string();
            assert!(error.contains(wrong.0), "{error}");
        }
    }
}
