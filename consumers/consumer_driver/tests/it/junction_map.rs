//! One junction of straight roads, written for the tests: arms at any angle, one lane of 3.5 m each
//! way, 50 km/h, right-hand traffic.

use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;
use std::sync::Arc;

use consumer_driver::plane::wrap;
use schema_roads::RoadMap;

pub const LIMIT_MPS: f64 = 50.0 / 3.6;
/// Half a lane: how far right of the reference line traffic drives, metres.
pub const HALF_LANE_M: f64 = 1.75;
/// Length of an arm, metres.
const ARM_M: f64 = 300.0;

/// Arms of a crossing, by the side on which they lie.
pub const EAST: Arm = Arm::new(0.0);
pub const NORTH: Arm = Arm::new(FRAC_PI_2);
pub const WEST: Arm = Arm::new(PI);
pub const SOUTH: Arm = Arm::new(-FRAC_PI_2);

/// A road that ends at the junction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Direction in which it lies from the middle of the junction, radians.
    pub outwards_rad: f64,
    /// OpenDRIVE's type code of the signal at its stop line.
    pub signal: Option<&'static str>,
}

pub const YIELD: &str = "205";
pub const STOP: &str = "206";
pub const LIGHT: &str = "1000001";

impl Arm {
    pub const fn new(outwards_rad: f64) -> Arm {
        Arm {
            outwards_rad,
            signal: None,
        }
    }

    pub const fn with(self, signal: &'static str) -> Arm {
        Arm {
            signal: Some(signal),
            ..self
        }
    }
}

/// A junction and the ways through it, by index of the arms.
pub struct Junction {
    pub arms: Vec<Arm>,
    pub ways: Vec<(usize, usize)>,
    /// Distance of the arms' ends from the middle, metres.
    pub radius_m: f64,
}

impl Junction {
    /// Where a vehicle is that drives towards the junction, `before_m` before it: position, heading.
    pub fn inbound(&self, arm: usize, before_m: f64) -> ([f64; 2], f64) {
        let heading = wrap(self.arms[arm].outwards_rad + PI);
        (self.beside(arm, self.radius_m + before_m, heading), heading)
    }

    fn beside(&self, arm: usize, out_m: f64, heading_rad: f64) -> [f64; 2] {
        let (sin, cos) = self.arms[arm].outwards_rad.sin_cos();
        let (right_sin, right_cos) = (heading_rad - FRAC_PI_2).sin_cos();
        [
            out_m * cos + HALF_LANE_M * right_cos,
            out_m * sin + HALF_LANE_M * right_sin,
        ]
    }

    pub fn roads(&self) -> Arc<RoadMap> {
        let text = self.text();
        let roads = RoadMap::parse(&text).unwrap();
        assert!(roads.warnings().is_empty(), "{:?}", roads.warnings());
        Arc::new(roads)
    }

    fn text(&self) -> String {
        let mut roads = String::new();
        for (idx, arm) in self.arms.iter().enumerate() {
            let (sin, cos) = arm.outwards_rad.sin_cos();
            let far_m = self.radius_m + ARM_M;
            let plan = geometry(
                [far_m * cos, far_m * sin],
                arm.outwards_rad + PI,
                ARM_M,
                0.0,
            );
            let signals = arm.signal.map_or(String::new(), |code| {
                let dynamic = if code == LIGHT { "yes" } else { "no" };
                format!(
                    r#"<signals><signal id="{id}" name="at {idx}" s="{s}" t="-4" zOffset="3" dynamic="{dynamic}" orientation="+" type="{code}" subtype="-1" country="OpenDRIVE" value="-1"><validity fromLane="-1" toLane="-1"/></signal></signals>"#,
                    id = signal_id(idx),
                    s = ARM_M - 0.2,
                )
            });
            let lane = |id: i8| {
                format!(
                    r#"<lane id="{id}" type="driving" level="false"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>"#
                )
            };
            let lanes = format!(
                r#"<left>{}</left><center><lane id="0" type="none" level="false"/></center><right>{}</right>"#,
                lane(1),
                lane(-1)
            );
            let link = r#"<successor elementType="junction" elementId="5"/>"#;
            road(
                &mut roads,
                (idx + 1, -1, ARM_M),
                link,
                &plan,
                &lanes,
                &signals,
            );
        }
        let mut connections = String::new();
        for (number, (from, to)) in self.ways.iter().copied().enumerate() {
            let heading = wrap(self.arms[from].outwards_rad + PI);
            let turn = wrap(self.arms[to].outwards_rad - heading);
            // An arc that touches both reference lines at the same distance from the middle.
            let (length, curvature) = if turn.abs() < 1e-6 {
                (2.0 * self.radius_m, 0.0)
            } else {
                let bend_m = self.radius_m / (0.5 * turn.abs()).tan();
                (bend_m * turn.abs(), turn.signum() / bend_m)
            };
            let (sin, cos) = self.arms[from].outwards_rad.sin_cos();
            let start = [self.radius_m * cos, self.radius_m * sin];
            let plan = geometry(start, heading, length, curvature);
            let link = format!(
                r#"<predecessor elementType="road" elementId="{}" contactPoint="end"/><successor elementType="road" elementId="{}" contactPoint="end"/>"#,
                from + 1,
                to + 1
            );
            let lanes = r#"<center><lane id="0" type="none" level="false"/></center><right><lane id="-1" type="driving" level="false"><link><predecessor id="-1"/><successor id="1"/></link><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>"#;
            let id = 100 + number;
            road(&mut roads, (id, 5, length), &link, &plan, lanes, "");
            let _ = write!(
                connections,
                r#"<connection id="{number}" incomingRoad="{}" connectingRoad="{id}" contactPoint="start"><laneLink from="-1" to="-1"/></connection>"#,
                from + 1
            );
        }
        format!(
            r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="test"/>{roads}<junction id="5" name="J">{connections}</junction></OpenDRIVE>"#
        )
    }
}

/// OpenDRIVE's id of the signal of an arm.
pub fn signal_id(arm: usize) -> String {
    format!("{}", 70 + arm)
}

/// A road of 800 m from the origin to the east without a junction.
pub fn straight_road() -> Arc<RoadMap> {
    let mut text = String::new();
    let lane = |id: i8| {
        format!(
            r#"<lane id="{id}" type="driving" level="false"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>"#
        )
    };
    let lanes = format!(
        r#"<left>{}</left><center><lane id="0" type="none" level="false"/></center><right>{}</right>"#,
        lane(1),
        lane(-1)
    );
    let plan = geometry([0.0, 0.0], 0.0, 800.0, 0.0);
    road(&mut text, (1, -1, 800.0), "", &plan, &lanes, "");
    let text = format!(
        r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="test"/>{text}</OpenDRIVE>"#
    );
    Arc::new(RoadMap::parse(&text).unwrap())
}

fn geometry([x, y]: [f64; 2], heading_rad: f64, length_m: f64, curvature_per_m: f64) -> String {
    let shape = if curvature_per_m == 0.0 {
        "<line/>".to_owned()
    } else {
        format!(r#"<arc curvature="{curvature_per_m}"/>"#)
    };
    format!(
        r#"<planView><geometry s="0" x="{x}" y="{y}" hdg="{heading_rad}" length="{length_m}">{shape}</geometry></planView>"#
    )
}

fn road(
    text: &mut String,
    (id, junction, length_m): (usize, i32, f64),
    link: &str,
    plan: &str,
    lanes: &str,
    signals: &str,
) {
    let _ = write!(
        text,
        r#"<road id="{id}" length="{length_m}" junction="{junction}"><link>{link}</link><type s="0" type="town"><speed max="50" unit="km/h"/></type>{plan}<lanes><laneSection s="0">{lanes}</laneSection></lanes>{signals}</road>"#
    );
}
