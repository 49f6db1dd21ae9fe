//! Colour through a calibrated lens: pinhole faces that together hold all that the lens sees, and the
//! pass that takes each pixel of the picture from the face that shows its direction.

mod pass;
mod plan;

pub(crate) use pass::{FACES_WGSL, FacePass, FaceTable};
pub(crate) use plan::FacePlan;
