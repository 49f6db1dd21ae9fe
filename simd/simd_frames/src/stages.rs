//! Stages of a tick's frames, whose processor time is counted always; `gantry bench tick --profile`
//! shows them. What runs in a sensor's own tasks is counted there.

use schema_stages::Stage;

/// Everything that is recorded and handed to the GPU for the images of a tick.
pub static RECORD: Stage = Stage::new("record");
/// Waiting for the GPU, and bringing its images into their loans.
pub static READBACK: Stage = Stage::new("readback");
/// Lidars on the thread that fires them.
pub static LIDAR: Stage = Stage::new("lidar");
/// Cameras with a lens, whose rays the processor casts.
pub static LENS: Stage = Stage::new("lens");
/// Other sensors that the processor makes.
pub static OTHER_SENSORS: Stage = Stage::new("other sensors");
/// Sending frames and waking who waits for them.
pub static PUBLISH: Stage = Stage::new("publish");
