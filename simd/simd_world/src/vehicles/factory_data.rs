//! Default physical data of each vehicle model, and the values that clients may set.

use schema_frames::{GearPhysics, VehiclePhysics, WheelPhysics};

use super::model::VehicleModel;
use super::powertrain::CLUTCH_SLIP_RADPS;
use crate::errors::{OutOfRange, PhysicsError};
use crate::physics::GRAVITY_MPS2;

/// Friction between tyre and road.
pub(crate) const TYRE_FRICTION: f32 = 1.0;
/// At full brake the torque is this multiple of the tyres' grip, so 0.9 of the pedal already
/// reaches the limit.
const BRAKE_GRIP_RATIO: f32 = 1.1;
/// Torque of the hand brake over the load on its wheels at rest.
const HAND_BRAKE_GRIP_RATIO: f32 = 1.3;
/// Torque that the clutch carries over the engine's largest torque.
const CLUTCH_RESERVE: f32 = 1.6;
/// Longitudinal stiffness of a tyre per load and slip ratio.
const LONG_STIFFNESS: f32 = 15.0;
/// Lateral stiffness of front and rear tyres per load and radian: softer in front, so that vehicles
/// understeer.
const LAT_STIFFNESS_PER_RAD: [f32; 2] = [15.0, 17.0];
/// Steering lock over speed: (m/s, share of full lock) at 0, 20, 60 and 120 km/h.
const STEERING_CURVE: [[f32; 2]; 4] = [
    [0.0, 1.0],
    [5.555_556, 0.9],
    [16.666_667, 0.7],
    [33.333_333, 0.5],
];
/// Distance between the two rear axles of a three-axle lorry, metres.
const TANDEM_M: f64 = 1.3;

impl VehicleModel {
    /// Where the wheels stand on the ground: x forward and y left of the origin, metres. The order
    /// is front, rear for two-wheelers and front left, front right, … for others.
    pub fn wheel_sites_m(&self) -> Vec<[f64; 2]> {
        let x = 0.5 * self.wheelbase_m;
        if self.is_two_wheeler() {
            return vec![[x, 0.0], [-x, 0.0]];
        }
        let y = self.solid_half_m()[1] - 0.17;
        let axles = if self.n_wheels() == 6 {
            vec![x, -x + 0.5 * TANDEM_M, -x - 0.5 * TANDEM_M]
        } else {
            vec![x, -x]
        };
        axles.into_iter().flat_map(|x| [[x, y], [x, -y]]).collect()
    }

    /// Default centre of mass in the vehicle's space, metres.
    pub(crate) fn center_of_mass_m(&self) -> [f32; 3] {
        let forward = (self.front_load_ratio() - 0.5) * self.wheelbase_m;
        [forward as f32, 0.0, self.mass_height_m() as f32]
    }

    /// Frontal area of the body box without mirrors, m².
    pub fn frontal_area_m2(&self) -> f64 {
        let [_, half_y, half_z] = self.solid_half_m();
        4.0 * half_y * half_z
    }

    /// Default physical data.
    pub fn physics(&self) -> VehiclePhysics {
        let engine = &self.engine;
        let peak_nm = engine
            .torque_curve
            .iter()
            .map(|(_, torque)| *torque)
            .fold(0.0, f32::max);
        let gear = |ratio: &f32| GearPhysics {
            ratio: *ratio,
            down_ratio: engine.down_ratio,
            up_ratio: engine.up_ratio,
        };
        VehiclePhysics {
            torque_curve: engine
                .torque_curve
                .iter()
                .map(|(rpm, torque)| [*rpm, *torque])
                .collect(),
            max_rpm: engine.max_rpm,
            engine_inertia_kgm2: engine.inertia_kgm2,
            // The torque curve already has the engine's own friction subtracted.
            damping_full_throttle_nms: 0.0,
            damping_closed_engaged_nms: engine.drag_nm_s,
            damping_closed_open_nms: engine.inertia_kgm2 / 0.3,
            automatic_gearbox: true,
            gear_switch_secs: engine.shift_secs,
            clutch_strength_nms: CLUTCH_RESERVE * peak_nm / CLUTCH_SLIP_RADPS,
            final_ratio: engine.final_ratio,
            forward_gears: engine.ratios.iter().map(gear).collect(),
            mass_kg: self.mass_kg as f32,
            drag_coefficient: (self.drag_area_m2 / self.frontal_area_m2()) as f32,
            center_of_mass_m: self.center_of_mass_m(),
            steering_curve: STEERING_CURVE.to_vec(),
            wheels: self.wheels(),
            sweep_wheels: false,
        }
    }

    fn wheels(&self) -> Vec<WheelPhysics> {
        let weight_n = (self.mass_kg * GRAVITY_MPS2) as f32;
        let radius_m = self.wheel_radius_m as f32;
        let com = self.center_of_mass_m();
        // At the limit of grip, load moves forward by the ratio of height to wheelbase; the brakes
        // are distributed for that.
        let front = (self.front_load_ratio() + self.mass_height_m() / self.wheelbase_m)
            .clamp(0.5, 0.85) as f32;
        let sites = self.wheel_sites_m();
        let n_front = sites.iter().filter(|[x, _]| *x > 0.0).count() as f32;
        let n_rear = sites.len() as f32 - n_front;
        let loads = rest_load_ratios(
            &sites
                .iter()
                .map(|site| site.map(|x| x as f32))
                .collect::<Vec<_>>(),
            com[0],
        );
        let wheel = |([x, y], load): (&[f64; 2], &f32)| {
            let (is_front, load_n) = (*x > 0.0, load * weight_n);
            let brake_share = if is_front {
                front / n_front
            } else {
                (1.0 - front) / n_rear
            };
            WheelPhysics {
                friction: TYRE_FRICTION,
                damping_nms: 0.0,
                max_steer_rad: if is_front {
                    self.max_steer_rad() as f32
                } else {
                    0.0
                },
                radius_m,
                max_brake_nm: BRAKE_GRIP_RATIO * brake_share * weight_n * radius_m,
                max_hand_brake_nm: if is_front {
                    0.0
                } else {
                    HAND_BRAKE_GRIP_RATIO * load_n * radius_m
                },
                long_stiffness_kg: LONG_STIFFNESS * load_n / GRAVITY_MPS2 as f32,
                lat_stiffness_per_rad: LAT_STIFFNESS_PER_RAD[usize::from(!is_front)],
                lat_load_limit: 2.0,
                position_m: [*x as f32, *y as f32, radius_m],
            }
        };
        sites.iter().zip(&loads).map(wheel).collect()
    }
}

/// Share of the weight on each wheel at rest, from the position of the centre of mass between front
/// and rear wheels.
pub(crate) fn rest_load_ratios(sites_m: &[[f32; 2]], com_x_m: f32) -> Vec<f32> {
    let mean = |front: bool| {
        let of: Vec<f32> = sites_m
            .iter()
            .filter(|[x, _]| (*x > 0.0) == front)
            .map(|[x, _]| *x)
            .collect();
        (
            of.iter().sum::<f32>() / of.len().max(1) as f32,
            of.len().max(1) as f32,
        )
    };
    let ((front_m, n_front), (rear_m, n_rear)) = (mean(true), mean(false));
    let front = ((com_x_m - rear_m) / (front_m - rear_m)).clamp(0.05, 0.95);
    sites_m
        .iter()
        .map(|[x, _]| {
            if *x > 0.0 {
                front / n_front
            } else {
                (1.0 - front) / n_rear
            }
        })
        .collect()
}

///
/// Checks data that a client wants to set.
///
/// # Errors
///
/// If a number or a curve cannot be used.
pub(crate) fn check(physics: &VehiclePhysics, n_wheels: usize) -> Result<(), PhysicsError> {
    let within = OutOfRange::check;
    within("mass_kg", physics.mass_kg, 1.0, 1e6)?;
    within("max_rpm", physics.max_rpm, 1.0, 1e5)?;
    within(
        "engine_inertia_kgm2",
        physics.engine_inertia_kgm2,
        1e-4,
        1e3,
    )?;
    within(
        "damping_full_throttle_nms",
        physics.damping_full_throttle_nms,
        0.0,
        1e4,
    )?;
    within(
        "damping_closed_engaged_nms",
        physics.damping_closed_engaged_nms,
        0.0,
        1e4,
    )?;
    within(
        "damping_closed_open_nms",
        physics.damping_closed_open_nms,
        0.0,
        1e4,
    )?;
    within("gear_switch_secs", physics.gear_switch_secs, 0.0, 60.0)?;
    within("clutch_strength_nms", physics.clutch_strength_nms, 0.0, 1e6)?;
    within("final_ratio", physics.final_ratio, 1e-3, 100.0)?;
    within("drag_coefficient", physics.drag_coefficient, 0.0, 100.0)?;
    physics
        .center_of_mass_m
        .iter()
        .try_for_each(|x| within("center_of_mass_m", *x, -20.0, 20.0))?;
    within(
        "number of forward_gears",
        physics.forward_gears.len() as f32,
        1.0,
        20.0,
    )?;
    for gear in &physics.forward_gears {
        within("ratio of a gear", gear.ratio, 1e-3, 100.0)?;
        within("down_ratio of a gear", gear.down_ratio, 0.0, 1.0)?;
        within("up_ratio of a gear", gear.up_ratio, 0.0, 10.0)?;
    }
    curve("torque_curve", &physics.torque_curve, 1, [1e6, 1e6])?;
    curve("steering_curve", &physics.steering_curve, 0, [1e4, 1.0])?;
    if physics.wheels.len() != n_wheels {
        return Err(PhysicsError::Wheels {
            found: physics.wheels.len(),
            needed: n_wheels,
        });
    }
    for wheel in &physics.wheels {
        within("friction of a wheel", wheel.friction, 0.0, 100.0)?;
        within("damping_nms of a wheel", wheel.damping_nms, 0.0, 1e5)?;
        within("max_steer_rad of a wheel", wheel.max_steer_rad, 0.0, 1.55)?;
        within("radius_m of a wheel", wheel.radius_m, 0.05, 3.0)?;
        within("max_brake_nm of a wheel", wheel.max_brake_nm, 0.0, 1e6)?;
        within(
            "max_hand_brake_nm of a wheel",
            wheel.max_hand_brake_nm,
            0.0,
            1e6,
        )?;
        within(
            "long_stiffness_kg of a wheel",
            wheel.long_stiffness_kg,
            0.0,
            1e6,
        )?;
        within(
            "lat_stiffness_per_rad of a wheel",
            wheel.lat_stiffness_per_rad,
            0.0,
            1e4,
        )?;
        within("lat_load_limit of a wheel", wheel.lat_load_limit, 1e-2, 1e3)?;
    }
    Ok(())
}

/// Greatest number of points of a curve.
const MAX_CURVE_POINTS: usize = 256;

fn curve(
    curve: &'static str,
    points: &[[f32; 2]],
    least: usize,
    most: [f32; 2],
) -> Result<(), PhysicsError> {
    if !(least..=MAX_CURVE_POINTS).contains(&points.len()) {
        return Err(PhysicsError::PointCount {
            curve,
            found: points.len(),
            least,
            most: MAX_CURVE_POINTS,
        });
    }
    if let Some(&point) = points
        .iter()
        .find(|[x, y]| !((0.0..=most[0]).contains(x) && (0.0..=most[1]).contains(y)))
    {
        return Err(PhysicsError::Point { curve, point, most });
    }
    match points.windows(2).find(|pair| pair[1][0] < pair[0][0]) {
        Some(pair) => Err(PhysicsError::Falling {
            curve,
            from: pair[0][0],
            to: pair[1][0],
        }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicles::vehicle_models;

    #[test]
    fn factory_data_of_every_model_are_possible_and_loads_add_up() {
        for model in vehicle_models() {
            let physics = model.physics();
            check(&physics, model.n_wheels())
                .unwrap_or_else(|error| panic!("{}: {error}", model.type_id));
            let sites: Vec<[f32; 2]> = model
                .wheel_sites_m()
                .iter()
                .map(|site| site.map(|x| x as f32))
                .collect();
            let loads = rest_load_ratios(&sites, physics.center_of_mass_m[0]);
            let front: f32 = sites
                .iter()
                .zip(&loads)
                .filter(|([x, _], _)| *x > 0.0)
                .map(|(_, load)| load)
                .sum();
            assert!(
                (loads.iter().sum::<f32>() - 1.0).abs() < 1e-5
                    && (front - model.front_load_ratio() as f32).abs() < 1e-3
            );
            assert!(
                sites
                    .iter()
                    .all(|[x, _]| f64::from(x.abs()) < model.half_m[0]),
                "{} has wheels outside",
                model.type_id
            );
        }
    }

    #[test]
    fn impossible_data_are_refused_with_what_is_allowed() {
        let model = &vehicle_models()[0];
        let refused = |change: fn(&mut VehiclePhysics)| {
            let mut physics = model.physics();
            change(&mut physics);
            check(&physics, model.n_wheels()).unwrap_err().to_string()
        };
        assert_eq!(
            refused(|p| p.mass_kg = -1.0),
            "mass_kg is -1, but must be 1 to 1000000"
        );
        assert!(refused(|p| p.final_ratio = f32::NAN).starts_with("final_ratio is NaN"));
        assert_eq!(
            refused(|p| p.wheels.truncate(3)),
            "number of wheels is 3, but must stay 4"
        );
        assert!(refused(|p| p.forward_gears.clear()).contains("forward_gears is 0"));
        assert!(refused(|p| p.torque_curve.reverse()).contains("must rise"));
        assert!(refused(|p| p.wheels[1].radius_m = 0.0).contains("radius_m of a wheel is 0"));
    }
}
