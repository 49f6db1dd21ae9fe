//! The graph in Graphviz's language.

use super::boxes::{Flow, Graph, Of};

/// A `digraph` from left to right.
pub fn dot(graph: &Graph) -> String {
    let mut text = format!(
        "digraph {} {{\n  rankdir=LR;\n  node [fontname=\"sans-serif\" fontsize=11];\n",
        quoted(&graph.domain)
    );
    for (number, of) in graph.boxes.iter().enumerate() {
        let look = match of.of {
            Of::Process => "shape=box style=filled fillcolor=\"#ffe9b8\"",
            Of::Topics => "shape=box style=\"rounded,filled\" fillcolor=\"#d8e8ff\"",
            Of::Unread => "shape=box style=\"rounded,filled,dashed\" fillcolor=\"#f2f2f2\"",
            Of::Controls => "shape=box style=\"rounded,filled\" fillcolor=\"#f3d9ee\"",
        };
        text += &format!(
            "  n{number} [label={} {look}];\n",
            quoted(&of.lines.join("\n"))
        );
    }
    for arrow in &graph.arrows {
        let look = match arrow.flow {
            Flow::Data => "",
            Flow::Documents => " [color=\"#b3bfce\"]",
            Flow::Control => " [style=dashed constraint=false]",
        };
        text += &format!("  n{} -> n{}{look};\n", arrow.from, arrow.to);
    }
    text + "}\n"
}

/// A string of Graphviz's language; a line's end becomes `\n`.
fn quoted(text: &str) -> String {
    let escaped = text
        .replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n");
    format!("\"{escaped}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_and_line_ends_are_escaped() {
        assert_eq!(quoted("a \"b\"\nc\\d"), "\"a \\\"b\\\"\\nc\\\\d\"");
    }
}
