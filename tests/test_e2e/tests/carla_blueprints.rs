//! The blueprint library as the stock client sees it, against CARLA's.

use test_e2e::carla::{Stage, empty_town};
use test_kit::sandbox::repository;

#[test]
fn blueprints_are_carlas_but_for_those_that_the_page_names() {
    let stage = Stage::new("carlaprints", &empty_town("Town10HD"));
    let page = repository().join("docs/reference/carla-compatibility.md");
    stage.run(
        "carla_blueprints.py",
        &[page.to_str().expect("paths are UTF-8")],
        &["sensors", "vehicles", "walkers", "props", "recommended"],
    );
    stage.end();
}
