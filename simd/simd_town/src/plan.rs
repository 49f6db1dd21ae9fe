//! What a town's streets look like before any geometry: nodes, streets between them,
//! cross-sections.
//!
//! A further town is a further function that returns a [`Plan`]; everything behind it is shared.

mod dense_centre;
mod further_towns;
mod large;
mod layout;
mod motorways;
mod sketch;
mod small_towns;

pub use layout::{Edge, Houses, Plan, Profile, Street};

/// Names of the towns that have a plan and scenery by blocks.
pub const NAMES: [&str; 11] = [
    "Town01", "Town02", "Town03", "Town04", "Town05", "Town06", "Town07", "Town08", "Town09",
    "Town10HD", "Town15",
];
/// Names of the large towns, whose scenery is grown along their roads.
pub const LARGE_NAMES: [&str; 3] = ["Town11", "Town12", "Town13"];

/// All names, in their order.
pub fn all_names() -> Vec<&'static str> {
    let mut names: Vec<&str> = NAMES.into_iter().chain(LARGE_NAMES).collect();
    names.sort_unstable();
    names
}

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
        "Town08" => further_towns::rings(name, seed),
        "Town09" => further_towns::hillside(name, seed),
        "Town15" => further_towns::campus(name, seed),
        "Town10HD" => dense_centre::dense_centre(name, seed),
        _ => return large::large(name, seed),
    })
}

#[cfg(test)]
pub(crate) fn plans(seed: u64) -> impl Iterator<Item = Plan> {
    NAMES
        .into_iter()
        .map(move |name| plan_of(name, seed).expect("a name of the list"))
}
