//! OpenDRIVE maps: lanes, the lane graph, positions on it, signals, objects and surfaces.
//!
//! [`RoadMap::parse`] reads a text and leaves out what cannot be used, with a [`Warning`] that
//! names the place in the file; everything else is a question to the [`RoadMap`]. Positions are
//! `f64`, evaluated from the definitions of the curves; superelevation, lateral shape, crossfall
//! and the height of lanes are part of them. World space is OpenDRIVE's inertial space (x east, y
//! north, z up), which is also the simulator's.
//!
//! A position on a lane is a [`LanePosition`]: metres after the lane's start in driving direction,
//! and metres to the left of its middle.
//!
//! ```
//! use schema_roads::{LaneKind, RoadMap};
//!
//! let text = r#"<OpenDRIVE><road id="1" length="100" junction="-1">
//!   <planView><geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry></planView>
//!   <lanes><laneSection s="0">
//!     <center><lane id="0"/></center>
//!     <right><lane id="-1" type="driving">
//!       <width sOffset="0" a="3.5" b="0" c="0" d="0"/>
//!     </lane></right>
//!   </laneSection></lanes>
//! </road></OpenDRIVE>"#;
//! let map = RoadMap::parse(text)?;
//! let at = map
//!     .nearest([40.0, -1.0, 0.0], |lane| lane.kind == LaneKind::Driving)
//!     .expect("the map has a lane for cars");
//! assert!((at.s_m - 40.0).abs() < 1e-6);
//! assert!((at.offset_m - 0.75).abs() < 1e-6);
//! assert_eq!(map.width_m(at), 3.5);
//! # Ok::<(), schema_roads::MapError>(())
//! ```

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
mod light_groups;
mod objects;
mod signals;

// What a caller has.
mod map;
mod positions;
mod spawn_points;
mod surface;
pub mod walkable;

pub use error::{MapError, Severity, Warning};
pub use lane::{Lane, LaneKey, LaneKind, LanePosition};
pub use light_groups::LightGroup;
pub use map::{DEFAULT_GEO_REFERENCE, JunctionInfo, RoadInfo, RoadMap};
pub use marks::{MarkColour, MarkKind, MarkLine, MarkStripe};
pub use objects::{Crosswalk, OutlineCorner, RoadObject};
pub use parse::xml::MAX_TEXT_BYTES;
pub use raw::JunctionKind;
pub use signals::{Controller, Signal, SignalKind, SignalStop};
pub use surface::{LaneSurface, SectionSurface, SurfaceMark, SurfaceSteps};
