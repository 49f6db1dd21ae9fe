//! The words of `gantry sensor`.

use std::path::PathBuf;

use clap::Subcommand;

const SENSOR_EXAMPLES: &str = "\
Examples:
  gantry sensor list
  gantry sensor show ouster/os1-128
  gantry sensor check velodyne/vlp-16";

/// `gantry sensor`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = SENSOR_EXAMPLES)]
pub struct SensorArgs {
    #[command(subcommand)]
    pub word: SensorWord,
}

/// What to do with profiles of sensors.
#[derive(Subcommand, Debug, Clone)]
pub enum SensorWord {
    /// List the profiles that are built in
    #[command(after_help = "Example:\n  gantry sensor list")]
    List,
    /// Print a profile: every number, and whether data sheet, driver, measurement or guess says so
    Show(SensorShowArgs),
    /// Judge what profiles measure by other programs: velodyne-decoder, ouster-sdk and allantools
    Check(SensorCheckArgs),
}

/// `gantry sensor show`.
#[derive(clap::Args, Debug, Clone)]
#[command(
    after_help = "Examples:\n  gantry sensor show velodyne/vlp-16\n  gantry sensor show my_lidar.toml"
)]
pub struct SensorShowArgs {
    /// Name of a profile, or a file that ends in .toml
    #[arg(value_name = "PROFILE")]
    pub profile: String,
}

const CHECK_NOTES: &str = "\
A lidar of the profile, without noise, scans a room. Its returns are packed as the maker packs them, and
read by a program that is not Gantry's. An IMU measures at rest, and its noise is estimated. Then errors are
planted, and each must be found. Exit code 1 if a limit is exceeded or a planted error is not found. The
programs are packages of Python:
pip install velodyne-decoder==3.1.0 ouster-sdk==1.0.1 allantools==2024.6

Examples:
  gantry sensor check velodyne/vlp-16
  gantry sensor check --all --python check-env/bin/python";

/// `gantry sensor check`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = CHECK_NOTES)]
pub struct SensorCheckArgs {
    /// Names of profiles
    #[arg(value_name = "PROFILE", required_unless_present = "all")]
    pub profiles: Vec<String>,
    /// All profiles that are built in
    #[arg(long, conflicts_with = "profiles")]
    pub all: bool,
    /// Python that has the packages [default: .venv here, else python3 on PATH]
    #[arg(long, value_name = "PROGRAM")]
    pub python: Option<PathBuf>,
}
