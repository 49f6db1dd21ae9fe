//! Small maps written for the tests.

/// One road: its id, junction, links, plan view and lanes.
pub struct RoadText {
    pub id: u32,
    pub junction: i32,
    pub link: String,
    pub length_m: f64,
    pub plan: String,
    pub profiles: String,
    pub lanes: String,
    pub signals: String,
}

impl RoadText {
    /// A road with one lane of 3.5 m in each direction.
    pub fn new(id: u32, length_m: f64, plan: &str) -> RoadText {
        let lane = |id: i8| {
            format!(
                r#"<lane id="{id}" type="driving" level="false"><link/><width sOffset="0" a="3.5" b="0" c="0" d="0"/>
                <roadMark sOffset="0" type="solid" weight="standard" color="white" width="0.15" laneChange="none"/></lane>"#
            )
        };
        let lanes = format!(
            r#"<laneSection s="0"><left>{}</left><center><lane id="0" type="none" level="false"><roadMark sOffset="0" type="broken" color="yellow" width="0.15"/></lane></center><right>{}</right></laneSection>"#,
            lane(1),
            lane(-1)
        );
        RoadText {
            id,
            junction: -1,
            link: String::new(),
            length_m,
            plan: plan.to_owned(),
            profiles: String::new(),
            lanes,
            signals: String::new(),
        }
    }

    pub fn text(&self) -> String {
        format!(
            r#"<road id="{}" length="{}" junction="{}"><link>{}</link><type s="0" type="town"><speed max="50" unit="km/h"/></type>
            <planView>{}</planView>{}<lanes>{}</lanes>{}</road>"#,
            self.id,
            self.length_m,
            self.junction,
            self.link,
            self.plan,
            self.profiles,
            self.lanes,
            self.signals
        )
    }
}

/// `<geometry>` with a shape.
pub fn geometry(s: f64, x: f64, y: f64, hdg: f64, length: f64, shape: &str) -> String {
    format!(r#"<geometry s="{s}" x="{x}" y="{y}" hdg="{hdg}" length="{length}">{shape}</geometry>"#)
}

/// The whole text.
pub fn document(roads: &[RoadText], rest: &str) -> String {
    let roads: String = roads.iter().map(RoadText::text).collect();
    format!(
        r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="test"><geoReference><![CDATA[+proj=tmerc +lat_0=48.5 +lon_0=9.25 +k=1]]></geoReference></header>{roads}{rest}</OpenDRIVE>"#
    )
}

/// A T-junction: road 1 from the west, 2 to the east, 3 from the south; connecting roads 11 (1→2),
/// 12 (2→1), 13 (1→3), 14 (3→2). Roads 1 and 2 meet the junction at x = −10 and x = 10, road 3 at y
/// = −10. A light on road 1 and one on 3, by reference on 13 too.
pub fn t_junction() -> String {
    let half_pi = std::f64::consts::FRAC_PI_2;
    let mut west = RoadText::new(1, 90.0, &geometry(0.0, -100.0, 0.0, 0.0, 90.0, "<line/>"));
    west.link = r#"<successor elementType="junction" elementId="5"/>"#.into();
    west.signals = r#"<signals><signal id="71" name="light" s="88" t="-4" zOffset="5" hOffset="0" dynamic="yes" orientation="+" type="1000001" subtype="-1" country="OpenDRIVE" value="-1" height="1" width="0.4"><validity fromLane="-1" toLane="-1"/></signal></signals>"#.into();
    let mut east = RoadText::new(2, 90.0, &geometry(0.0, 10.0, 0.0, 0.0, 90.0, "<line/>"));
    east.link = r#"<predecessor elementType="junction" elementId="5"/>"#.into();
    let mut south = RoadText::new(
        3,
        90.0,
        &geometry(0.0, 0.0, -100.0, half_pi, 90.0, "<line/>"),
    );
    south.link = r#"<successor elementType="junction" elementId="5"/>"#.into();
    south.signals = r#"<signals><signal id="72" name="light" s="88" t="-4" zOffset="5" dynamic="yes" orientation="+" type="1000001" subtype="-1" country="OpenDRIVE" value="-1"/></signals>"#.into();
    // Each leads lane −1 of its predecessor to a lane of its successor.
    let connecting = |id: u32,
                      plan: String,
                      length: f64,
                      from: (u32, &str, i8),
                      to: (u32, &str, i8)| {
        let mut road = RoadText::new(id, length, &plan);
        road.junction = 5;
        road.link = format!(
            r#"<predecessor elementType="road" elementId="{}" contactPoint="{}"/><successor elementType="road" elementId="{}" contactPoint="{}"/>"#,
            from.0, from.1, to.0, to.1
        );
        road.lanes = format!(
            r#"<laneSection s="0"><center><lane id="0" type="none" level="false"/></center><right><lane id="-1" type="driving" level="false"><link><predecessor id="{}"/><successor id="{}"/></link><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection>"#,
            from.2, to.2
        );
        road
    };
    let straight = geometry(0.0, -10.0, 0.0, 0.0, 20.0, "<line/>");
    let back = geometry(0.0, 10.0, 0.0, std::f64::consts::PI, 20.0, "<line/>");
    let quarter = 10.0 * half_pi;
    let right = geometry(0.0, -10.0, 0.0, 0.0, quarter, r#"<arc curvature="-0.1"/>"#);
    let out = geometry(
        0.0,
        0.0,
        -10.0,
        half_pi,
        quarter,
        r#"<arc curvature="-0.1"/>"#,
    );
    let mut guarded = connecting(13, right, quarter, (1, "end", -1), (3, "end", 1));
    guarded.signals =
        r#"<signals><signalReference s="0" t="-4" id="71" orientation="+"/></signals>"#.into();
    let roads = [
        west,
        east,
        south,
        connecting(11, straight, 20.0, (1, "end", -1), (2, "start", -1)),
        connecting(12, back, 20.0, (2, "start", 1), (1, "end", 1)),
        guarded,
        connecting(14, out, quarter, (3, "end", -1), (2, "start", -1)),
    ];
    let connection = |id: u32, from: u32, over: u32, lane: i8| {
        format!(
            r#"<connection id="{id}" incomingRoad="{from}" connectingRoad="{over}" contactPoint="start"><laneLink from="{lane}" to="-1"/></connection>"#
        )
    };
    let rest = format!(
        r#"<controller name="a" id="1"><control signalId="71" type="0"/></controller><controller name="b" id="2"><control signalId="72" type="0"/></controller>
        <junction id="5" name="T">{}{}{}{}<controller id="1" type="0" sequence="0"/><controller id="2" type="0" sequence="1"/></junction>"#,
        connection(0, 1, 11, -1),
        connection(1, 2, 12, 1),
        connection(2, 1, 13, -1),
        connection(3, 3, 14, -1)
    );
    document(&roads, &rest)
}
