//! Why a task, a course or a call is refused.

use simd_world::{ActorError, LoadError, SpawnError};

/// A task that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// There is no task of this name.
    #[error("there is no built-in task {name:?}; there are {known}")]
    Unknown {
        /// The name.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// The text is no task.
    #[error("the task cannot be read: {0}")]
    Text(#[from] toml::de::Error),
    /// A value that no task can have.
    #[error("task {task:?}: {what} is {value}, allowed is {allowed}")]
    Value {
        /// The task's name.
        task: String,
        /// The key.
        what: &'static str,
        /// Its value.
        value: String,
        /// The allowed values.
        allowed: &'static str,
    },
}

/// A course that cannot be prepared.
#[derive(Debug, thiserror::Error)]
pub enum CourseError {
    /// The town cannot be made.
    #[error(transparent)]
    Town(#[from] simd_town::TownError),
    /// The town cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The town has no roads, or none that the task could begin on.
    #[error("town {town:?} has no {needed} that task {task:?} could begin on; take another town")]
    NoRoute {
        /// The town.
        town: String,
        /// The task.
        task: String,
        /// What it needs.
        needed: String,
    },
    /// An actor cannot be made.
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    /// An actor cannot be put where it begins.
    #[error(transparent)]
    Actor(#[from] ActorError),
}

/// A call that is refused; no world has changed.
#[derive(Debug, thiserror::Error)]
pub enum WorldsError {
    /// A number of worlds or threads that cannot be.
    #[error("{what} is {value}; allowed is {allowed}")]
    Count {
        /// Of what.
        what: &'static str,
        /// The number.
        value: usize,
        /// The allowed numbers.
        allowed: String,
    },
    /// The threads could not be started.
    #[error("cannot start the threads of the worlds: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// An array of another length.
    #[error(
        "{what} has {found} values, but {needed} are needed: {each} for each of {n_worlds} worlds"
    )]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The needed length.
        needed: usize,
        /// Values of one world.
        each: usize,
        /// Number of worlds.
        n_worlds: usize,
    },
    /// An action that is no number.
    #[error(
        "action {index} ({name}) of world {world} is {value}; it must be a finite number, and -1 to 1 is its whole range"
    )]
    Action {
        /// The world.
        world: usize,
        /// Index of the action among the world's.
        index: usize,
        /// Name of the action.
        name: &'static str,
        /// Its value.
        value: f32,
    },
    /// A world that has ended and is not begun anew by itself.
    #[error("the episode of world {world} has ended; reset it before its next step")]
    Ended {
        /// The world.
        world: usize,
    },
    /// A step before the first reset.
    #[error("world {world} was never reset; reset all worlds before the first step")]
    NotReset {
        /// The world.
        world: usize,
    },
    /// A world that is not there.
    #[error("there is no world {world}; there are 0 to {last}")]
    NoWorld {
        /// Its number.
        world: usize,
        /// The last number.
        last: usize,
    },
    /// A panic of the simulator.
    #[error(
        "the simulator broke down in world {world}: {cause}; make new worlds, and please report this with the task and the seed"
    )]
    Broken {
        /// The world.
        world: usize,
        /// What the panic said.
        cause: String,
    },
    /// A call after a panic.
    #[error("the simulator broke down before, and these worlds cannot go on; make new ones")]
    Lost,
}
