//! Times hiding scenery from rays: changing the existing hierarchies against building new ones;
//! best of five, CPU time of the whole process.
//!
//! `cargo run --release -p test_render --example ray_hiding [TOWN] [--json FILE]`

use std::collections::BTreeSet;
use std::process::ExitCode;
use std::time::Instant;

use launch_cli::bench::{self, BenchResult, anyhow, clap};
use schema_frames::document::Weather;
use schema_types::ObjectId;
use sensor_ray::RayScene;
use test_render::Stage;

/// Times hiding scenery from rays
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value = "Town10HD")]
    town: String,
}

fn main() -> ExitCode {
    bench::run("ray_hiding", measure)
}

fn measure(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let town = &args.town;
    let stage = Stage::new(town, 11, 10)?;
    let whole = stage.scene(Weather::default()).assets;
    let ids: BTreeSet<u32> = whole
        .meshes
        .iter()
        .flat_map(|mesh| &mesh.vertices)
        .map(|vertex| vertex.object_id)
        .filter(|id| *id != 0)
        .collect();
    let mut kept = RayScene::load_for_gpu(&whole);
    println!(
        "{town}: {} triangles, {} objects",
        kept.n_static_triangles(),
        ids.len()
    );
    // The first call also builds a table of the objects.
    let begin = Instant::now();
    assert!(kept.hide(&whole.without(&ids.iter().take(1).map(|id| ObjectId(*id)).collect())));
    let first_ms = begin.elapsed().as_secs_f64() * 1e3;
    println!("hide the first object for the first time: {first_ms:.3} ms");
    result.row("the first object for the first time", &[("ms", first_ms)]);
    for (name, step) in [("one object", ids.len()), ("every tenth object", 10)] {
        let less = whole.without(&ids.iter().step_by(step).map(|id| ObjectId(*id)).collect());
        let mut best_ms = [f64::INFINITY; 2];
        for _ in 0..5 {
            assert!(kept.hide(&whole));
            let begin = Instant::now();
            assert!(kept.hide(&less));
            best_ms[0] = best_ms[0].min(begin.elapsed().as_secs_f64() * 1e3);
            let begin = Instant::now();
            drop(RayScene::load_for_gpu(&less));
            best_ms[1] = best_ms[1].min(begin.elapsed().as_secs_f64() * 1e3);
        }
        println!(
            "hide {name}: in place {:.3} ms, new hierarchies {:.1} ms",
            best_ms[0], best_ms[1]
        );
        result.row(name, &[("whole_ms", best_ms[1]), ("ms", best_ms[0])]);
    }
    Ok(())
}
