//! The summary of a set: `summary.json` for programs, and `index.html` for people. The page is one
//! file and needs nothing from elsewhere.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use consumer_export::options::{deal, parse_split};
use serde::Serialize;

use crate::matrix::Scenario;
use crate::recipe::Recipe;
use crate::statistics::{DISTANCE_BIN_M, N_DISTANCES, N_OCCLUSIONS, Statistics};
use crate::svg::{Bar, columns, escape, grouped, rows};

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
    let name = escape(summary.name);
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{name}</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n<h1>{name}</h1>\n"
    );
    if !summary.description.is_empty() {
        let _ = writeln!(page, "<p>{}</p>", escape(summary.description));
    }
    page += &figures(summary);
    page += &charts(summary);
    page += &contact_sheet(summary, statistics);
    page += &class_table(summary);
    page += &scenario_table(summary);
    page + "</body>\n</html>\n"
}

const STYLE: &str = "\
:root{color-scheme:light dark;--page:#fcfcfb;--ink:#1a1a19;--soft:#5f5e5a;--line:#dddcd8;--bar:#2a78d6}\
@media(prefers-color-scheme:dark){:root{--page:#1a1a19;--ink:#f4f3f0;--soft:#b3b2ad;--line:#3b3a38;--bar:#3987e5}}\
body{margin:2rem auto;max-width:1180px;padding:0 1rem;background:var(--page);color:var(--ink);font:15px/1.5 system-ui,sans-serif}\
h1{font-size:1.6rem;margin:0 0 .3rem}h2{font-size:1.05rem;margin:2rem 0 .6rem}p{margin:.2rem 0 1rem;color:var(--soft)}\
.figures{display:flex;flex-wrap:wrap;gap:.4rem 2.2rem;margin:1.2rem 0;padding:0}\
.figures div{min-width:5rem}.figures dt{color:var(--soft);font-size:.85rem}.figures dd{margin:0;font-size:1.35rem}\
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,460px),1fr));gap:0 2.5rem}\
svg{max-width:100%;height:auto;font-size:12px}svg .bar{fill:var(--bar)}svg .name{fill:var(--soft)}svg .value{fill:var(--ink)}svg .ground{stroke:var(--line)}\
.sheet{display:grid;grid-template-columns:repeat(auto-fill,minmax(200px,1fr));gap:.8rem}\
figure{margin:0}figure img{width:100%;border-radius:3px;display:block;background:var(--line)}figcaption{font-size:.78rem;color:var(--soft);overflow-wrap:anywhere}\
.scroll{overflow-x:auto}table{border-collapse:collapse;font-size:.88rem;width:100%}\
th,td{padding:.25rem .7rem;text-align:right;border-bottom:1px solid var(--line);font-variant-numeric:tabular-nums;white-space:nowrap}\
th{color:var(--soft);font-weight:500}th:first-child,td:first-child{text-align:left;padding-left:0}td.t,th.t{text-align:left}";

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
    let mut html = String::from("<dl class=\"figures\">");
    for (name, value) in rows {
        let _ = write!(
            html,
            "<div><dt>{name}</dt><dd>{}</dd></div>",
            escape(&value)
        );
    }
    html + "</dl>\n"
}

fn charts(summary: &Summary<'_>) -> String {
    let classes = &summary.total.classes;
    if classes.is_empty() {
        return "<p>No vehicle, person or prop is in any image.</p>\n".into();
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
    let mut html = String::from("<h2>Contact sheet</h2>\n<div class=\"sheet\">\n");
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
    let mut html = String::from(
        "<h2>Classes</h2>\n<p>An object counts once for every image that shows it; hidden ones lie within an image and nothing of them can be seen.</p>\n\
         <div class=\"scroll\"><table><tr><th>class</th><th>in images</th><th>different objects</th><th>hidden</th><th>within 30 m</th><th>less than half covered</th></tr>\n",
    );
    for (class, counts) in &summary.total.classes {
        let near: u64 = counts.by_distance[..3].iter().sum();
        let clear: u64 = counts.by_occlusion[..N_OCCLUSIONS / 2].iter().sum();
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(class),
            grouped(counts.seen),
            grouped(counts.objects),
            grouped(counts.hidden),
            grouped(near),
            grouped(clear)
        );
    }
    html + "</table></div>\n"
}

fn scenario_table(summary: &Summary<'_>) -> String {
    let mut html = String::from(
        "<h2>Scenarios</h2>\n<div class=\"scroll\"><table><tr><th>name</th><th class=\"t\">part</th><th class=\"t\">map</th><th class=\"t\">weather</th>\
         <th class=\"t\">time</th><th class=\"t\">rig</th><th>seed</th><th>ticks</th><th>vehicles</th><th>people</th><th>objects in images</th></tr>\n",
    );
    for ScenarioSummary {
        scenario,
        part,
        shows,
    } in &summary.scenarios
    {
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td class=\"t\">{}</td><td class=\"t\">{}</td><td class=\"t\">{}</td><td class=\"t\">{}</td><td class=\"t\">{}</td>\
             <td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&scenario.name),
            escape(part),
            escape(&scenario.map),
            escape(&scenario.weather),
            escape(&scenario.time),
            escape(&scenario.rig),
            scenario.seed,
            grouped(shows.n_ticks),
            scenario.vehicles,
            scenario.walkers,
            grouped(shows.seen())
        );
    }
    html + "</table></div>\n"
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
        assert!(!page.contains("http") && !page.contains("<script"));
        for scenario in &scenarios {
            assert!(page.contains(&scenario.name));
        }
    }
}
