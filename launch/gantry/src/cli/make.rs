//! The word that makes projects: `new`.

use std::path::PathBuf;

use clap::Subcommand;

/// `gantry new`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = "Examples:\n  gantry new consumer ../my_detector --lang python")]
pub struct NewArgs {
    #[command(subcommand)]
    pub word: NewWord,
}

/// What to make.
#[derive(Subcommand, Debug, Clone)]
pub enum NewWord {
    /// A program that reads a camera and publishes boxes, with launch file and tests
    Consumer(ConsumerArgs),
}

const CONSUMER_NOTES: &str = "\
The name is that of the crate or package, of the process in its launch file, and the first part of its
topic. The project gets Gantry's libraries from the checkout that this program was built from, by its path
on this machine, or, in Python and C++, from the package that this program was installed with. For a project
in Rust without a checkout, or one that goes elsewhere, --git names a repository; without --rev it is the
commit of the checkout, which has to be pushed there, or the newest commit.

Examples:
  gantry new consumer ../my_detector --lang python
  gantry new consumer ../planner --lang rust
  gantry new consumer ../tracker --lang cpp
  gantry new consumer planner --lang rust --git https://git.example.org/gantry.git --rev v0.1.0";

/// `gantry new consumer`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = CONSUMER_NOTES)]
pub struct ConsumerArgs {
    /// Folder to make, outside this repository; its last part is the project's name: lower-case
    /// letters, digits and '_'
    #[arg(value_name = "NAME")]
    pub path: PathBuf,
    /// Language
    #[arg(long, value_enum, value_name = "LANGUAGE")]
    pub lang: Lang,
    /// Folder of Gantry's source [default: that from which this program was built]
    #[arg(long, value_name = "DIR", conflicts_with = "git")]
    pub checkout: Option<PathBuf>,
    /// Repository of Gantry's source, instead of a folder
    #[arg(long, value_name = "URL")]
    pub git: Option<String>,
    /// Commit or tag of that repository
    #[arg(long, value_name = "REV", requires = "git")]
    pub rev: Option<String>,
}

/// Language of a new project.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Lang {
    /// A crate on `consumer_kit`.
    Rust,
    /// A package on `gantry`.
    Python,
    /// A project of CMake on `libgantry.so`.
    Cpp,
}
