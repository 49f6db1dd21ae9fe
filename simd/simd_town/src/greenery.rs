//! Where trees, bushes, parks and distant woods stand.

mod forest;
mod planting;

pub use forest::build as forest;
pub use planting::{green_gaps, park, street_tree, tree};
