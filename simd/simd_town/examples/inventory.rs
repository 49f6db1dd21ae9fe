//! What stands in each town: `inventory [SEED]` prints the table of docs/reference/towns.md.

use std::collections::BTreeMap;

use simd_town::Town;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seed = match std::env::args().nth(1) {
        None => 1,
        Some(text) => text
            .parse()
            .map_err(|_| format!("seed is {text:?}, but must be a whole number from 0"))?,
    };
    let mut rows: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (column, name) in Town::NAMES.into_iter().enumerate() {
        let town = Town::generate(name, seed)?;
        let mut count = |what: &str, n: usize| {
            let row = rows
                .entry(what.to_owned())
                .or_insert_with(|| vec![0; Town::NAMES.len()]);
            row[column] += n;
        };
        for object in &town.objects {
            let kind = object
                .name
                .trim_end_matches(|c: char| c.is_ascii_digit())
                .trim_end_matches('_');
            count(&kind.replace('_', " "), 1);
        }
        count(
            "traffic light heads",
            town.lights.iter().map(|light| light.heads.len()).sum(),
        );
        count("spawn points", town.spawn_points.len());
    }
    println!("| | {} |", Town::NAMES.join(" | "));
    println!("|---|{}", "---|".repeat(Town::NAMES.len()));
    for (what, counts) in rows {
        let cells: Vec<String> = counts
            .iter()
            .map(|n| {
                if *n == 0 {
                    "–".to_owned()
                } else {
                    n.to_string()
                }
            })
            .collect();
        println!("| {what} | {} |", cells.join(" | "));
    }
    Ok(())
}
