//! The words of `gantry sensor`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Subcommand;
use schema_calibration::Format;

const SENSOR_EXAMPLES: &str = "\
Examples:
  gantry sensor list
  gantry sensor show ouster/os1-128
  gantry sensor check velodyne/vlp-16
  gantry sensor import camchain.yaml > rig.toml
  gantry sensor export rig.toml --format ros --sensor cam0";

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
    /// Turn a file of calibration into cameras of a launch file
    Import(SensorImportArgs),
    /// Write the calibration of cameras as another program reads it
    Export(SensorExportArgs),
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

const IMPORT_NOTES: &str = "\
The launch file is printed; include it in one that has a vehicle. Formats: kalibr (camchain.yaml), opencv
(FileStorage), ros (camera_info), nuscenes (calibrated_sensor.json), kitti (calib.txt), kitti360
(image_02.yaml), ncore (f-theta). Principal points get 0.5 more, because Gantry counts from the image's
corner. Of several cameras of Kalibr, places count from the first one.

Examples:
  gantry sensor import camchain.yaml > rig.toml
  gantry sensor import calib.txt --format kitti --size 1242x375 > rig.toml";

/// `gantry sensor import`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = IMPORT_NOTES)]
pub struct SensorImportArgs {
    /// File of calibration
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Its format [default: what it looks like]: kalibr, opencv, ros, nuscenes, kitti, kitti360 or ncore
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    pub format: Option<Format>,
    /// Width and height of the images, where the format does not tell them
    #[arg(long, value_name = "WIDTHxHEIGHT")]
    pub size: Option<SizePx>,
}

const EXPORT_NOTES: &str = "\
The file is printed. A format that has no words for a lens says which it has. Formats: kalibr and nuscenes for
several cameras; opencv, ros, kitti, kitti360 and ncore for one.

Examples:
  gantry sensor export rig.toml --format kalibr > camchain.yaml
  gantry sensor export rig.toml --format opencv --sensor cam0 > cam0.yaml
  gantry sensor export ego/front/rgb --format ros > front.yaml";

/// `gantry sensor export`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = EXPORT_NOTES)]
pub struct SensorExportArgs {
    /// Launch file that ends in .toml, or topic of a camera that runs
    #[arg(value_name = "TOPIC|FILE")]
    pub from: String,
    /// Format to write: kalibr, opencv, ros, nuscenes, kitti, kitti360 or ncore
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    pub format: Format,
    /// Only this camera of the launch file
    #[arg(long, value_name = "NAME")]
    pub sensor: Option<String>,
}

fn format(text: &str) -> Result<Format, String> {
    Format::from_name(text).ok_or_else(|| {
        let known = Format::ALL.map(Format::name).join(", ");
        format!("{text:?} is no format; known are {known}")
    })
}

/// Width and height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SizePx(pub [u32; 2]);

impl FromStr for SizePx {
    type Err = String;

    fn from_str(text: &str) -> Result<SizePx, String> {
        let side = |text: &str| text.parse::<u32>().ok().filter(|it| *it > 0);
        let sides = text
            .split_once('x')
            .and_then(|(width, height)| Some(SizePx([side(width)?, side(height)?])));
        sides.ok_or_else(|| format!("{text:?} is no size; write e.g. 1242x375"))
    }
}
