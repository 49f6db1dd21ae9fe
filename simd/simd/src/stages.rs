//! Stages of a tick up to its scene, whose processor time is counted always; `gantry bench tick
//! --profile` shows them. Those of frames are in `simd_frames`.

use schema_stages::Stage;

/// Requests of clients, and controls.
pub static COMMANDS: Stage = Stage::new("commands");
/// The world's step: vehicles, people, lights, weather.
pub static PHYSICS: Stage = Stage::new("physics");
/// Snapshot and documents.
pub static SNAPSHOT: Stage = Stage::new("snapshot");
/// What sensors see, made of the world.
pub static SCENE: Stage = Stage::new("scene");
