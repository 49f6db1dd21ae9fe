//! `gantry doctor`: what this machine lacks.
use launch_cli::{CommonArgs, Exit};
pub fn run(_: &crate::cli::DoctorArgs, _: &CommonArgs) -> anyhow::Result<Exit> {
    Ok(Exit::Done)
}
