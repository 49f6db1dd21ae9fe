//! Lanes as callers see them: names, kinds, neighbours, and places on them.

/// A lane of one section of one road.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LaneKey {
    /// OpenDRIVE's road id if that is a number; otherwise a number above all such ids, assigned
    /// here.
    pub road: u32,
    /// Index of the lane section along the road.
    pub section: u16,
    /// OpenDRIVE's lane id; never 0.
    pub lane: i8,
}

impl std::fmt::Display for LaneKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "road {} section {} lane {}",
            self.road, self.section, self.lane
        )
    }
}

/// A place on a lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LanePosition {
    /// The lane.
    pub lane: LaneKey,
    /// Distance from the lane's start in its driving direction, metres along the road's reference
    /// line.
    pub s_m: f64,
    /// Distance from the lane's middle, metres, positive to the left of the driving direction.
    pub offset_m: f64,
}

impl LanePosition {
    /// The place on the middle of `lane`, `s_m` after its start.
    pub fn new(lane: LaneKey, s_m: f64) -> Self {
        LanePosition {
            lane,
            s_m,
            offset_m: 0.0,
        }
    }
}

/// What a lane is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LaneKind {
    /// For cars; ramps and slip lanes are included.
    Driving,
    /// For traffic in both directions, e.g. a shared turning lane.
    Bidirectional,
    /// Hard shoulder.
    Shoulder,
    /// Soft edge.
    Border,
    /// For stopping in an emergency.
    Stop,
    /// Parking.
    Parking,
    /// Cycle lane.
    Biking,
    /// Pavement.
    Sidewalk,
    /// Kerb.
    Kerb,
    /// The strip between two carriageways.
    Median,
    /// Closed to traffic.
    Restricted,
    /// Buses only.
    Bus,
    /// Taxis only.
    Taxi,
    /// For trains or trams.
    Rail,
    /// `none` and everything else.
    #[default]
    Other,
}

impl LaneKind {
    pub(crate) fn from_text(text: &str) -> LaneKind {
        match text {
            "driving" | "entry" | "exit" | "onRamp" | "offRamp" | "connectingRamp" | "slipLane"
            | "HOV" | "mwyEntry" | "mwyExit" => LaneKind::Driving,
            "bidirectional" => LaneKind::Bidirectional,
            "shoulder" => LaneKind::Shoulder,
            "border" => LaneKind::Border,
            "stop" => LaneKind::Stop,
            "parking" => LaneKind::Parking,
            "biking" => LaneKind::Biking,
            "sidewalk" | "walking" => LaneKind::Sidewalk,
            "curb" => LaneKind::Kerb,
            "median" => LaneKind::Median,
            "restricted" => LaneKind::Restricted,
            "bus" => LaneKind::Bus,
            "taxi" => LaneKind::Taxi,
            "rail" | "tram" => LaneKind::Rail,
            _ => LaneKind::Other,
        }
    }

    /// Whether an ordinary car may drive on it.
    pub fn is_drivable(self) -> bool {
        matches!(self, LaneKind::Driving | LaneKind::Bidirectional)
    }
}

/// A lane.
#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    /// Name of the lane.
    pub key: LaneKey,
    /// What it is for.
    pub kind: LaneKind,
    /// Length of its section along the reference line, metres.
    pub length_m: f64,
    /// Number of the junction it crosses, if it is on a connecting road.
    pub junction: Option<u32>,
    /// Whether its traffic drives along rising s of the road.
    pub forward: bool,
    /// Station at which its section begins, metres.
    pub section_start_m: f64,
    /// Next lane to the left in driving direction, if its traffic drives the same way. Cars change
    /// only between drivable lanes.
    pub left: Option<LaneKey>,
    /// Next lane to the right in driving direction, if its traffic drives the same way.
    pub right: Option<LaneKey>,
    pub(crate) successors: Vec<LaneKey>,
    pub(crate) predecessors: Vec<LaneKey>,
    pub(crate) road_idx: u32,
}

impl Lane {
    /// Station of the road at `s_m` after the lane's start, metres.
    pub fn station_m(&self, s_m: f64) -> f64 {
        if self.forward {
            self.section_start_m + s_m
        } else {
            self.section_start_m + self.length_m - s_m
        }
    }

    /// Distance of a station of the road from the lane's start, metres.
    pub fn s_at_station_m(&self, station_m: f64) -> f64 {
        if self.forward {
            station_m - self.section_start_m
        } else {
            self.section_start_m + self.length_m - station_m
        }
    }
}
