//! What colours mean in the pictures of a task.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use consumer_report::words::escape;
use schema_types::class::{CLASSES, ClassInfo};

use crate::report::types::Report;

/// A sentence, or the classes with their colours.
pub fn legend(report: &Report, task: &str) -> String {
    let scores = || report.runs.iter().flat_map(|run| &run.scores);
    let of_task = || scores().filter(|score| score.task == task);
    let classes: BTreeSet<&str> = of_task()
        .flat_map(|score| score.offline.keys())
        .filter_map(|name| name.strip_prefix("IoU/"))
        .collect();
    if !classes.is_empty() {
        return swatches(&classes);
    }
    let headline = of_task().next().map_or("", |score| score.headline.as_str());
    let sentence = match headline {
        "AbsRel" => "Bright is near, dark is far; black has no depth.",
        "D1" => "Bright is a large disparity, dark a small one; black has none.",
        "Fl" | "EPE" => {
            "The hue is the direction of the flow, the strength its length, full at 20 pixels; black has none."
        }
        "AP" | "HOTA" => "Grey is what the rules of the task leave out.",
        _ => return String::new(),
    };
    format!("<p class=\"soft\">{sentence}</p>\n")
}

fn swatches(names: &BTreeSet<&str>) -> String {
    let mut html = String::from("<p class=\"soft\">");
    for name in names {
        if let Some(ClassInfo { rgb: [r, g, b], .. }) = class(name) {
            let _ = write!(
                html,
                "<span class=\"class\"><span class=\"swatch\" style=\"background:rgb({r},{g},{b})\"></span>{}</span> ",
                escape(name)
            );
        }
    }
    html + "</p>\n"
}

/// The class with this name; people are CARLA's pedestrians.
fn class(name: &str) -> Option<&'static ClassInfo> {
    let plain = |text: &str| text.replace(['_', ' '], "").to_ascii_lowercase();
    let wanted = match plain(name).as_str() {
        "person" => "pedestrians".to_owned(),
        other => other.to_owned(),
    };
    CLASSES.iter().find(|class| {
        let own = plain(class.name);
        own == wanted || format!("{own}s") == wanted || own == format!("{wanted}s")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_found_by_the_names_of_scores() {
        for name in [
            "Roads",
            "RoadLines",
            "car",
            "person",
            "traffic_light",
            "Sky",
        ] {
            assert!(class(name).is_some(), "{name}");
        }
        assert!(class("unicorn").is_none());
    }
}
