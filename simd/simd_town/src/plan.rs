//! What a town's streets look like before any geometry: nodes, streets between them,
//! cross-sections.
//!
//! A further town is a further function that returns a [`Plan`]; everything behind it is shared.

mod dense_centre;
mod layout;
mod motorways;
mod sketch;
mod small_towns;

pub use layout::{Edge, Houses, Plan, Profile, Street};

/// Names of the towns that have a plan.
pub const NAMES: [&str; 8] = [
    "Town01", "Town02", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10HD",
];

/// The plan of the town of this name.
pub fn plan_of(name: &str, seed: u64) -> Option<Plan> {
    Some(match name {
        "Town01" => small_towns::small_town(name, seed),
        "Town02" => small_towns::compact(name, seed),
        "Town03" => small_towns::roundabouts(name, seed),
        "Town04" => motorways::figure_of_eight(name, seed),
        "Town05" => small_towns::multi_lane_grid(name, seed),
        "Town06" => motorways::long_highways(name, seed),
        "Town07" => small_towns::country(name, seed),
        "Town10HD" => dense_centre::dense_centre(name, seed),
        _ => return None,
    })
}

#[cfg(test)]
pub(crate) fn plans(seed: u64) -> impl Iterator<Item = Plan> {
    NAMES
        .into_iter()
        .map(move |name| plan_of(name, seed).expect("a name of the list"))
}
