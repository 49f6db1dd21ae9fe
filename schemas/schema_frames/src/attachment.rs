//! How an attached actor follows its parent.

use serde::{Deserialize, Serialize};

/// How a sensor follows its parent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attachment {
    /// Exactly, every tick.
    #[default]
    Rigid,
    /// On a boom that lags, hangs 0.3 m higher and shortens before obstacles.
    SpringArm,
    /// On a boom that lags and passes through everything.
    SpringArmGhost,
}
