//! Times what a large town costs, and counts what is in it: `cargo run --release -p simd_town
//! --example large_town -- Town12 1`. With a path of an OpenDRIVE file in place of the name that
//! file is read.

use std::time::Instant;

use schema_roads::{RoadMap, SurfaceSteps};
use simd_town::Town;
use simd_town::imported::{ImportOptions, import};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_else(|| "Town12".to_owned());
    let seed = args.next().map_or(Ok(1), |text| text.parse())?;
    let mut last = Instant::now();
    let mut lap = |what: &str| {
        println!("{what}: {:.2} s", last.elapsed().as_secs_f64());
        last = Instant::now();
    };
    let text = if name.ends_with(".xodr") {
        std::fs::read_to_string(&name)?
    } else {
        Town::open_drive(&name, seed)?
    };
    lap("text");
    let roads = RoadMap::parse(&text)?;
    lap("roads");
    let steps = SurfaceSteps {
        max_points: usize::MAX,
        ..SurfaceSteps::default()
    };
    let points: usize = roads
        .surfaces(&steps)?
        .iter()
        .flat_map(|section| &section.lanes)
        .map(|lane| lane.points_m.len())
        .sum();
    lap("surfaces");
    let town = import(&name, &text, &roads, seed, &ImportOptions::default())?;
    lap("world");
    let meshes = &town.assets.meshes;
    let bytes: usize = meshes
        .iter()
        .map(|mesh| 28 * mesh.vertices.len() + 4 * mesh.indices.len())
        .sum();
    let solid: usize = town.collision.iter().map(|mesh| mesh.triangles.len()).sum();
    println!(
        "{} bytes of text, {points} points of surfaces, {} meshes of {} MiB, {} instances, {} objects, {} lamps, {solid} solid triangles, {} spawn points",
        text.len(),
        meshes.len(),
        bytes >> 20,
        town.assets.statics.len(),
        town.objects.len(),
        town.lamps.len(),
        town.spawn_points.len()
    );
    for layer in ["ground", "building", "small", "wood"] {
        let of: Vec<_> = meshes
            .iter()
            .filter(|m| m.name.starts_with(layer))
            .collect();
        let vertices: usize = of.iter().map(|m| m.vertices.len()).sum();
        let levels: Vec<usize> = (0..3)
            .map(|level| {
                of.iter()
                    .filter_map(|m| m.lods.get(level))
                    .map(|lod| lod.n_indices as usize / 3)
                    .sum()
            })
            .collect();
        println!(
            "{layer}: {} meshes, {vertices} vertices, triangles by level {levels:?}",
            of.len()
        );
    }
    Ok(())
}
