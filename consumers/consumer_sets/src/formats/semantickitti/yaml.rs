//! SemanticKITTI's label map, with the split of this export.

use std::fmt::Write as _;

use crate::exporter::DoneScenario;

/// Label, name, colour (blue, green, red) and class that is learned.
const LABELS: [(u16, &str, [u8; 3], u8); 34] = [
    (0, "unlabeled", [0, 0, 0], 0),
    (1, "outlier", [0, 0, 255], 0),
    (10, "car", [245, 150, 100], 1),
    (11, "bicycle", [245, 230, 100], 2),
    (13, "bus", [250, 80, 100], 5),
    (15, "motorcycle", [150, 60, 30], 3),
    (16, "on-rails", [255, 0, 0], 5),
    (18, "truck", [180, 30, 80], 4),
    (20, "other-vehicle", [255, 0, 0], 5),
    (30, "person", [30, 30, 255], 6),
    (31, "bicyclist", [200, 40, 255], 7),
    (32, "motorcyclist", [90, 30, 150], 8),
    (40, "road", [255, 0, 255], 9),
    (44, "parking", [255, 150, 255], 10),
    (48, "sidewalk", [75, 0, 75], 11),
    (49, "other-ground", [75, 0, 175], 12),
    (50, "building", [0, 200, 255], 13),
    (51, "fence", [50, 120, 255], 14),
    (52, "other-structure", [0, 150, 255], 0),
    (60, "lane-marking", [170, 255, 150], 9),
    (70, "vegetation", [0, 175, 0], 15),
    (71, "trunk", [0, 60, 135], 16),
    (72, "terrain", [80, 240, 150], 17),
    (80, "pole", [150, 240, 255], 18),
    (81, "traffic-sign", [0, 0, 255], 19),
    (99, "other-object", [255, 255, 50], 0),
    (252, "moving-car", [245, 150, 100], 1),
    (253, "moving-bicyclist", [200, 40, 255], 7),
    (254, "moving-person", [30, 30, 255], 6),
    (255, "moving-motorcyclist", [90, 30, 150], 8),
    (256, "moving-on-rails", [255, 0, 0], 5),
    (257, "moving-bus", [250, 80, 100], 5),
    (258, "moving-truck", [180, 30, 80], 4),
    (259, "moving-other-vehicle", [255, 0, 0], 5),
];

/// The file's text.
pub fn label_map(done: &[DoneScenario]) -> String {
    let mut text =
        String::from("# Labels of the files in sequences/*/labels: the lower 16 bits.\nlabels:\n");
    for (label, name, ..) in LABELS {
        let _ = writeln!(text, "  {label}: \"{name}\"");
    }
    text += "# Blue, green, red.\ncolor_map:\n";
    for (label, _, [b, g, r], _) in LABELS {
        let _ = writeln!(text, "  {label}: [{b}, {g}, {r}]");
    }
    text += "learning_map:\n";
    for (label, .., learned) in LABELS {
        let _ = writeln!(text, "  {label}: {learned}");
    }
    text += "learning_map_inv:\n";
    for class in 0..20u8 {
        let first = LABELS.iter().find(|(.., learned)| *learned == class);
        let label = first.expect("every class has a label").0;
        let _ = writeln!(text, "  {class}: {label}");
    }
    text += "learning_ignore:\n";
    for class in 0..20u8 {
        let _ = writeln!(
            text,
            "  {class}: {}",
            if class == 0 { "True" } else { "False" }
        );
    }
    text += "split:\n";
    let numbers = |is_in: &dyn Fn(&str) -> bool| {
        let numbers = done
            .iter()
            .enumerate()
            .filter(|(_, scenario)| is_in(&scenario.split));
        numbers
            .map(|(index, _)| index.to_string())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let known = ["train", "val", "valid", "test"];
    let _ = writeln!(text, "  train: [{}]", numbers(&|split| split == "train"));
    let _ = writeln!(
        text,
        "  valid: [{}]",
        numbers(&|split| split == "val" || split == "valid")
    );
    let _ = writeln!(text, "  test: [{}]", numbers(&|split| split == "test"));
    let mut others: Vec<&str> = done
        .iter()
        .map(|scenario| scenario.split.as_str())
        .collect();
    others.retain(|split| !known.contains(split));
    others.sort_unstable();
    others.dedup();
    for other in others {
        let _ = writeln!(text, "  {other}: [{}]", numbers(&|split| split == other));
    }
    text
}
