//! How a world is made from a map.

/// How a world is made from a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImportOptions {
    /// Longest distance between two rows of the road surface, metres.
    pub vertex_distance_m: f64,
    /// Height of walls along the outer edges of roads, metres; 0 for none.
    pub wall_height_m: f64,
    /// Metres by which lanes in junctions are wider.
    pub junction_extra_m: f64,
    /// Whether meshes are made for cameras; the solid triangles are made either way.
    pub visible: bool,
    /// Whether houses, trees and lamps stand beside the roads.
    pub roadside: bool,
}

impl Default for ImportOptions {
    fn default() -> Self {
        ImportOptions {
            vertex_distance_m: 6.0,
            wall_height_m: 0.0,
            junction_extra_m: 0.0,
            visible: true,
            roadside: true,
        }
    }
}
