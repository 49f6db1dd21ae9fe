//! Elements and attributes of OpenDRIVE 1.1 to 1.8. Whatever else a file has is counted, and named
//! once per kind.

use std::collections::BTreeMap;

use roxmltree::Node;

use super::xml::{Reader, tag};

/// Element and its attributes. An element that stands in several places has the attributes of all
/// of them.
const ELEMENTS: &[(&str, &str)] = &[
    ("OpenDRIVE", ""),
    (
        "header",
        "revMajor revMinor name version date north south east west vendor maxRoad maxJunc maxPrg",
    ),
    ("geoReference", ""),
    ("offset", "x y z hdg"),
    ("license", "name resource spdxid text"),
    ("defaultRegulations", ""),
    ("roadRegulations", "type"),
    ("signalRegulations", "type subtype"),
    ("road", "name length id junction rule"),
    ("link", ""),
    (
        "predecessor",
        "elementType elementId contactPoint elementS elementDir id layer",
    ),
    (
        "successor",
        "elementType elementId contactPoint elementS elementDir id layer",
    ),
    ("neighbor", "side elementId direction"),
    ("type", "s type country name width"),
    ("speed", "max unit sOffset type value"),
    ("surface", ""),
    (
        "CRG",
        "file sStart sEnd orientation mode purpose sOffset tOffset zOffset zScale hOffset",
    ),
    ("planView", ""),
    ("geometry", "s x y hdg length"),
    ("line", "length space tOffset sOffset rule width color"),
    ("spiral", "curvStart curvEnd"),
    ("arc", "curvature"),
    ("poly3", "a b c d"),
    ("paramPoly3", "aU bU cU dU aV bV cV dV pRange"),
    ("elevationProfile", ""),
    ("elevation", "s a b c d center left right"),
    ("lateralProfile", ""),
    ("superelevation", "s a b c d"),
    ("crossfall", "side s a b c d"),
    ("shape", "s t a b c d"),
    ("crossSectionSurface", ""),
    ("tOffset", ""),
    ("coefficients", "s a b c d"),
    ("surfaceStrips", ""),
    ("strip", "id mode"),
    ("constant", ""),
    ("linear", ""),
    ("quadratic", ""),
    ("cubic", ""),
    ("lanes", ""),
    ("laneOffset", "s a b c d"),
    ("laneSection", "s singleSide length"),
    ("left", ""),
    ("center", ""),
    ("right", ""),
    (
        "lane",
        "id type level direction advisory dynamicLaneDirection dynamicLaneType roadWorks value unit",
    ),
    ("width", "sOffset a b c d"),
    (
        "border",
        "sOffset a b c d width type outlineId useCompleteOutline",
    ),
    (
        "roadMark",
        "sOffset type weight color material width laneChange height",
    ),
    ("sway", "ds a b c d"),
    ("explicit", ""),
    (
        "material",
        "sOffset surface friction roughness roadMarkColor",
    ),
    ("visibility", "sOffset forward back left right"),
    ("access", "sOffset rule restriction"),
    ("restriction", "type"),
    ("height", "sOffset inner outer"),
    ("rule", "sOffset value"),
    ("objects", ""),
    (
        "object",
        "id name type subtype dynamic s t zOffset validLength orientation hdg pitch roll height length width radius perpToRoad temporary country",
    ),
    (
        "repeat",
        "s length distance tStart tEnd widthStart widthEnd heightStart heightEnd zOffsetStart zOffsetEnd lengthStart lengthEnd radiusStart radiusEnd detachFromReferenceLine",
    ),
    ("outlines", ""),
    ("outline", "id fillType outer closed laneType"),
    ("cornerRoad", "s t dz height id"),
    ("cornerLocal", "u v z height id"),
    ("cornerReference", "id"),
    ("skeleton", ""),
    ("polyline", "id"),
    ("vertexLocal", "u v z id intersectionPoint radius netto"),
    ("vertexRoad", "s t dz id intersectionPoint radius netto"),
    ("validity", "fromLane toLane layer"),
    ("parkingSpace", "access restrictions"),
    ("markings", ""),
    (
        "marking",
        "side weight width color zOffset spaceLength lineLength startOffset stopOffset id",
    ),
    ("borders", ""),
    ("objectReference", "s t id zOffset validLength orientation"),
    ("tunnel", "s length name id type lighting daylight"),
    ("bridge", "s length name id type"),
    ("signals", ""),
    (
        "signal",
        "s t id name dynamic orientation zOffset country countryRevision type subtype value unit height width text hOffset pitch roll length temporary invisible",
    ),
    ("semantics", ""),
    ("priority", "high low type"),
    ("prohibited", ""),
    ("warning", ""),
    ("routing", ""),
    ("streetname", ""),
    ("parking", ""),
    ("tourist", ""),
    ("supplementaryTime", "type value"),
    ("supplementaryAllows", ""),
    ("supplementaryProhibits", ""),
    ("supplementaryDistance", "type value unit"),
    ("supplementaryEnvironment", "type"),
    ("supplementaryExplanatory", ""),
    ("dependency", "id type"),
    ("reference", "elementType elementId type"),
    ("positionRoad", "roadId s t zOffset hOffset pitch roll"),
    ("positionInertial", "x y z hdg pitch roll"),
    ("signalReference", "s t id orientation"),
    ("staticBoard", ""),
    ("vmsBoard", "v z displayType displayWidth displayHeight id"),
    ("displayArea", "index height width v z"),
    ("vmsGroup", "id"),
    ("vmsBoardReference", "signalId vmsIndex groupIndex"),
    (
        "sign",
        "signalId id country countryRevision type subtype value unit width height text length v z",
    ),
    ("controller", "id name sequence type"),
    ("control", "signalId type"),
    ("junction", "id name type mainRoad sStart sEnd orientation"),
    (
        "connection",
        "id type incomingRoad connectingRoad linkedRoad contactPoint connectionMaster",
    ),
    ("laneLink", "from to overlapZone"),
    ("crossPath", "id crossingRoad roadAtStart roadAtEnd"),
    ("startLaneLink", "from to s"),
    ("endLaneLink", "from to s"),
    ("roadSection", "id roadId sStart sEnd length"),
    ("boundary", ""),
    (
        "segment",
        "type roadId boundaryLane sStart sEnd contactPoint jointLaneStart jointLaneEnd transitionLength side",
    ),
    ("elevationGrid", "gridSpacing sStart xStart yStart"),
    ("junctionGroup", "name id type"),
    ("junctionReference", "junction"),
    ("station", "name id type"),
    ("platform", "name id"),
    ("railroad", ""),
    ("switch", "name id position"),
    ("mainTrack", "id s dir"),
    ("sideTrack", "id s dir"),
    ("partner", "name id"),
    ("userData", "code value"),
    ("include", "file"),
    ("dataQuality", ""),
];

/// Elements whose contents OpenDRIVE leaves to the file's maker.
const OPAQUE: [&str; 3] = ["userData", "include", "dataQuality"];
/// Kinds that are named; a file of another format would have thousands.
const MAX_KINDS: usize = 60;
/// Longest name that is repeated.
const MAX_NAME: usize = 40;

/// Warns of each kind of unknown element and attribute once, with its number and first place.
pub(super) fn check(reader: &mut Reader, root: Node) {
    let known: BTreeMap<&str, &str> = ELEMENTS.iter().copied().collect();
    let mut odd: BTreeMap<(String, String), (usize, Node)> = BTreeMap::new();
    let mut open = vec![root];
    while let Some(node) = open.pop() {
        let name = tag(node);
        let Some(attributes) = known.get(name) else {
            let parent = node.parent_element().map_or("", |parent| tag(parent));
            note(
                &mut odd,
                format!("<{}> in <{}>", short(name), short(parent)),
                String::new(),
                node,
            );
            continue;
        };
        for attribute in node.attributes().filter(|a| a.namespace().is_none()) {
            // The list is short; splitting it costs less than a set per element.
            if !OPAQUE.contains(&name)
                && !attributes.split(' ').any(|known| known == attribute.name())
            {
                note(&mut odd, format!("<{name}>"), short(attribute.name()), node);
            }
        }
        if !OPAQUE.contains(&name) {
            // Children are pushed last first, so that the first of a kind is met first.
            let children: Vec<Node> = node.children().filter(Node::is_element).collect();
            open.extend(children.into_iter().rev());
        }
    }
    for ((element, attribute), (n, first)) in odd {
        let times = if n == 1 {
            "once".to_owned()
        } else {
            format!("{n} times, first here")
        };
        if attribute.is_empty() {
            reader.warn(
                first,
                format!("unknown element {element}, {times}; it is left out"),
            );
        } else {
            reader.warn(
                first,
                format!("unknown attribute {attribute} of {element}, {times}; it is left out"),
            );
        }
    }
}

fn note<'a, 'i>(
    odd: &mut BTreeMap<(String, String), (usize, Node<'a, 'i>)>,
    element: String,
    attribute: String,
    node: Node<'a, 'i>,
) {
    let n = odd.len();
    match odd.get_mut(&(element.clone(), attribute.clone())) {
        Some((count, _)) => *count += 1,
        None if n < MAX_KINDS => drop(odd.insert((element, attribute), (1, node))),
        None => {}
    }
}

fn short(name: &str) -> String {
    name.chars().take(MAX_NAME).collect()
}
