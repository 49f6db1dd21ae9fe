//! The graph as a picture. Dagre's algorithm places boxes in layers from left to right and leads
//! arrows round them; here they are only drawn.

use dagre::graph::{Graph as Layers, GraphOptions};
use dagre::{EdgeLabel, LayoutOptions, NodeLabel, Point, RankDir, layout};

use super::boxes::{Arrow, Box, Graph, Of};

/// Height of a line of text, pixels.
const LINE_PX: f64 = 16.0;
/// Width of a letter of the fixed-width font, pixels.
const LETTER_PX: f64 = 7.3;
/// Between a box's edge and its text, pixels.
const PADDING_PX: f64 = 10.0;
/// Round the picture, and the height of its title, pixels.
const MARGIN_PX: f64 = 20.0;
const TITLE_PX: f64 = 34.0;
const LEGEND_PX: f64 = 28.0;

/// Look of a kind of box: fill, edge, radius of its corners, name in the legend.
fn look(of: Of) -> (&'static str, &'static str, f64, &'static str) {
    match of {
        Of::Process => ("#ffe9b8", "#b98a1d", 3.0, "process"),
        Of::Topics => ("#d8e8ff", "#4a7ab8", 12.0, "topics"),
        Of::Unread => ("#f4f4f4", "#a0a0a0", 12.0, "topics that nobody reads"),
        Of::Controls => ("#f6dcf1", "#a3468f", 12.0, "to the simulator"),
    }
}

/// An SVG document.
pub fn svg(graph: &Graph) -> String {
    let mut layers: Layers<NodeLabel, EdgeLabel> = Layers::with_options(GraphOptions {
        directed: true,
        multigraph: false,
        compound: false,
    });
    for (number, of) in graph.boxes.iter().enumerate() {
        let (width, height) = size(of);
        let node = NodeLabel {
            width,
            height,
            ..NodeLabel::default()
        };
        layers.set_node(number.to_string(), Some(node));
    }
    for arrow in &graph.arrows {
        let (from, to) = flow(arrow);
        let edge = EdgeLabel {
            // A topic lies near its writer.
            weight: if graph.boxes[arrow.from].of == Of::Process {
                4
            } else {
                1
            },
            ..EdgeLabel::default()
        };
        layers.set_edge(from.to_string(), to.to_string(), Some(edge), None::<&str>);
    }
    let options = LayoutOptions {
        rankdir: RankDir::LR,
        nodesep: 18.0,
        edgesep: 12.0,
        ranksep: 56.0,
        marginx: MARGIN_PX,
        marginy: MARGIN_PX,
        ..LayoutOptions::default()
    };
    if !graph.boxes.is_empty() {
        layout(&mut layers, Some(options));
    }
    draw(graph, &layers)
}

/// Controls run against the flow of data. They are laid out with it, so that the simulator stays on
/// the left, and drawn as they are.
fn flow(arrow: &Arrow) -> (usize, usize) {
    match arrow.control {
        true => (arrow.to, arrow.from),
        false => (arrow.from, arrow.to),
    }
}

fn size(of: &Box) -> (f64, f64) {
    let letters = of
        .lines
        .iter()
        .map(|line| line.chars().count())
        .max()
        .unwrap_or(0);
    (
        letters as f64 * LETTER_PX + 2.0 * PADDING_PX,
        of.lines.len() as f64 * LINE_PX + PADDING_PX,
    )
}

fn draw(graph: &Graph, layers: &Layers<NodeLabel, EdgeLabel>) -> String {
    let mut arrows = String::new();
    let mut far = (0.0f64, 0.0f64);
    let mut reach = |x: f64, y: f64| far = (far.0.max(x), far.1.max(y));
    for arrow in &graph.arrows {
        let (from, to) = flow(arrow);
        let edge = layers.edge(&from.to_string(), &to.to_string(), None::<&str>);
        let (Some(edge), Some(from), Some(to)) =
            (edge, Place::of(layers, from), Place::of(layers, to))
        else {
            continue;
        };
        let mut points = edge.points.clone();
        from.leave_to(&to, &mut points);
        points.iter().for_each(|point| reach(point.x, point.y));
        // Laid out from the simulator, drawn to it.
        if arrow.control {
            points.reverse();
        }
        arrows += &path(&points, arrow.control);
    }
    let mut boxes = String::new();
    for (number, of) in graph.boxes.iter().enumerate() {
        let Some(place) = Place::of(layers, number) else {
            continue;
        };
        let (width, height) = size(of);
        reach(place.x + width / 2.0, place.y + height / 2.0);
        boxes += &drawn_box(of, place.x - width / 2.0, place.y - height / 2.0);
    }
    let (legend, legend_px) = legend(TITLE_PX + far.1 + MARGIN_PX + LINE_PX);
    let title = format!("Domain {}", graph.domain);
    let width = (far.0 + MARGIN_PX).max(legend_px).max(300.0);
    let height = TITLE_PX + far.1 + MARGIN_PX + LEGEND_PX;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"DejaVu Sans Mono, Menlo, Consolas, monospace\" font-size=\"12\">\n\
         <defs>{}{}</defs>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{MARGIN_PX}\" y=\"24\" font-size=\"15\" font-weight=\"bold\">{}</text>\n\
         <g transform=\"translate(0 {TITLE_PX})\">\n{arrows}{boxes}</g>\n{legend}</svg>\n",
        head("data", "#56749c"),
        head("control", "#a3468f"),
        escaped(&title)
    )
}

/// Where a box lies.
struct Place {
    /// Its middle.
    x: f64,
    y: f64,
    half_width: f64,
}

impl Place {
    fn of(layers: &Layers<NodeLabel, EdgeLabel>, number: usize) -> Option<Place> {
        let node = layers.node(&number.to_string())?;
        Some(Place {
            x: node.x?,
            y: node.y?,
            half_width: node.width / 2.0,
        })
    }

    /// Lets a line from here to `to` begin and end at the middles of the sides that face each
    /// other, where arrow heads are seen; the algorithm takes any edge of a box.
    fn leave_to(&self, to: &Place, points: &mut [Point]) {
        let side = if self.x <= to.x { 1.0 } else { -1.0 };
        if let [first, .., last] = points {
            *first = Point::new(self.x + side * self.half_width, self.y);
            *last = Point::new(to.x - side * to.half_width, to.y);
        }
    }
}

fn head(name: &str, colour: &str) -> String {
    format!(
        "<marker id=\"{name}\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" markerWidth=\"7\" markerHeight=\"7\" orient=\"auto\"><path d=\"M0 0 10 5 0 10z\" fill=\"{colour}\"/></marker>"
    )
}

fn drawn_box(of: &Box, x: f64, y: f64) -> String {
    let (width, height) = size(of);
    let (fill, edge, radius, _) = look(of.of);
    let dashes = if of.of == Of::Unread {
        " stroke-dasharray=\"4 3\""
    } else {
        ""
    };
    let mut text = format!(
        "<g><title>{}</title><rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"{radius}\" fill=\"{fill}\" stroke=\"{edge}\"{dashes}/>",
        escaped(&of.all)
    );
    for (i, line) in of.lines.iter().enumerate() {
        let y = y + PADDING_PX / 2.0 + LINE_PX * (i as f64 + 0.75);
        let look = match (of.of, i) {
            (Of::Process, 0) => " font-weight=\"bold\"",
            (Of::Process, _) => " fill=\"#666\"",
            (Of::Unread, _) => " fill=\"#777\"",
            _ => "",
        };
        text += &format!(
            "<text x=\"{:.1}\" y=\"{y:.1}\"{look}>{}</text>",
            x + PADDING_PX,
            escaped(line)
        );
    }
    text + "</g>\n"
}

/// A smooth line through the points, which bends only between them.
fn path(points: &[Point], control: bool) -> String {
    let Some(first) = points.first() else {
        return String::new();
    };
    let mut line = format!("M{:.1} {:.1}", first.x, first.y);
    for pair in points.windows(2) {
        let middle = (pair[0].x + pair[1].x) / 2.0;
        line += &format!(
            " C{middle:.1} {:.1} {middle:.1} {:.1} {:.1} {:.1}",
            pair[0].y, pair[1].y, pair[1].x, pair[1].y
        );
    }
    let (class, colour, dashes) = match control {
        true => ("control", "#a3468f", " stroke-dasharray=\"6 4\""),
        false => ("data", "#56749c", ""),
    };
    format!(
        "<path class=\"{class}\" d=\"{line}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.3\"{dashes} marker-end=\"url(#{class})\"/>\n"
    )
}

/// What the boxes mean, and how far to the right that reaches.
fn legend(y: f64) -> (String, f64) {
    let (mut text, mut x) = (String::new(), MARGIN_PX);
    for of in [Of::Process, Of::Topics, Of::Controls, Of::Unread] {
        let (fill, edge, radius, name) = look(of);
        text += &format!(
            "<rect class=\"legend\" x=\"{x:.1}\" y=\"{:.1}\" width=\"18\" height=\"12\" rx=\"{}\" fill=\"{fill}\" stroke=\"{edge}\"/><text x=\"{:.1}\" y=\"{y:.1}\" fill=\"#444\">{name}</text>\n",
            y - 10.0,
            radius / 2.0,
            x + 24.0
        );
        x += 24.0 + name.chars().count() as f64 * LETTER_PX + 24.0;
    }
    (text, x)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use roxmltree::Document;

    fn boxed(of: Of, name: &str) -> Box {
        Box {
            of,
            lines: vec![name.into()],
            all: name.into(),
        }
    }

    fn arrow(from: usize, to: usize, control: bool) -> Arrow {
        Arrow { from, to, control }
    }

    /// simd → rgb → detector → boxes → view, and detector ⇢ controls ⇢ simd.
    fn pipeline() -> Graph {
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
                arrow(0, 3, false),
                arrow(3, 1, false),
                arrow(1, 4, false),
                arrow(4, 2, false),
                arrow(1, 5, true),
                arrow(5, 0, true),
                arrow(0, 6, false),
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
        for arrow in pipeline().arrows.iter().filter(|arrow| !arrow.control) {
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
                let arrow = arrow(a, b, rng.bool());
                if a % 2 != b % 2 && !graph.arrows.contains(&arrow) {
                    graph.arrows.push(arrow);
                }
            }
            let text = svg(&graph);
            let document = Document::parse(&text).unwrap();
            (0..n).for_each(|i| drop(place(&document, &format!("box {i}"))));
        }
    }
}
