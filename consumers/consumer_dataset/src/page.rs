//! The summary of a set: `summary.json` for programs, and `index.html` for people. The page is one
//! file and needs nothing from elsewhere.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use consumer_report::numbers::grouped;
use consumer_report::page::{self, Cell, Head, Table, document};
use consumer_report::plot::{Bar, columns, rows};
use consumer_report::words::escape;
use consumer_sets::options::{deal, parse_split};
use serde::Serialize;

use crate::matrix::Scenario;
use crate::recipe::Recipe;
use crate::statistics::{DISTANCE_BIN_M, N_DISTANCES, N_OCCLUSIONS, Statistics};

/// Most pictures of the contact sheet; of a larger set every so many scenarios have one.
const MAX_PICTURES: usize = 200;

/// What is in a set.
#[derive(Clone, Debug, Serialize)]
pub struct Summary<'a> {
    /// Its name.
    pub name: &'a str,
    /// A sentence about it.
    pub description: &'a str,
    /// Version of the program that made it.
    pub version: &'a str,
    /// Formats, by folder.
    pub formats: BTreeMap<&'a str, &'a str>,
    /// Scenarios by part of the set.
    pub parts: BTreeMap<String, u64>,
    /// Everything together; `picture` is empty.
    pub total: Statistics,
    /// Objects in images by weather and time of day, `rain, night`.
    pub by_conditions: BTreeMap<String, Statistics>,
    /// The scenarios in their order.
    pub scenarios: Vec<ScenarioSummary<'a>>,
}

/// A scenario of a set.
#[derive(Clone, Debug, Serialize)]
pub struct ScenarioSummary<'a> {
    /// The scenario.
    #[serde(flatten)]
    pub scenario: &'a Scenario,
    /// Part of the set.
    pub part: String,
    /// What it shows; `picture` is empty.
    pub shows: Statistics,
}

/// Sums up a set.
pub fn summary<'a>(
    recipe: &'a Recipe,
    scenarios: &'a [Scenario],
    statistics: &[Statistics],
) -> Summary<'a> {
    let names: Vec<String> = scenarios.iter().map(|it| it.name.clone()).collect();
    let split = parse_split(&recipe.split).unwrap_or_default();
    let parts_of = deal(&names, &split, recipe.split_seed);
    let mut parts = BTreeMap::new();
    let mut total = Statistics::default();
    let mut by_conditions: BTreeMap<String, Statistics> = BTreeMap::new();
    let mut summaries = Vec::new();
    for ((scenario, part), found) in scenarios.iter().zip(parts_of).zip(statistics) {
        *parts.entry(part.clone()).or_default() += 1;
        total.add(found);
        let conditions = format!("{}, {}", scenario.weather, scenario.time);
        by_conditions.entry(conditions).or_default().add(found);
        let shows = Statistics {
            picture: String::new(),
            ..found.clone()
        };
        summaries.push(ScenarioSummary {
            scenario,
            part,
            shows,
        });
    }
    Summary {
        name: &recipe.name,
        description: &recipe.description,
        version: env!("CARGO_PKG_VERSION"),
        formats: recipe
            .export
            .iter()
            .map(|export| (export.folder(), export.format.as_str()))
            .collect(),
        parts,
        total,
        by_conditions,
        scenarios: summaries,
    }
}

/// The page.
pub fn html(summary: &Summary<'_>, statistics: &[Statistics]) -> String {
    let mut page = format!("<h1>{}</h1>\n", escape(summary.name));
    if !summary.description.is_empty() {
        let _ = writeln!(
            page,
            "<p class=\"soft\">{}</p>",
            escape(summary.description)
        );
    }
    page += &figures(summary);
    page += &charts(summary);
    page += &contact_sheet(summary, statistics);
    page += &class_table(summary);
    page += &scenario_table(summary);
    document(summary.name, CONTACT_SHEET, &page)
}

/// How the contact sheet looks.
const CONTACT_SHEET: &str = "\
.thumbs{display:grid;grid-template-columns:repeat(auto-fill,minmax(200px,1fr));gap:.8rem}\
.thumbs img{width:100%;border-radius:3px;display:block;background:var(--line)}.thumbs figcaption{font-size:.78rem;color:var(--soft)}";

fn figures(summary: &Summary<'_>) -> String {
    let total = &summary.total;
    let parts: Vec<String> = summary
        .parts
        .iter()
        .map(|(part, n)| format!("{n} {part}"))
        .collect();
    let n_frames: u64 = total.frames.values().sum();
    let mut rows = vec![
        ("scenarios", grouped(summary.scenarios.len() as u64)),
        ("parts", parts.join(", ")),
        ("ticks", grouped(total.n_ticks)),
        ("simulated", format!("{:.1} s", total.sim_secs)),
        ("sensor frames", grouped(n_frames)),
        ("objects in images", grouped(total.seen())),
    ];
    if total.n_points > 0 {
        rows.push(("lidar points", grouped(total.n_points)));
    }
    if total.n_events > 0 {
        rows.push(("events", grouped(total.n_events)));
    }
    let formats: Vec<&str> = summary.formats.values().copied().collect();
    if !formats.is_empty() {
        rows.push(("formats", formats.join(", ")));
    }
    page::figures(rows)
}

fn charts(summary: &Summary<'_>) -> String {
    let classes = &summary.total.classes;
    if classes.is_empty() {
        return "<p class=\"soft\">No vehicle, person or prop is in any image.</p>\n".into();
    }
    let mut by_class: Vec<Bar> = classes
        .iter()
        .map(|(class, counts)| Bar::new(class, counts.seen))
        .collect();
    by_class.sort_by(|a, b| b.value.cmp(&a.value).then(a.name.cmp(&b.name)));
    let sum = |bins: &dyn Fn(usize) -> u64, n: usize, name: &dyn Fn(usize) -> String| {
        (0..n)
            .map(|bin| Bar::new(name(bin), bins(bin)))
            .collect::<Vec<_>>()
    };
    let distances = sum(
        &|bin| classes.values().map(|it| it.by_distance[bin]).sum(),
        N_DISTANCES,
        &|bin| {
            let from = bin as f64 * DISTANCE_BIN_M;
            let behind = if bin + 1 == N_DISTANCES { "+" } else { "–" };
            format!("{from:.0}{behind}")
        },
    );
    let occlusions = sum(
        &|bin| classes.values().map(|it| it.by_occlusion[bin]).sum(),
        N_OCCLUSIONS,
        &|bin| format!("{}–", bin * 100 / N_OCCLUSIONS),
    );
    let conditions: Vec<Bar> = summary
        .by_conditions
        .iter()
        .map(|(name, found)| Bar::new(name, found.seen()))
        .collect();
    let mut html = String::from("<div class=\"charts\">");
    let mut add = |title: &str, svg: String| {
        let _ = write!(html, "<section><h2>{title}</h2>{svg}</section>");
    };
    add(
        "Objects in images by class",
        rows("Objects in images by class", &by_class),
    );
    add(
        "By distance from the camera, metres",
        columns("Objects by distance", &distances),
    );
    if occlusions.iter().any(|bar| bar.value > 0) {
        add(
            "By share that is covered, percent",
            columns("Objects by occlusion", &occlusions),
        );
    }
    add(
        "By weather and time of day",
        rows("Objects by weather and time of day", &conditions),
    );
    html + "</div>\n"
}

fn contact_sheet(summary: &Summary<'_>, statistics: &[Statistics]) -> String {
    let step = summary.scenarios.len().div_ceil(MAX_PICTURES).max(1);
    let mut html = String::from("<h2>Contact sheet</h2>\n<div class=\"thumbs\">\n");
    for (scenario, found) in summary.scenarios.iter().zip(statistics).step_by(step) {
        if found.picture.is_empty() {
            continue;
        }
        let name = escape(&scenario.scenario.name);
        let _ = writeln!(
            html,
            "<figure><img alt=\"{name}\" loading=\"lazy\" src=\"data:image/jpeg;base64,{}\"><figcaption>{name} · {}</figcaption></figure>",
            found.picture,
            escape(&scenario.part)
        );
    }
    html + "</div>\n"
}

fn class_table(summary: &Summary<'_>) -> String {
    let heads = [
        "in images",
        "different objects",
        "hidden",
        "within 30 m",
        "less than half covered",
    ];
    let mut table = Table::new("", heads_behind("class", &[], &heads));
    for (class, counts) in &summary.total.classes {
        let near: u64 = counts.by_distance[..3].iter().sum();
        let clear: u64 = counts.by_occlusion[..N_OCCLUSIONS / 2].iter().sum();
        let counts = [counts.seen, counts.objects, counts.hidden, near, clear];
        let counts = counts.map(|n| Cell::from(grouped(n)));
        table.row(std::iter::once(Cell::from(class.as_str())).chain(counts));
    }
    format!(
        "<h2>Classes</h2>\n<p class=\"soft\">An object counts once for every image that shows it; hidden ones lie within an image and nothing of them can be seen.</p>\n{}",
        table.html()
    )
}

fn scenario_table(summary: &Summary<'_>) -> String {
    let words = ["part", "map", "weather", "time", "rig"];
    let numbers = ["seed", "ticks", "vehicles", "people", "objects in images"];
    let mut table = Table::new("", heads_behind("name", &words, &numbers));
    for ScenarioSummary {
        scenario,
        part,
        shows,
    } in &summary.scenarios
    {
        table.row([
            Cell::from(scenario.name.as_str()),
            part.as_str().into(),
            scenario.map.as_str().into(),
            scenario.weather.as_str().into(),
            scenario.time.as_str().into(),
            scenario.rig.as_str().into(),
            scenario.seed.to_string().into(),
            grouped(shows.n_ticks).into(),
            scenario.vehicles.to_string().into(),
            scenario.walkers.to_string().into(),
            grouped(shows.seen()).into(),
        ]);
    }
    format!("<h2>Scenarios</h2>\n{}", table.html())
}

/// Heads of a table: the name of a row, words, and numbers.
fn heads_behind(name: &str, words: &[&str], numbers: &[&str]) -> Vec<Head> {
    std::iter::once(Head::words(name))
        .chain(words.iter().map(|text| Head::words(*text)))
        .chain(numbers.iter().map(|text| Head::new(*text)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::scenarios;
    use crate::recipe::tests::SMALL;
    use crate::statistics::ClassCounts;

    #[test]
    fn the_page_holds_every_scenario_and_nothing_from_elsewhere() {
        let text = SMALL.replace(
            "frames = 10",
            "frames = 10\nsplit = \"train=3,val=1\"\nname = \"<set>\"",
        );
        let recipe: Recipe = toml::from_str(&text).unwrap();
        let scenarios = scenarios(&recipe).unwrap();
        let mut found = Statistics {
            n_ticks: 10,
            picture: "AAAA".into(),
            ..Statistics::default()
        };
        let mut cars = ClassCounts {
            seen: 7,
            ..ClassCounts::default()
        };
        cars.by_distance[2] = 7;
        cars.by_occlusion[0] = 7;
        found.classes.insert("Car".into(), cars);
        let statistics = vec![found; scenarios.len()];
        let summary = summary(&recipe, &scenarios, &statistics);
        assert_eq!(
            summary.parts,
            BTreeMap::from([("train".into(), 6), ("val".into(), 2)])
        );
        assert_eq!(summary.total.seen(), 56);
        assert_eq!(summary.by_conditions["rain, noon"].seen(), 28);
        let json = serde_json::to_value(&summary).unwrap();
        assert_eq!(json["scenarios"][0]["map"], "Town01");
        let page = html(&summary, &statistics);
        assert_eq!(page.matches("<img ").count(), 8);
        assert!(page.contains("&lt;set&gt;") && !page.contains("<set>"));
        assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("<script"));
        for scenario in &scenarios {
            assert!(page.contains(&scenario.name));
        }
    }
}
