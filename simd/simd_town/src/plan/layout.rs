//! What a town's streets look like before any geometry: nodes, streets between them,
//! cross-sections.
//!
//! A further town is a further function that returns a [`Plan`]; everything behind it is shared.

use crate::geometry::{Bend, P2, Path};
use crate::random::Random;

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
    /// Width of that.
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

/// Three lanes each way round the town, fast.
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
    /// One or two floors, gardens between.
    Cottages,
    /// Farms and barns far apart.
    Farms,
    /// Two to four floors, wall to wall.
    Terraces,
    /// Tall within this distance of the origin, three to six floors elsewhere.
    Towers {
        /// Metres.
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
    /// The whole course from node to node, where `bends` do not say it.
    pub course: Option<Path>,
    /// Heights on the way: share of the length, and metres over the straight line between the ends.
    pub rises_m: Vec<(f64, f64)>,
    /// Runs through a tunnel.
    pub tunnel: bool,
    /// Where it stands on a deck: metres from the middle of the first node.
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
}

const COLUMNS_M: [f64; 6] = [-205.0, -128.0, -48.0, 38.0, 122.0, 205.0];
const ROWS_M: [f64; 6] = [-200.0, -120.0, -38.0, 44.0, 126.0, 200.0];
/// Grid edges that are left out: (column, row) of the first node, and whether it runs along x.
const LEFT_OUT: [(usize, usize, bool); 5] = [
    (1, 1, false),
    (3, 1, true),
    (3, 4, true),
    (1, 4, true),
    (4, 2, false),
];
/// Grid edges that bow: the same and metres to the left.
const BOWED: [(usize, usize, bool, f64); 5] = [
    (1, 2, true, 7.0),
    (4, 1, false, -8.0),
    (3, 4, false, 6.0),
    (0, 3, false, 9.0),
    (3, 0, true, -9.0),
];

/// The dense centre: an irregular grid inside a ring with rounded corners, two avenues crossing.
pub fn dense_centre(name: &str, seed: u64) -> Plan {
    let mut random = Random::new(seed, 0x70, 0);
    let n = COLUMNS_M.len();
    let grid: Vec<P2> = (0..n * n)
        .map(|i| {
            let (c, r) = (i % n, i / n);
            let (jx, jy) = (random.between(-6.0, 6.0), random.between(-6.0, 6.0));
            let inner = |k: usize| k > 0 && k + 1 < n;
            P2::new(
                COLUMNS_M[c] + if inner(c) { jx } else { 0.0 },
                ROWS_M[r] + if inner(r) { jy } else { 0.0 },
            )
        })
        .collect();
    let is_corner =
        |i: usize| (i.is_multiple_of(n) || i % n == n - 1) && (i / n == 0 || i / n == n - 1);
    let (mut nodes_m, mut node_of) = (Vec::new(), vec![usize::MAX; n * n]);
    for i in (0..n * n).filter(|&i| !is_corner(i)) {
        node_of[i] = nodes_m.len();
        nodes_m.push(grid[i]);
    }
    let mut streets = Vec::new();
    for i in 0..n * n {
        for along_x in [true, false] {
            let (c, r) = (i % n, i / n);
            if (along_x && c + 1 == n)
                || (!along_x && r + 1 == n)
                || LEFT_OUT.contains(&(c, r, along_x))
            {
                continue;
            }
            let j = if along_x { i + 1 } else { i + n };
            if !is_corner(i) && !is_corner(j) {
                let bends = bow(&grid, i, j, along_x, n);
                streets.push(Street::new(
                    node_of[i],
                    node_of[j],
                    bends,
                    profile(c, r, along_x, n),
                ));
            }
        }
    }
    for (corner, a, b) in [
        (0, 1, n),
        (n - 1, n - 2, 2 * n - 1),
        (n * (n - 1), n * (n - 2), n * (n - 1) + 1),
        (n * n - 1, n * n - 2, n * (n - 1) - 1),
    ] {
        let bends = vec![Bend {
            corner_m: grid[corner],
            radius_m: 34.0,
        }];
        streets.push(Street::new(node_of[a], node_of[b], bends, RING));
    }
    let middle = |i: usize, j: usize| 0.5 * (grid[i] + grid[j]);
    let parks_m = vec![middle(4 + 2 * n, 4 + 3 * n)];
    let heights_m = vec![0.0; nodes_m.len()];
    Plan {
        name: name.to_owned(),
        lat_lon_deg: (48.137, 11.575),
        nodes_m,
        heights_m,
        hills_m: 0.0,
        streets,
        ponds_m: Vec::new(),
        parks_m,
        all_lights: true,
        houses: Houses::Towers { within_m: 150.0 },
        cottages_m: Vec::new(),
    }
}

fn profile(c: usize, r: usize, along_x: bool, n: usize) -> Profile {
    if (along_x && (r == 0 || r + 1 == n)) || (!along_x && (c == 0 || c + 1 == n)) {
        RING
    } else if (along_x && r == 3) || (!along_x && c == 2) {
        AVENUE
    } else {
        STREET
    }
}

fn bow(grid: &[P2], i: usize, j: usize, along_x: bool, n: usize) -> Vec<Bend> {
    let Some(&(.., aside_m)) = BOWED
        .iter()
        .find(|b| (b.0, b.1, b.2) == (i % n, i / n, along_x))
    else {
        return Vec::new();
    };
    let middle = 0.5 * (grid[i] + grid[j]);
    let across = crate::geometry::left((grid[j] - grid[i]).normalize());
    vec![Bend {
        corner_m: middle + across * aside_m,
        radius_m: 55.0,
    }]
}
