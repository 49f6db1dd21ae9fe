//! IMUs of profiles at rest, whose noise another program estimates: noise density, bias instability and
//! random walk, one after the other.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use schema_types::noise::Noise;
use sensor_core::Drift;
use sensor_core::imu::{self, Felt, ImuNoise, STANDARD_GRAVITY_MPS2};
use sensor_spec::ImuSpec;
use serde::{Deserialize, Serialize};

use super::judge;

/// Head of the table.
pub const HEAD: &str = "
| profile | outside tool | planted error | sensor | N | slope | B | slope | K | slope | verdict |
|---|---|---|---|---|---|---|---|---|---|---|";

/// Greatest errors of the parameters N, B and K, and of the slopes.
const LIMITS: [f64; 3] = [0.03, 0.1, 0.1];
const SLOPE_LIMIT: f64 = 0.05;

/// The three sensors of one kind; the judge is given the first one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Triad {
    Accelerometer,
    Gyroscope,
}

impl Triad {
    fn name(self) -> &'static str {
        match self {
            Triad::Accelerometer => "accelerometer",
            Triad::Gyroscope => "gyroscope",
        }
    }

    /// What the profile says of its noise density and bias instability.
    fn nominal(self, spec: &ImuSpec) -> [f64; 2] {
        match self {
            Triad::Accelerometer => [
                spec.density_accel_mps2_rthz[0],
                spec.instability_accel_mps2[0],
            ],
            Triad::Gyroscope => [
                spec.density_gyro_radps_rthz[0],
                spec.instability_gyro_radps[0],
            ],
        }
    }

    /// An IMU of this bandwidth that has one error only.
    fn with(self, spec: &ImuSpec, process: Process, parameter: f64) -> ImuSpec {
        let mut alone = ImuSpec {
            bandwidth_accel_hz: spec.bandwidth_accel_hz,
            bandwidth_gyro_hz: spec.bandwidth_gyro_hz,
            ..ImuSpec::default()
        };
        let place = match (self, process) {
            (Triad::Accelerometer, Process::White) => &mut alone.density_accel_mps2_rthz,
            (Triad::Accelerometer, Process::Instability) => &mut alone.instability_accel_mps2,
            (Triad::Accelerometer, Process::Walk) => &mut alone.walk_accel_mps2_rts,
            (Triad::Gyroscope, Process::White) => &mut alone.density_gyro_radps_rthz,
            (Triad::Gyroscope, Process::Instability) => &mut alone.instability_gyro_radps,
            (Triad::Gyroscope, Process::Walk) => &mut alone.walk_gyro_radps_rts,
        };
        place[0] = parameter;
        alone
    }
}

/// What makes a slope of the Allan deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Process {
    White,
    Instability,
    Walk,
}

impl Process {
    const ALL: [Process; 3] = [Process::White, Process::Instability, Process::Walk];

    /// Samples a second and their number, averaging times between which the slope holds, and the slope.
    fn measured(self) -> (f64, u64, [f64; 2], f64) {
        match self {
            Process::White => (100.0, 300_000, [0.1, 2.0], -0.5),
            Process::Instability => (1.0, 200_000, [4.0, 200.0], 0.0),
            Process::Walk => (1.0, 200_000, [4.0, 200.0], 0.5),
        }
    }
}

/// What the script is told of a case, in a line before the samples.
#[derive(Serialize)]
struct Case {
    tool: &'static str,
    process: Process,
    rate_hz: f64,
    taus_secs: [f64; 2],
}

/// What the script answers of a case.
#[derive(Debug, Deserialize)]
struct Verdict {
    version: String,
    parameter: f64,
    slope: f64,
}

/// Prints the rows of one IMU; `false` if one is not as it must be.
pub fn check(name: &str, spec: &ImuSpec, python: &Path) -> anyhow::Result<bool> {
    let mut all_are_right = true;
    for (planted, factor) in [("none", 1.0), ("noise × 1.2", 1.2)] {
        for triad in [Triad::Accelerometer, Triad::Gyroscope] {
            let [density, instability] = triad.nominal(spec);
            // No data sheet here has a random walk; one of a hundredth of the density is judged.
            let nominal = [density, instability, 0.01 * density];
            let (mut cells, mut is_good, mut version) = (Vec::new(), true, String::new());
            for ((process, wanted), limit) in Process::ALL.into_iter().zip(nominal).zip(LIMITS) {
                if wanted <= 0.0 {
                    cells.push("– | –".to_owned());
                    continue;
                }
                let verdict = ask(
                    python,
                    triad,
                    process,
                    &triad.with(spec, process, factor * wanted),
                )?;
                let (_, _, _, slope) = process.measured();
                let ratio = verdict.parameter / wanted;
                is_good &= (ratio - 1.0).abs() <= limit;
                is_good &= (verdict.slope - slope).abs() <= SLOPE_LIMIT;
                cells.push(format!("× {ratio:.3} | {:.3}", verdict.slope));
                version = verdict.version;
            }
            let is_right = is_good == (factor == 1.0);
            all_are_right &= is_right;
            println!(
                "| `{name}` | allantools {version} | {planted} | {} | {} | {} |",
                triad.name(),
                cells.join(" | "),
                match (is_right, factor == 1.0) {
                    (true, true) => "within the limits",
                    (true, false) => "found",
                    (false, true) => "**beyond the limits**",
                    (false, false) => "**not found**",
                }
            );
        }
    }
    Ok(all_are_right)
}

/// What the judge says of the samples of an IMU at rest.
fn ask(python: &Path, triad: Triad, process: Process, spec: &ImuSpec) -> anyhow::Result<Verdict> {
    let (rate_hz, n_samples, taus_secs, _) = process.measured();
    let case = Case {
        tool: "allantools",
        process,
        rate_hz,
        taus_secs,
    };
    judge::ask(python, &case, &at_rest(spec, triad, rate_hz, n_samples))
}

/// What the first of three sensors measures at rest, less what it should.
fn at_rest(spec: &ImuSpec, triad: Triad, rate_hz: f64, n_samples: u64) -> Vec<u8> {
    let felt = Felt {
        force_mps2: Vector3::z() * STANDARD_GRAVITY_MPS2,
        turn_radps: Vector3::zeros(),
    };
    let pose = (felt, UnitQuaternion::identity());
    let value = |number: u64| {
        let noise = ImuNoise {
            of_tick: Noise::new(1, 1, number),
            drift: Drift {
                seed: 1,
                stream: 1,
                age_nanos: (number as f64 * 1e9 / rate_hz) as u64,
            },
            window_secs: 1.0 / rate_hz,
        };
        let sample = imu::sample(spec, &pose, &noise);
        match triad {
            Triad::Accelerometer => sample.specific_force_mps2[0],
            Triad::Gyroscope => sample.angular_velocity_radps[0],
        }
    };
    (1..=n_samples)
        .flat_map(|number| value(number).to_le_bytes())
        .collect()
}
