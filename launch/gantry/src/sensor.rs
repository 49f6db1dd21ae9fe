//! `gantry sensor`: profiles of sensors as they are sold, what other programs make of their returns,
//! and calibrations in those programs' files.

mod calibration;
mod check;
mod inertial;
mod judge;
mod profile;
mod scan;

use launch_cli::{CommonArgs, Exit};

use crate::cli::{SensorArgs, SensorWord};

/// Runs `gantry sensor`.
pub fn run(args: &SensorArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    match &args.word {
        SensorWord::List => profile::list(),
        SensorWord::Show(args) => profile::show(&args.profile),
        SensorWord::Check(args) => check::run(args),
        SensorWord::Import(args) => calibration::import(args),
        SensorWord::Export(args) => calibration::export(args, common),
    }
}
