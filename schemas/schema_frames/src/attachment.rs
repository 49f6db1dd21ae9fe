//! How an attached actor follows its parent.

use serde::{Deserialize, Serialize};

/// How a sensor follows its parent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attachment {
    /// The sensor keeps its mount exactly, in every tick.
    #[default]
    Rigid,
    /// A boom holds the sensor 0.3 m higher, lags behind, and shortens in front of obstacles.
    SpringArm,
    /// A boom that lags behind and passes through obstacles.
    SpringArmGhost,
}
