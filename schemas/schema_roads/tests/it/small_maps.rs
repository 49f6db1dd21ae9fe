//! Maps of which every position is known in closed form.

use crate::common;

use common::{RoadText, document, geometry, t_junction};
use nalgebra::{Vector2, Vector3};
use schema_roads::walkable::Pavements;
use schema_roads::walkable::stroll::{OnFoot, SeenVehicle, Stroll, StrollStep, StrollView};
use schema_roads::{LaneKey, LanePosition, MapError, RoadMap, SignalKind};
use schema_types::noise::Noise;
use std::f64::consts::{FRAC_PI_2, PI};

fn key(road: u32, lane: i8) -> LaneKey {
    LaneKey {
        road,
        section: 0,
        lane,
    }
}

fn close(a: [f64; 3], b: [f64; 3]) {
    let distance = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    assert!(distance < 1e-9, "{a:?} is not {b:?}");
}

fn at(map: &RoadMap, position: LanePosition) -> ([f64; 3], f64) {
    let pose = map.pose(position).unwrap();
    (
        pose.translation.vector.into(),
        pose.rotation.euler_angles().2,
    )
}

#[test]
fn straight_road_on_a_slope() {
    let mut road = RoadText::new(
        7,
        100.0,
        &geometry(0.0, 10.0, 20.0, FRAC_PI_2, 100.0, "<line/>"),
    );
    road.profiles =
        r#"<elevationProfile><elevation s="0" a="2" b="0.1" c="0" d="0"/></elevationProfile>"#
            .into();
    let map = RoadMap::parse(&document(&[road], "")).unwrap();
    assert!(map.warnings().is_empty(), "{:?}", map.warnings());
    assert_eq!((map.geo_reference(), map.name()), ((48.5, 9.25), "test"));
    // Right-hand traffic: −1 lies to the right of s and drives along it, 1 lies left and drives
    // back.
    let (p, yaw) = at(&map, LanePosition::new(key(7, -1), 30.0));
    close(p, [11.75, 50.0, 5.0]);
    assert!((yaw - FRAC_PI_2).abs() < 1e-9);
    let (p, yaw) = at(
        &map,
        LanePosition {
            lane: key(7, 1),
            s_m: 30.0,
            offset_m: 0.5,
        },
    );
    close(p, [10.0 - 1.75 + 0.5, 90.0, 9.0]);
    assert!((yaw + FRAC_PI_2).abs() < 1e-9);
    let up = map
        .pose(LanePosition::new(key(7, -1), 30.0))
        .unwrap()
        .rotation
        * nalgebra::Vector3::x();
    assert!((up.z - 0.1 / 1.01f64.sqrt()).abs() < 1e-12, "{up}");
    assert!(
        (map.speed_limit_mps(LanePosition::new(key(7, 1), 0.0))
            .unwrap()
            - 50.0 / 3.6)
            .abs()
            < 1e-12
    );
    assert!((map.width_m(LanePosition::new(key(7, 1), 3.0)) - 3.5).abs() < 1e-12);
}

#[test]
fn quarter_circle() {
    let road = RoadText::new(
        1,
        50.0 * FRAC_PI_2,
        &geometry(
            0.0,
            0.0,
            0.0,
            0.0,
            50.0 * FRAC_PI_2,
            r#"<arc curvature="0.02"/>"#,
        ),
    );
    let map = RoadMap::parse(&document(&[road], "")).unwrap();
    for i in 0..=20 {
        let s = 50.0 * FRAC_PI_2 * f64::from(i) / 20.0;
        let (angle, radius) = (s / 50.0, 50.0 + 1.75);
        let (p, yaw) = at(&map, LanePosition::new(key(1, -1), s));
        close(p, [radius * angle.sin(), 50.0 - radius * angle.cos(), 0.0]);
        assert!((yaw - angle).abs() < 1e-9);
        assert!(
            (map.curvature_per_m(LanePosition::new(key(1, -1), s)) - 1.0 / radius).abs() < 1e-12
        );
        // Driven backwards it bends the other way, on the smaller circle.
        assert!((map.curvature_per_m(LanePosition::new(key(1, 1), s)) + 1.0 / 48.25).abs() < 1e-12);
    }
}

#[test]
fn heading_is_the_direction_of_the_middle_also_where_a_lane_widens_on_a_bend() {
    let mut road = RoadText::new(
        1,
        40.0,
        &geometry(0.0, 0.0, 0.0, 0.0, 40.0, r#"<arc curvature="0.04"/>"#),
    );
    road.lanes = r#"<laneOffset s="0" a="0" b="0" c="0.002" d="0"/><laneSection s="0"><left><lane id="1" type="driving"><width sOffset="0" a="2" b="0.05" c="0" d="0"/></lane></left><center><lane id="0" type="none"/></center></laneSection>"#.into();
    let map = RoadMap::parse(&document(&[road], "")).unwrap();
    for i in 1..40 {
        let place = |s: f64| at(&map, LanePosition::new(key(1, 1), s));
        let (s, h) = (f64::from(i), 1e-4);
        let ((a, _), (b, _), (_, yaw)) = (place(s - h), place(s + h), place(s));
        let direction = (b[1] - a[1]).atan2(b[0] - a[0]);
        assert!(
            ((yaw - direction + PI).rem_euclid(2.0 * PI) - PI).abs() < 1e-7,
            "{yaw} {direction}"
        );
    }
}

#[test]
fn superelevation_lifts_the_left_side() {
    let mut road = RoadText::new(1, 10.0, &geometry(0.0, 0.0, 0.0, 0.0, 10.0, "<line/>"));
    road.profiles =
        r#"<lateralProfile><superelevation s="0" a="0.1" b="0" c="0" d="0"/></lateralProfile>"#
            .into();
    let map = RoadMap::parse(&document(&[road], "")).unwrap();
    close(
        at(&map, LanePosition::new(key(1, 1), 5.0)).0,
        [5.0, 1.75 * 0.1f64.cos(), 1.75 * 0.1f64.sin()],
    );
}

#[test]
fn lanes_meet_across_the_junction() {
    let map = RoadMap::parse(&t_junction()).unwrap();
    assert!(map.warnings().is_empty(), "{:?}", map.warnings());
    assert_eq!(map.successors(key(1, -1)), [key(11, -1), key(13, -1)]);
    assert_eq!(map.successors(key(13, -1)), [key(3, 1)]);
    assert_eq!(map.predecessors(key(2, -1)), [key(11, -1), key(14, -1)]);
    assert_eq!(map.successors(key(12, -1)), [key(1, 1)]);
    assert_eq!(map.successors(key(3, 1)), []);
    assert_eq!(
        (
            map.lane(key(13, -1)).unwrap().junction,
            map.lane(key(1, 1)).unwrap().junction
        ),
        (Some(5), None)
    );
    for lane in map.lanes() {
        for next in map.successors(lane.key) {
            let (end, yaw) = at(&map, LanePosition::new(lane.key, lane.length_m));
            let (start, next_yaw) = at(&map, LanePosition::new(*next, 0.0));
            close(end, start);
            assert!(
                ((yaw - next_yaw + PI).rem_euclid(2.0 * PI) - PI).abs() < 1e-9,
                "{} {next}",
                lane.key
            );
            assert!(map.predecessors(*next).contains(&lane.key));
        }
    }
}

#[test]
fn advancing_takes_every_branch_and_goes_back_too() {
    let map = RoadMap::parse(&t_junction()).unwrap();
    let found = map.advance(LanePosition::new(key(1, -1), 80.0), 35.0);
    assert_eq!(
        found,
        [
            LanePosition::new(key(2, -1), 5.0),
            LanePosition::new(key(3, 1), 25.0 - 10.0 * FRAC_PI_2)
        ]
    );
    let back = map.advance(LanePosition::new(key(2, -1), 5.0), -10.0);
    assert_eq!(
        back.iter().map(|p| p.lane).collect::<Vec<_>>(),
        [key(11, -1), key(14, -1)]
    );
    assert!((back[0].s_m - 15.0).abs() < 1e-12);
    assert_eq!(map.advance(LanePosition::new(key(2, -1), 5.0), 1000.0), []);
    assert_eq!(
        map.advance(LanePosition::new(key(2, -1), 5.0), f64::NAN),
        []
    );
}

#[test]
fn lights_say_where_to_stop_on_each_lane() {
    let map = RoadMap::parse(&t_junction()).unwrap();
    let light = &map.signals()[0];
    assert_eq!(
        (light.id.as_str(), light.kind, light.junction),
        ("71", SignalKind::TrafficLight, Some(5))
    );
    let stops: Vec<_> = light
        .stops
        .iter()
        .map(|s| (s.lane, s.stop.lane, s.stop.s_m))
        .collect();
    // On its own road at s; on the connecting road it is named on, at the end of the lane before.
    assert_eq!(
        stops,
        [
            (key(1, -1), key(1, -1), 88.0),
            (key(13, -1), key(1, -1), 90.0)
        ]
    );
    close(light.pose.translation.vector.into(), [-12.0, -4.0, 5.0]);
    let face = light.pose.rotation * nalgebra::Vector3::x();
    assert!(
        (face.x + 1.0).abs() < 1e-9,
        "it looks at the traffic from the west: {face}"
    );
    assert_eq!(map.signal_stops(key(13, -1)).count(), 1);
    let groups: Vec<_> = map
        .controllers()
        .iter()
        .map(|c| (c.id.as_str(), c.junction, c.sequence, c.signals.join(",")))
        .collect();
    assert_eq!(
        groups,
        [
            ("1", Some(5), 0, "71".to_owned()),
            ("2", Some(5), 1, "72".to_owned())
        ]
    );
}

/// Random points within `half_m` of `middle`: no lane passes nearer than the one that is found.
fn assert_nearest_of_everything(map: &RoadMap, middle: [f64; 2], half_m: f64) {
    let mut random = fastrand::Rng::with_seed(3);
    for _ in 0..300 {
        let mut coordinate = |at: f64| at + (random.f64() * 2.0 - 1.0) * half_m;
        let point = [
            coordinate(middle[0]),
            coordinate(middle[1]),
            coordinate(0.0) / half_m,
        ];
        let found = map.nearest(point, |lane| lane.kind.is_drivable()).unwrap();
        let (p, _) = at(
            map,
            LanePosition {
                offset_m: 0.0,
                ..found
            },
        );
        let distance = |q: [f64; 3]| {
            (0..3)
                .map(|i| (q[i] - point[i]).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let best = map
            .lanes()
            .iter()
            .flat_map(|lane| map.centreline(lane.key, 0.02))
            .map(distance)
            .fold(f64::INFINITY, f64::min);
        assert!(
            distance(p) < best + 1e-3,
            "{point:?}: {} to {found:?}, but {best}",
            distance(p)
        );
    }
}

#[test]
fn nearest_agrees_with_a_search_of_everything() {
    let map = RoadMap::parse(&t_junction()).unwrap();
    assert_nearest_of_everything(&map, [0.0, -30.0], 130.0);
    assert_eq!(map.nearest([f64::NAN, 0.0, 0.0], |_| true), None);
    assert_eq!(map.nearest([0.0; 3], |_| false), None);
}

/// Turns as network generators make them: tighter than the lane is wide, and one that comes back
/// upon itself, beside a straight road.
#[test]
fn nearest_agrees_with_a_search_of_everything_where_bends_are_tight() {
    let cubic = |b_u: f64, c_u: f64, c_v: f64| {
        format!(
            r#"<paramPoly3 aU="0" bU="{b_u}" cU="{c_u}" dU="0" aV="0" bV="0" cV="{c_v}" dV="0" pRange="normalized"/>"#
        )
    };
    let roads = [
        RoadText::new(
            1,
            16.3085,
            &geometry(
                0.0,
                0.0,
                0.0,
                -0.27,
                16.3085,
                &cubic(24.336, -19.063, -10.026),
            ),
        ),
        RoadText::new(
            2,
            30.0328,
            &geometry(
                0.0,
                -18.0,
                8.0,
                -0.98,
                30.0328,
                &cubic(61.374, -31.544, -1.276),
            ),
        ),
        RoadText::new(3, 40.0, &geometry(0.0, -20.0, 3.0, 0.0, 40.0, "<line/>")),
    ];
    let map = RoadMap::parse(&document(&roads, "")).unwrap();
    assert_nearest_of_everything(&map, [4.0, -4.0], 16.0);
}

#[test]
fn marks_allow_or_forbid_lane_changes() {
    let lane = |id: i8, mark: &str| {
        format!(
            r#"<lane id="{id}" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/>{mark}</lane>"#
        )
    };
    let mark = |change: &str, s: f64| {
        format!(
            r#"<roadMark sOffset="{s}" type="broken" color="white" width="0.1" laneChange="{change}"/>"#
        )
    };
    let mut road = RoadText::new(1, 40.0, &geometry(0.0, 0.0, 0.0, 0.0, 40.0, "<line/>"));
    road.lanes = format!(
        r#"<laneSection s="0"><center><lane id="0" type="none"/></center><right>{}{}</right></laneSection>"#,
        lane(-1, &(mark("both", 0.0) + &mark("decrease", 20.0))),
        lane(-2, "")
    );
    let map = RoadMap::parse(&document(&[road], "")).unwrap();
    let place = |lane: i8, s: f64| LanePosition::new(key(1, lane), s);
    assert_eq!(
        (
            map.lane(key(1, -1)).unwrap().right,
            map.lane(key(1, -1)).unwrap().left
        ),
        (Some(key(1, -2)), None)
    );
    assert!(map.may_change_right(place(-1, 5.0)) && map.may_change_left(place(-2, 5.0)));
    // Ids fall to the right, so "decrease" lets −1 go to −2 and not back.
    assert!(map.may_change_right(place(-1, 25.0)) && !map.may_change_left(place(-2, 25.0)));
    let lines = map.mark_lines(5.0);
    assert_eq!(lines.len(), 2);
    close(*lines[0].points.last().unwrap(), [20.0, -3.0, 0.0]);
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let error = RoadMap::parse("<OpenDRIVE>\n  <road></raod></OpenDRIVE>").unwrap_err();
    assert!(matches!(error, MapError::Xml { line: 2, .. }), "{error}");
    assert!(
        RoadMap::parse("<osm/>")
            .unwrap_err()
            .to_string()
            .contains("<osm>")
    );
    assert_eq!(RoadMap::parse("<OpenDRIVE/>").unwrap_err(), MapError::Empty);
    let text = document(
        &[RoadText::new(
            1,
            10.0,
            &geometry(0.0, 0.0, 0.0, 0.0, 10.0, "\n<arc curvature=\"x\"/>"),
        )],
        "",
    );
    let map = RoadMap::parse(&text).unwrap();
    assert_eq!(map.warnings()[0].line, Some(3), "{:?}", map.warnings());
    assert!(map.warnings()[0].to_string().contains("curvature=\"x\""));
}

/// The crate `xodr` is another reader of the same format: positions must be the same.
#[test]
fn positions_agree_with_another_reader() {
    let spiral = r#"<spiral curvStart="0" curvEnd="0.05"/>"#;
    let shapes = [
        ("spiral", spiral, 40.0),
        ("arc", r#"<arc curvature="-0.03"/>"#, 55.0),
        ("line", "<line/>", 12.5),
    ];
    for (name, shape, length) in shapes {
        let mut road = RoadText::new(1, length, &geometry(0.0, 3.0, -2.0, 0.4, length, shape));
        road.profiles = r#"<elevationProfile><elevation s="0" a="1" b="0.02" c="0.001" d="0"/></elevationProfile>"#.into();
        let text = document(&[road], "");
        let (ours, theirs) = (
            RoadMap::parse(&text).unwrap(),
            xodr::load_str(&text).unwrap(),
        );
        let lane = theirs
            .lanes()
            .iter()
            .find(|l| theirs.road_lane(l.id).is_some_and(|r| r.od_id == -1))
            .unwrap();
        for i in 0..=10 {
            let s = length * f64::from(i) / 10.0;
            let (p, _) = at(&ours, LanePosition::new(key(1, -1), s));
            let q = theirs
                .lane_point(xodr::LanePosition {
                    lane: lane.id,
                    s,
                    offset: 0.0,
                })
                .unwrap();
            let apart = (p[0] - f64::from(q.x))
                .hypot(p[1] - f64::from(q.y))
                .hypot(p[2] - f64::from(q.z));
            assert!(apart < 2e-3, "{name} at {s}: {p:?} {q:?}");
        }
    }
}

/// A few kilobytes must not become millions of triangles: outlines of many corners, repeated.
#[test]
fn outlines_are_bounded_over_the_whole_map() {
    let corners: String = (0..1000)
        .map(|i| {
            format!(
                r#"<cornerLocal u="{}" v="{}" z="0" height="1"/>"#,
                i % 37,
                i % 41
            )
        })
        .collect();
    let object = |id: usize| {
        let repeats = r#"<repeat s="0" length="90" distance="0.1"/>"#.repeat(60);
        format!(
            r#"<object id="{id}" type="building" s="5" t="20">{repeats}<outline>{corners}</outline></object>"#
        )
    };
    let mut road = RoadText::new(7, 100.0, &geometry(0.0, 10.0, 20.0, 0.0, 100.0, "<line/>"));
    road.signals = format!(
        "<objects>{}</objects>",
        (0..12).map(object).collect::<String>()
    );
    let map = RoadMap::parse(&document(&[road], "")).unwrap();
    let n_corners: usize = map
        .objects()
        .iter()
        .map(|object| object.outline.len())
        .sum();
    assert!((400_000..=500_000).contains(&n_corners), "{n_corners}");
    assert!(
        map.warnings()
            .iter()
            .any(|warning| warning.to_string().contains("500000 corners")),
        "{:?}",
        map.warnings()
    );
}

/// RoadRunner's files as CARLA reads them: `+` is for lanes with positive ids, headings count from
/// the road's direction, and objects called `Speed_NN` are speed limits.
#[test]
fn signals_of_road_runner_face_the_traffic_of_the_lanes_that_they_name() {
    let plan = geometry(0.0, 0.0, 0.0, 0.0, 100.0, "<line/>");
    let mut road = RoadText::new(1, 100.0, &plan);
    let signal = |id: u32, t: f64, orientation: &str, heading: f64, validity: &str| {
        format!(
            r#"<signal id="{id}" name="Sign_Stop" s="60" t="{t}" zOffset="2" hOffset="{heading}" dynamic="no" orientation="{orientation}" type="206" subtype="-1" country="OpenDRIVE" value="-1">{validity}</signal>"#
        )
    };
    let lane = |id: i8| format!(r#"<validity fromLane="{id}" toLane="{id}"/>"#);
    road.signals = format!(
        r#"<objects><object id="9" name="Speed_30" s="20" t="-5" zOffset="0.1" hdg="0" orientation="-" type="-1"/></objects><signals>{}{}{}</signals>"#,
        signal(1, -4.0, "-", 0.0, &lane(-1)),
        signal(2, 4.0, "+", PI, &lane(1)),
        signal(3, 4.0, "+", PI, &lane(0)),
    );
    let header = |text: String| {
        text.replace(
            r#"name="test">"#,
            r#"name="test" vendor="VectorZero"><userData><vectorScene program="RoadRunner"/></userData>"#,
        )
    };
    let map = RoadMap::parse(&header(document(&[road], ""))).unwrap();
    let [limit, stop, other_way, nobody] =
        ["9", "1", "2", "3"].map(|id| map.signals().iter().find(|signal| signal.id == id).unwrap());
    assert_eq!(
        (limit.kind, limit.value),
        (SignalKind::SpeedLimit, Some(30.0))
    );
    let stops = |signal: &schema_roads::Signal| -> Vec<(i8, f64)> {
        let stops = signal.stops.iter();
        stops
            .map(|stop| (stop.stop.lane.lane, stop.stop.s_m))
            .collect()
    };
    // Lane −1 drives along s, lane 1 against it: 100 m − 60 m after its start.
    assert_eq!(stops(limit), [(-1, 20.0)]);
    assert_eq!(stops(stop), [(-1, 60.0)]);
    assert_eq!(stops(other_way), [(1, 40.0)]);
    assert_eq!(stops(nobody), []);
    // Faces look against the traffic: towards −x for lane −1, towards +x for lane 1.
    let face = |signal: &schema_roads::Signal| signal.pose.rotation * nalgebra::Vector3::x();
    for (signal, x) in [(limit, -1.0), (stop, -1.0), (other_way, 1.0)] {
        assert!((face(signal).x - x).abs() < 1e-9, "{}", signal.id);
    }
    assert!(map.objects().is_empty(), "a sign is no object too");
}

#[test]
fn lights_of_a_junction_take_turns_by_controllers() {
    let map = RoadMap::parse(&t_junction()).unwrap();
    let groups = map.light_groups();
    assert_eq!(groups.len(), 1);
    assert_eq!(groups[0].junction, Some(5));
    let ids: Vec<Vec<&str>> = groups[0]
        .turns
        .iter()
        .map(|turn| {
            turn.iter()
                .map(|idx| map.signals()[*idx].id.as_str())
                .collect()
        })
        .collect();
    assert_eq!(ids, [["71"], ["72"]]);
    // Without its controller a light has a turn of its own there, behind the others.
    let text = t_junction().replace(r#"<control signalId="71" type="0"/>"#, "");
    let map = RoadMap::parse(&text).unwrap();
    let groups = map.light_groups();
    assert_eq!((groups.len(), groups[0].turns.len()), (1, 2));
    assert_eq!(map.signals()[groups[0].turns[1][0]].id, "71");
}

/// A street with pavements on both sides, joined by a crosswalk without lights at x = 50.
fn street_with_crosswalk() -> RoadMap {
    let lane = |id: i8, kind: &str, width_m: f64| {
        format!(
            r#"<lane id="{id}" type="{kind}"><width sOffset="0" a="{width_m}" b="0" c="0" d="0"/></lane>"#
        )
    };
    let mut road = RoadText::new(1, 100.0, &geometry(0.0, 0.0, 0.0, 0.0, 100.0, "<line/>"));
    road.lanes = format!(
        r#"<laneSection s="0"><left>{}{}</left><center><lane id="0" type="none"/></center><right>{}{}</right></laneSection>"#,
        lane(2, "sidewalk", 3.0),
        lane(1, "driving", 3.5),
        lane(-1, "driving", 3.5),
        lane(-2, "sidewalk", 3.0)
    );
    let corner =
        |id: u32, u: f64, v: f64| format!(r#"<cornerLocal id="{id}" u="{u}" v="{v}" z="0"/>"#);
    road.signals = format!(
        r#"<objects><object id="9" type="crosswalk" s="50" t="0" zOffset="0" hdg="0"><outline>{}{}{}{}</outline></object></objects>"#,
        corner(0, -2.0, -4.5),
        corner(1, 2.0, -4.5),
        corner(2, 2.0, 4.5),
        corner(3, -2.0, 4.5)
    );
    RoadMap::parse(&document(&[road], "")).unwrap()
}

#[test]
fn a_stroller_crosses_in_a_gap_and_never_before_a_vehicle_that_comes() {
    let map = street_with_crosswalk();
    let ground = Pavements::new(&map, false);
    let vehicle = |speed_mps: f64| SeenVehicle {
        middle_m: Vector3::new(20.0, -1.75, 0.0),
        velocity_mps: Vector3::new(speed_mps, 0.0, 0.0),
        half_length_m: 2.3,
        obstacle: None,
    };
    // Steps on the carriageway in 200 s of strolling.
    let n_on_road = |vehicles: &[SeenVehicle]| {
        let view = StrollView {
            ground: &ground,
            vehicles,
            is_red: &|_| true,
        };
        let (mut stroll, mut at_m, mut n) = (Stroll::new(0), [50.0, 5.0, 0.0], 0);
        for _ in 0..4000 {
            let me = OnFoot {
                at_m,
                radius_m: 0.3,
                crosses_anywhere: false,
            };
            let lot = |n_ways: u64| Noise::new(3, 1, n_ways).uniform(0);
            if let StrollStep::Ahead(to) | StrollStep::Around(to) =
                view.step(&me, &mut stroll, 0.05, lot)
            {
                let way = to - Vector2::new(at_m[0], at_m[1]);
                let step = way * (0.07 / way.norm().max(0.07));
                at_m = [at_m[0] + step.x, at_m[1] + step.y, 0.0];
            }
            n += usize::from(at_m[1].abs() < 3.0);
        }
        n
    };
    assert!(n_on_road(&[]) > 100, "{} steps", n_on_road(&[]));
    assert!(
        n_on_road(&[vehicle(0.0)]) > 100,
        "one that stands is no danger"
    );
    assert_eq!(n_on_road(&[vehicle(10.0)]), 0);
}
