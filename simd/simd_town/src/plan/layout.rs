//! What a town's streets look like before any geometry: nodes, streets between them,
//! cross-sections.
//!
//! A further town is a further function that returns a [`Plan`]; everything behind it is shared.

use crate::geometry::{Bend, P2, Path};

/// Least length of a street with speed-limit signs in most towns, metres.
pub const SIGNED_FROM_M: f64 = 30.0;

/// What lies between the outermost driving lane and the kerb.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// A strip that nobody uses.
    Gutter,
    /// Parked cars.
    Parking,
}

/// Cross-section of a street, symmetric about its reference line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Driving lanes per direction.
    pub n_lanes: usize,
    /// Width of a driving lane.
    pub lane_m: f64,
    /// What lies beside the driving lanes.
    pub edge: Edge,
    /// Width of that strip.
    pub edge_m: f64,
    /// Width of the pavement.
    pub pavement_m: f64,
    /// Speed limit.
    pub speed_kmh: u32,
    /// Main road: has priority, gets traffic lights.
    pub main: bool,
    /// Grass instead of a pavement; nobody walks here.
    pub verge: bool,
    /// All lanes lead from the start to the end of the street.
    pub one_way: bool,
    /// Carriageway of a motorway: traffic on it never waits.
    pub motorway: bool,
}

impl Profile {
    /// Whether guard rails stand beside it.
    pub fn has_rails(&self) -> bool {
        self.motorway || self.speed_kmh >= 80
    }

    /// Distance of the kerb from the reference line.
    pub fn kerb_m(&self) -> f64 {
        self.driving_m() + self.edge_m
    }

    /// Distance of the outer edge of the driving lanes from the reference line.
    pub fn driving_m(&self) -> f64 {
        self.n_lanes as f64 * self.lane_m * if self.one_way { 0.5 } else { 1.0 }
    }

    /// Left edge of a lane (0 is the leftmost), metres to the right of the reference line as its
    /// drivers see it.
    pub fn lane_left_m(&self, lane: usize) -> f64 {
        lane as f64 * self.lane_m - if self.one_way { self.driving_m() } else { 0.0 }
    }

    /// Distance of the pavement's back from the reference line.
    pub fn back_m(&self) -> f64 {
        self.kerb_m() + self.pavement_m
    }
}

/// Two lanes each way.
pub const AVENUE: Profile = Profile {
    n_lanes: 2,
    lane_m: 3.5,
    edge: Edge::Gutter,
    edge_m: 0.5,
    pavement_m: 4.5,
    speed_kmh: 50,
    main: true,
    verge: false,
    one_way: false,
    motorway: false,
};
/// One lane each way with parked cars.
pub const STREET: Profile = Profile {
    n_lanes: 1,
    lane_m: 3.5,
    edge: Edge::Parking,
    edge_m: 2.5,
    pavement_m: 3.5,
    speed_kmh: 30,
    main: false,
    verge: false,
    one_way: false,
    motorway: false,
};
/// The ring round the town.
pub const RING: Profile = Profile {
    n_lanes: 1,
    lane_m: 3.5,
    edge: Edge::Gutter,
    edge_m: 0.6,
    pavement_m: 3.5,
    speed_kmh: 50,
    main: false,
    verge: false,
    one_way: false,
    motorway: false,
};

/// The fast ring round a town, with three lanes each way.
pub const HIGHWAY: Profile = Profile {
    n_lanes: 3,
    lane_m: 3.6,
    edge: Edge::Gutter,
    edge_m: 1.2,
    pavement_m: 2.5,
    speed_kmh: 90,
    main: true,
    verge: true,
    one_way: false,
    motorway: false,
};

/// What is built in the blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Houses {
    /// Houses of one or two floors with gardens between them.
    Cottages,
    /// Farms and barns far apart.
    Farms,
    /// Houses of two to four floors that stand wall to wall.
    Terraces,
    /// Tall houses within this distance of the origin, houses of three to six floors elsewhere.
    Towers {
        /// Distance from the origin, metres.
        within_m: f64,
    },
}

/// A street from node to node.
#[derive(Clone, Debug, PartialEq)]
pub struct Street {
    /// Index of the node where the reference line begins.
    pub from: usize,
    /// Index of the node where it ends.
    pub to: usize,
    /// Rounded corners on the way.
    pub bends: Vec<Bend>,
    /// Cross-section.
    pub profile: Profile,
    /// The course from node to node; `None` if `bends` describe it.
    pub course: Option<Path>,
    /// Heights on the way: share of the length, and metres over the straight line between the ends.
    pub rises_m: Vec<(f64, f64)>,
    /// Runs through a tunnel.
    pub tunnel: bool,
    /// Where it stands on a bridge deck: metres from the middle of the first node.
    pub bridge_m: Option<(f64, f64)>,
}

impl Street {
    /// A street on level ground.
    pub fn new(from: usize, to: usize, bends: Vec<Bend>, profile: Profile) -> Street {
        Street {
            from,
            to,
            bends,
            profile,
            course: None,
            rises_m: Vec::new(),
            tunnel: false,
            bridge_m: None,
        }
    }
}

impl Street {
    /// The same street from its other end; it must be described by its bends alone.
    pub fn reversed(&self) -> Street {
        let mut bends = self.bends.clone();
        bends.reverse();
        Street {
            from: self.to,
            to: self.from,
            bends,
            ..self.clone()
        }
    }
}

/// The streets of a town.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name.
    pub name: String,
    /// Geographic origin, degrees.
    pub lat_lon_deg: (f64, f64),
    /// Junctions.
    pub nodes_m: Vec<P2>,
    /// Heights of the junctions.
    pub heights_m: Vec<f64>,
    /// Height of the hills round the town.
    pub hills_m: f64,
    /// Streets.
    pub streets: Vec<Street>,
    /// Ponds: middle and radius.
    pub ponds_m: Vec<(P2, f64)>,
    /// Points inside blocks that are parks; all others hold houses.
    pub parks_m: Vec<P2>,
    /// Every junction has traffic lights.
    pub all_lights: bool,
    /// What is built in the blocks.
    pub houses: Houses,
    /// Points inside blocks of cottages, whatever is built elsewhere.
    pub cottages_m: Vec<P2>,
    /// Lawns and trees in the courts of blocks, whatever is built round them.
    pub green_courts: bool,
    /// Least length of a street with speed-limit signs.
    pub limits_from_m: f64,
}
