//! Checks of jobs before anything is drawn.

use schema_frames::Modality;

use super::modality::targets_of;
use crate::target::TargetSet;
use crate::view::{Output, ViewJob};

/// Why nothing was drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RenderError {
    /// Cameras do not make this modality.
    #[error("a camera was asked for {:?}, which another kind of sensor makes", modality.name())]
    NotACamera {
        /// What was asked for.
        modality: Modality,
    },
    /// Renderers make colour alone through a calibrated lens.
    #[error("a camera with a calibrated lens was asked for {:?}; only \"rgb\" is rendered through one", modality.name())]
    NotThroughLens {
        /// What was asked for.
        modality: Modality,
    },
    /// A list was asked for twice: only images go to several places.
    #[error("{:?} was asked for twice of one view in one tick; only images go to several places", modality.name())]
    Twice {
        /// What was asked for.
        modality: Modality,
    },
    /// A place is too small.
    #[error("{:?} needs {needed} bytes, but its place has {room}", modality.name())]
    TooSmall {
        /// What was asked for.
        modality: Modality,
        /// Bytes of a frame.
        needed: usize,
        /// Bytes of the place.
        room: usize,
    },
}

/// Whether a job asks for what a camera can give.
pub(super) fn check(job: &ViewJob<'_, '_>) -> Result<(), RenderError> {
    for (i, Output { modality, place }) in job.outputs.iter().enumerate() {
        let modality = *modality;
        if targets_of(modality) == TargetSet::default() {
            return Err(RenderError::NotACamera { modality });
        }
        if job.view.spec.lens.is_some() && modality != Modality::Rgb {
            return Err(RenderError::NotThroughLens { modality });
        }
        let mut before = job.outputs[..i].iter();
        if !modality.is_image() && before.any(|other| other.modality == modality) {
            return Err(RenderError::Twice { modality });
        }
        let (needed, room) = (job.view.payload_bytes(modality), place.capacity_bytes());
        if modality != Modality::Dvs && room < needed {
            return Err(RenderError::TooSmall {
                modality,
                needed,
                room,
            });
        }
    }
    Ok(())
}
