//! The launch file that most tests run across processes, and its topics.

/// A small rig with cameras, lidars, IMU and GNSS. Images of 96×64 pixels keep software rendering
/// cheap.
pub const SMALL_RIG: &str = r#"version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
vehicles = 4
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[sensor.roof]
kind = "lidar"
rate_hz = 10
channels = 8
columns = 180
mount.position_m = [0.0, 0.0, 2.0]
[sensor.labels]
kind = "lidar"
semantic = true
rate_hz = 10
channels = 4
columns = 90
mount.position_m = [0.0, 0.0, 2.0]
[sensor.imu]
kind = "imu"
rate_hz = 20
[sensor.gnss]
kind = "gnss"
rate_hz = 10
"#;

/// Topics of [`SMALL_RIG`].
pub const SMALL_RIG_TOPICS: [&str; 11] = [
    "ego/front/rgb",
    "ego/front/depth",
    "ego/front/semantic",
    "ego/front/instance",
    "ego/front/flow",
    "ego/front/normals",
    "ego/front/dvs",
    "ego/roof/lidar",
    "ego/labels/semantic_lidar",
    "ego/imu/imu",
    "ego/gnss/gnss",
];
