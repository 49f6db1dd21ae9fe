//! What is computed of trajectories.

/// How results are laid on the truth before the absolute error is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alignment {
    /// Not at all.
    None,
    /// The first pose on the first pose.
    Origin,
    /// So that the squared distances are least, by turning and shifting (Umeyama, 1991).
    #[default]
    Rigid,
    /// The same with a scale, for methods that know lengths only up to a factor.
    Scaled,
}

/// Over what the relative pose error is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// So many pairs of poses.
    Frames(usize),
    /// So many metres of the true path.
    Metres(f64),
}

/// What is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How results are laid on the truth. A scale enters the relative errors too.
    pub alignment: Alignment,
    /// Over what the relative pose error is taken.
    pub step: Step,
    /// Whether a step begins at every pose; otherwise each begins where the one before ended. Over
    /// metres, a step that no pose ends within a tenth of its length is left out then.
    pub all_pairs: bool,
    /// How many poses lie between the beginnings of KITTI's segments.
    pub segment_frames: usize,
}

impl Default for Settings {
    /// Rigid alignment, steps of one frame, and segments from every tenth pose, as KITTI has it.
    fn default() -> Self {
        Self {
            alignment: Alignment::Rigid,
            step: Step::Frames(1),
            all_pairs: false,
            segment_frames: 10,
        }
    }
}
