//! Maps of the map folder and maps from a text, with the stock CARLA client.

use schema_bus::names;
use test_e2e::carla::{Stage, empty_town};
use test_e2e::{document, join_bus};
use test_kit::Sandbox;

#[test]
fn the_stock_client_lists_loads_and_generates_maps() {
    let sandbox = Sandbox::new("carlamaps");
    let data = sandbox.path("data");
    std::fs::create_dir_all(data.join("maps")).unwrap();
    let stage = Stage::with(
        sandbox,
        &empty_town("Town02"),
        &["--data", data.to_str().unwrap()],
    );
    // The text of a generated town is loaded like any user's file.
    let bus = join_bus(&stage.sandbox, "test");
    let file = data.join("maps/mine.xodr");
    std::fs::write(&file, document(&bus, names::WORLD_MAP).text).unwrap();
    drop(bus);
    // A file outside the map folder, which no client may reach.
    std::fs::copy(&file, stage.sandbox.path("secret.xodr")).unwrap();
    stage.run(
        "carla_maps.py",
        &[file.to_str().unwrap()],
        &["listing", "folder", "generating", "refusals", "many"],
    );
    stage.end();
}
