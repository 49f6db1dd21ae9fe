//! The picture is parsed: boxes lie apart, arrows are all there, nothing panics.

use super::*;
use roxmltree::Document;

fn boxed(of: Of, name: &str) -> Box {
    Box {
        of,
        lines: vec![name.into()],
        all: name.into(),
    }
}

fn arrow(from: usize, to: usize, flow: Flow) -> Arrow {
    Arrow { from, to, flow }
}

/// simd → rgb → detector → boxes → view, and detector ⇢ controls ⇢ simd.
fn pipeline() -> Graph {
    use Flow::{Control, Data};
    use Of::*;
    let boxes = [
        (Process, "simd"),
        (Process, "detector <1> & \"x\""),
        (Process, "gantry-view"),
        (Topics, "ego/front/rgb"),
        (Topics, "people/boxes"),
        (Controls, "control/vehicles"),
        (Unread, "ego/front/depth"),
    ];
    Graph {
        domain: "lab".into(),
        boxes: boxes.map(|(of, name)| boxed(of, name)).into(),
        arrows: vec![
            arrow(0, 3, Data),
            arrow(3, 1, Data),
            arrow(1, 4, Data),
            arrow(4, 2, Data),
            arrow(1, 5, Control),
            arrow(5, 0, Control),
            arrow(0, 6, Data),
        ],
    }
}

/// Left, top, right and bottom of the rectangle of the box with this tooltip.
fn place(document: &Document, title: &str) -> [f64; 4] {
    let group = document
        .descendants()
        .find(|node| node.has_tag_name("title") && node.text() == Some(title))
        .and_then(|node| node.parent())
        .unwrap_or_else(|| panic!("no box {title:?}"));
    let rect = group
        .children()
        .find(|node| node.has_tag_name("rect"))
        .unwrap();
    let of = |name| rect.attribute(name).unwrap().parse::<f64>().unwrap();
    let (x, y) = (of("x"), of("y"));
    [x, y, x + of("width"), y + of("height")]
}

#[test]
fn boxes_lie_apart_inside_the_picture_and_data_flows_to_the_right() {
    let text = svg(&pipeline());
    let document = Document::parse(&text).unwrap();
    let root = document.root_element();
    let of = |name| root.attribute(name).unwrap().parse::<f64>().unwrap();
    let (width, height) = (of("width"), of("height"));
    let titles: Vec<String> = pipeline().boxes.iter().map(|of| of.all.clone()).collect();
    let places: Vec<[f64; 4]> = titles.iter().map(|title| place(&document, title)).collect();
    for (i, a) in places.iter().enumerate() {
        assert!(
            a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= width && a[3] <= height,
            "{}",
            titles[i]
        );
        for b in &places[..i] {
            let apart = a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1];
            assert!(apart, "{} overlaps", titles[i]);
        }
    }
    for arrow in pipeline()
        .arrows
        .iter()
        .filter(|arrow| arrow.flow != Flow::Control)
    {
        assert!(places[arrow.from][2] < places[arrow.to][0], "{arrow:?}");
    }
    assert!(
        places[0][0] < places[5][0],
        "the simulator is left of its controls"
    );
}

#[test]
fn every_arrow_is_drawn_and_controls_point_back() {
    let text = svg(&pipeline());
    let document = Document::parse(&text).unwrap();
    let paths = |class| {
        let nodes = document.descendants();
        nodes
            .filter(|node| node.attribute("class") == Some(class))
            .collect::<Vec<_>>()
    };
    assert_eq!((paths("data").len(), paths("control").len()), (5, 2));
    for path in paths("control") {
        assert_eq!(path.attribute("marker-end"), Some("url(#control)"));
        assert!(path.attribute("stroke-dasharray").is_some());
        // From right to left: towards the simulator.
        let numbers = |text: &str| text.split([' ', 'M']).find_map(|n| n.parse::<f64>().ok());
        let line = path.attribute("d").unwrap();
        let end = line.rsplit(' ').nth(1).and_then(numbers);
        assert!(numbers(line).unwrap() > end.unwrap(), "{line}");
    }
}

#[test]
fn nothing_and_much_are_drawn_too() {
    let empty = svg(&Graph::default());
    assert!(
        Document::parse(&empty)
            .unwrap()
            .root_element()
            .has_children()
    );
    // Everybody reads and writes everything, in circles.
    let mut rng = fastrand::Rng::with_seed(3);
    for n in [2usize, 9, 40] {
        let mut graph = Graph::default();
        for i in 0..n {
            let of = if i % 2 == 0 { Of::Process } else { Of::Topics };
            graph.boxes.push(boxed(of, &format!("box {i}")));
        }
        for _ in 0..n * 3 {
            let (a, b) = (rng.usize(0..n), rng.usize(0..n));
            let flows = [Flow::Data, Flow::Documents, Flow::Control];
            let arrow = arrow(a, b, flows[rng.usize(0..3)]);
            if a % 2 != b % 2 && !graph.arrows.contains(&arrow) {
                graph.arrows.push(arrow);
            }
        }
        let text = svg(&graph);
        let document = Document::parse(&text).unwrap();
        for i in 0..n {
            place(&document, &format!("box {i}"));
        }
    }
}
