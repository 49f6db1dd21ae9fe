//! What each modality is made from.

use schema_frames::Modality;

use crate::target::{Target, TargetSet};

/// Targets that a modality is made from.
pub(super) fn targets_of(modality: Modality) -> TargetSet {
    match modality {
        Modality::Rgb => Target::Color.bit(),
        Modality::Depth => Target::Depth.bit(),
        Modality::Semantic => Target::Class.bit(),
        Modality::Instance => Target::Instance.bit(),
        Modality::Flow => Target::Flow.bit(),
        Modality::Normals => Target::Normals.bit(),
        Modality::Dvs => [
            Target::Luminance,
            Target::Flow,
            Target::Depth,
            Target::Instance,
            Target::Class,
        ]
        .into_iter()
        .fold(TargetSet::default(), |set, target| set.union(target.bit())),
        _ => TargetSet::default(),
    }
}

/// The target that is the modality's image.
pub(super) fn image_of(modality: Modality) -> Option<Target> {
    match modality {
        Modality::Rgb => Some(Target::Color),
        Modality::Depth => Some(Target::Depth),
        Modality::Semantic => Some(Target::Class),
        Modality::Instance => Some(Target::Instance),
        Modality::Flow => Some(Target::Flow),
        Modality::Normals => Some(Target::Normals),
        _ => None,
    }
}
