//! OpenDRIVE maps: lanes, the lane graph, positions on it, signals and marks.
//!
//! [`RoadMap::parse`] reads a text; everything else is a query. Positions are f64, evaluated from
//! the curves' definitions. World space is OpenDRIVE's inertial space (x east, y north, z up),
//! which is also the simulator's. Superelevation, lateral shape, crossfall and the height of lanes
//! are part of every position.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

// What a file says, and reading it.
mod error;
mod lane;
mod marks;
mod parse;
mod raw;

// Where things lie in the world.
mod curve;
mod lane_shape;
mod lateral;
mod profile;
mod station;

// What belongs together.
mod chords;
mod graph;
mod objects;
mod signals;

// What a caller has.
mod map;
mod positions;
mod surface;
pub mod walkable;

pub use error::{MapError, Severity, Warning};
pub use lane::{Lane, LaneKey, LaneKind, LanePosition};
pub use map::{DEFAULT_GEO_REFERENCE, JunctionInfo, RoadInfo, RoadMap};
pub use marks::{MarkColour, MarkKind, MarkLine, MarkStripe};
pub use objects::{Crosswalk, RoadObject};
pub use parse::xml::MAX_TEXT_BYTES;
pub use raw::JunctionKind;
pub use signals::{Controller, Signal, SignalKind, SignalStop};
pub use surface::{LaneSurface, SectionSurface, SurfaceMark, SurfaceSteps};
