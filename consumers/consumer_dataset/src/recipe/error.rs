//! Why a recipe makes no data set.

use launch_spec::presets::PresetError;

/// Why a recipe makes no data set.
#[derive(Debug, thiserror::Error)]
pub enum RecipeError {
    /// Another version of recipes.
    #[error("version = {0} is not known; this program reads version = 1")]
    Version(u32),
    /// A number outside of its range.
    #[error("{key} = {value}; it lies in {least} to {most}")]
    Range {
        /// Its key.
        key: &'static str,
        /// What it is.
        value: f64,
        /// What it is at least.
        least: f64,
        /// What it is at most.
        most: f64,
    },
    /// A scenario of so many recorded ticks.
    #[error("frames = {0}; a scenario has 1 to 1000000 recorded ticks")]
    Frames(u64),
    /// Why the split cannot be read.
    #[error("split: {0}")]
    Split(String),
    /// No rig.
    #[error("there is no [rig.NAME]; a set needs at least one sensor")]
    NoRig,
    /// This key of the matrix has no value.
    #[error("matrix.{0} is empty; give at least one")]
    Empty(&'static str),
    /// A rig whose name is not safe in paths.
    #[error("the rig {0:?} needs a name of 1 to 64 letters, digits, '-' or '_'")]
    RigName(String),
    /// A weather or a time of day that there is not.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// A rig of the matrix that there is not.
    #[error("matrix.rigs names {name:?}; there is {known}")]
    UnknownRig {
        /// What was asked for.
        name: String,
        /// All that there are.
        known: String,
    },
    /// More combinations than this.
    #[error("the matrix has more than {0} scenarios; make several sets")]
    TooMany(usize),
    /// Rules leave no combination.
    #[error("every scenario of the matrix is excluded")]
    AllExcluded,
    /// A rule that would silently do nothing.
    #[error("a rule names {key} = {value}, which is not in the matrix; there is {known}")]
    Rule {
        /// Key of the matrix.
        key: &'static str,
        /// The value that the rule names.
        value: String,
        /// Values that the matrix has.
        known: String,
    },
    /// A format that there is not.
    #[error("there is no format {name:?}; there is {known}")]
    Format {
        /// What was asked for.
        name: String,
        /// All that there are.
        known: String,
    },
    /// Keyframes are counted from 1.
    #[error("export.every is 0; it counts keyframes from 1")]
    Every,
    /// A folder whose name is not safe, or taken.
    #[error(
        "the folder {name:?} of an export needs a name of letters, digits, '-' or '_', and not {taken}"
    )]
    Folder {
        /// Its name.
        name: String,
        /// Names that are taken.
        taken: String,
    },
    /// Two exports that would write to one folder.
    #[error("two exports go to the folder {0:?}; give one of them `folder = …`")]
    SameFolder(String),
    /// Neither exports nor recordings.
    #[error("nothing would be left: give an [[export]] with a format, or keep_recordings = true")]
    Nothing,
}
