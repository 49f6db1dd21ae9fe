//! The graph as a picture. Dagre's algorithm places boxes in layers from left to right and leads
//! arrows round them; here they are only drawn.

use dagre::graph::{Graph as Layers, GraphOptions};
use dagre::{EdgeLabel, LayoutOptions, NodeLabel, Point, RankDir, layout};

use super::boxes::{Arrow, Box, Flow, Graph, Of};

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

/// Class and colour of a kind of arrow.
fn line_look(flow: Flow) -> (&'static str, &'static str) {
    match flow {
        Flow::Data => ("data", "#56749c"),
        Flow::Documents => ("documents", "#b9c4d2"),
        Flow::Control => ("control", "#a3468f"),
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
        let (from, to) = laid_out(arrow);
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
fn laid_out(arrow: &Arrow) -> (usize, usize) {
    match arrow.flow {
        Flow::Control => (arrow.to, arrow.from),
        Flow::Data | Flow::Documents => (arrow.from, arrow.to),
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
    let mut below = graph.arrows.clone();
    // What matters less lies below.
    below.sort_by_key(|arrow| arrow.flow != Flow::Documents);
    for arrow in &below {
        let (from, to) = laid_out(arrow);
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
        if arrow.flow == Flow::Control {
            points.reverse();
        }
        arrows += &path(&points, arrow.flow);
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
         <defs>{}</defs>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{MARGIN_PX}\" y=\"24\" font-size=\"15\" font-weight=\"bold\">{}</text>\n\
         <g transform=\"translate(0 {TITLE_PX})\">\n{arrows}{boxes}</g>\n{legend}</svg>\n",
        [Flow::Documents, Flow::Data, Flow::Control]
            .map(head)
            .concat(),
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

/// The head of a kind of arrow.
fn head(flow: Flow) -> String {
    let (name, colour) = line_look(flow);
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
fn path(points: &[Point], flow: Flow) -> String {
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
    let (class, colour) = line_look(flow);
    let dashes = match flow {
        Flow::Control => " stroke-dasharray=\"6 4\"",
        Flow::Data | Flow::Documents => "",
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
mod tests;
