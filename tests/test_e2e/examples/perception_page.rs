//! Writes the made-up report of `tests/perception_report` into a folder, to be looked at in a
//! browser: `cargo run --release -p test_e2e --example perception_page -- FOLDER`.

#[path = "../tests/it/perception_report/example.rs"]
mod example;

use consumer_perception::report::{Files, terminal, write_all};

fn main() {
    let folder = std::env::args().nth(1).expect("say the folder");
    let report = example::report(folder.as_ref());
    let written = write_all(&report, folder.as_ref(), &Files::default());
    println!("{}", written.expect("the folder can be written"));
    println!("{}", terminal(&report, true));
}
