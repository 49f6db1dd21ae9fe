//! Engines and gearboxes of the vehicles.

use super::engine_spec::EngineSpec;

pub const PETROL_SMALL: EngineSpec = EngineSpec {
    torque_curve: &[
        (600.0, 60.0),
        (1000.0, 85.0),
        (2000.0, 130.0),
        (3500.0, 155.0),
        (4500.0, 150.0),
        (6000.0, 120.0),
        (6500.0, 95.0),
    ],
    idle_rpm: 800.0,
    launch_rpm: 2000.0,
    max_rpm: 6500.0,
    ratios: &[3.6, 2.05, 1.38, 1.03, 0.82, 0.68],
    down_ratio: 0.38,
    up_ratio: 0.92,
    reverse_ratio: 3.4,
    final_ratio: 4.9,
    efficiency_ratio: 0.90,
    shift_secs: 0.25,
    drag_nm_s: 0.05,
    inertia_kgm2: 0.10,
};
pub const PETROL_STRONG: EngineSpec = EngineSpec {
    torque_curve: &[
        (600.0, 150.0),
        (1000.0, 210.0),
        (2000.0, 290.0),
        (3500.0, 330.0),
        (4500.0, 325.0),
        (6000.0, 280.0),
        (6500.0, 240.0),
    ],
    ratios: &[3.5, 2.3, 1.6, 1.2, 0.95, 0.75],
    final_ratio: 3.7,
    shift_secs: 0.2,
    drag_nm_s: 0.08,
    inertia_kgm2: 0.16,
    ..PETROL_SMALL
};
pub const PETROL_LARGE: EngineSpec = EngineSpec {
    torque_curve: &[
        (600.0, 210.0),
        (1000.0, 300.0),
        (2000.0, 430.0),
        (3500.0, 490.0),
        (4500.0, 470.0),
        (6000.0, 390.0),
        (6500.0, 330.0),
    ],
    inertia_kgm2: 0.22,
    ..PETROL_STRONG
};
pub const ELECTRIC: EngineSpec = EngineSpec {
    torque_curve: &[
        (0.0, 350.0),
        (5400.0, 350.0),
        (8000.0, 236.0),
        (12000.0, 158.0),
        (16000.0, 118.0),
    ],
    idle_rpm: 0.0,
    launch_rpm: 0.0,
    max_rpm: 16000.0,
    ratios: &[1.0],
    down_ratio: 0.3,
    up_ratio: 0.9,
    reverse_ratio: 1.0,
    final_ratio: 9.0,
    efficiency_ratio: 0.95,
    shift_secs: 0.0,
    drag_nm_s: 0.02,
    inertia_kgm2: 0.04,
};
pub const ELECTRIC_SMALL: EngineSpec = EngineSpec {
    torque_curve: &[(0.0, 90.0), (1500.0, 90.0), (4000.0, 34.0), (8000.0, 16.0)],
    max_rpm: 8000.0,
    drag_nm_s: 0.01,
    inertia_kgm2: 0.01,
    ..ELECTRIC
};
pub const DIESEL_VAN: EngineSpec = EngineSpec {
    torque_curve: &[
        (600.0, 150.0),
        (1000.0, 260.0),
        (1500.0, 360.0),
        (2500.0, 370.0),
        (3500.0, 310.0),
        (4200.0, 220.0),
    ],
    idle_rpm: 750.0,
    launch_rpm: 1600.0,
    max_rpm: 4200.0,
    ratios: &[4.0, 2.4, 1.6, 1.15, 0.88, 0.7],
    down_ratio: 0.40,
    up_ratio: 0.92,
    reverse_ratio: 4.2,
    final_ratio: 3.6,
    efficiency_ratio: 0.88,
    shift_secs: 0.3,
    drag_nm_s: 0.12,
    inertia_kgm2: 0.25,
};
pub const DIESEL_HEAVY: EngineSpec = EngineSpec {
    torque_curve: &[
        (500.0, 700.0),
        (800.0, 1300.0),
        (1000.0, 1700.0),
        (1400.0, 1800.0),
        (1800.0, 1500.0),
        (2300.0, 900.0),
    ],
    idle_rpm: 550.0,
    launch_rpm: 1000.0,
    max_rpm: 2300.0,
    ratios: &[4.6, 3.1, 2.15, 1.5, 1.05, 0.8],
    down_ratio: 0.45,
    up_ratio: 0.90,
    reverse_ratio: 4.6,
    final_ratio: 3.1,
    efficiency_ratio: 0.86,
    shift_secs: 0.4,
    drag_nm_s: 0.9,
    inertia_kgm2: 1.5,
};
pub const MOTORBIKE: EngineSpec = EngineSpec {
    torque_curve: &[
        (1000.0, 50.0),
        (3000.0, 70.0),
        (6000.0, 88.0),
        (9000.0, 85.0),
        (11000.0, 62.0),
    ],
    idle_rpm: 1200.0,
    launch_rpm: 3500.0,
    max_rpm: 11000.0,
    ratios: &[2.8, 2.05, 1.65, 1.38, 1.2, 1.06],
    down_ratio: 0.38,
    up_ratio: 0.92,
    reverse_ratio: 2.8,
    final_ratio: 4.6,
    efficiency_ratio: 0.9,
    shift_secs: 0.15,
    drag_nm_s: 0.015,
    inertia_kgm2: 0.02,
};
/// A continuous belt drive, modelled as six close gears.
pub const SCOOTER: EngineSpec = EngineSpec {
    torque_curve: &[
        (1500.0, 6.0),
        (4000.0, 9.0),
        (6500.0, 9.6),
        (8500.0, 8.2),
        (9500.0, 6.0),
    ],
    idle_rpm: 1600.0,
    launch_rpm: 4000.0,
    max_rpm: 9500.0,
    ratios: &[2.6, 2.0, 1.55, 1.2, 0.95, 0.8],
    reverse_ratio: 2.6,
    final_ratio: 8.5,
    drag_nm_s: 0.004,
    inertia_kgm2: 0.008,
    ..MOTORBIKE
};
pub const LEGS: EngineSpec = EngineSpec {
    torque_curve: &[(0.0, 55.0), (60.0, 45.0), (120.0, 5.0)],
    idle_rpm: 0.0,
    launch_rpm: 0.0,
    max_rpm: 120.0,
    ratios: &[0.9, 0.6, 0.42],
    down_ratio: 0.38,
    up_ratio: 0.8,
    reverse_ratio: 0.9,
    final_ratio: 1.0,
    efficiency_ratio: 0.95,
    shift_secs: 0.2,
    drag_nm_s: 0.0,
    inertia_kgm2: 0.02,
};
