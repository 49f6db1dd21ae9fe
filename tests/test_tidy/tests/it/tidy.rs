//! Each test is one rule; a failure lists every place that breaks it.

use std::collections::{BTreeMap, BTreeSet};

use test_tidy::{files, relative, repository};

fn read(path: &std::path::Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", relative(path)))
}

/// `a → b`: crate `a` may depend on crate `b` of ours. Transitive closure is not implied; every
/// allowed pair stands here.
fn allowed(from: &str, to: &str) -> bool {
    let district = |name: &str| name.split('_').next().unwrap_or(name).to_owned();
    match (from, to) {
        // The pure driver knows records and maps, and nothing that has a bus, a clock or a file.
        ("consumer_driver", _) => matches!(to, "schema_types" | "schema_frames" | "schema_roads"),
        (_, "launch_cli") => !matches!(district(from).as_str(), "schema" | "sensor"),
        (
            "gantry"
            | "consumer_dataset"
            | "consumer_export"
            | "consumer_perception"
            | "consumer_rerun",
            "launch_run",
        ) => true,
        ("launch_spec", "sensor_spec") | ("gantry", "launch_spec") => true,
        // `gantry sensor check` casts a scan.
        ("gantry", "sensor_core" | "sensor_ray" | "sensor_spec") => true,
        ("simd" | "simd_frames" | "simd_render", "launch_spec") => true,
        ("simd_render", "simd_frames") => true,
        ("simd_frames" | "simd_render", _) => matches!(district(to).as_str(), "schema" | "sensor"),
        ("simd_body", "sensor_core") | ("simd_town", "sensor_core" | "simd_body") => true,
        ("simd_world", "sensor_core" | "simd_body" | "simd_town") => true,
        // Many worlds know neither sensors nor a bus.
        ("simd_worlds", "simd_town" | "simd_world") => true,
        ("simd", _) => matches!(district(to).as_str(), "schema" | "sensor" | "simd"),
        ("schema_types", _) => false,
        ("schema_bus", "schema_types" | "schema_frames") => true,
        ("schema_frames" | "schema_roads" | "schema_calibration", "schema_types") => true,
        ("schema_recording", "schema_types" | "schema_frames") => true,
        (
            "consumer_dataset" | "consumer_export" | "consumer_sets" | "consumer_perception",
            "consumer_truth",
        ) => true,
        ("consumer_dataset", "consumer_sets" | "launch_spec") => true,
        ("consumer_perception", "consumer_metrics" | "launch_spec") => true,
        ("consumer_bench", "consumer_perception") => true,
        (
            "consumer_bench" | "consumer_dataset" | "consumer_metrics" | "consumer_perception",
            "consumer_report",
        ) => true,
        (_, to) if district(to) == "schema" => district(from) != "schema",
        ("sensor_core", "sensor_spec")
        | ("sensor_camera" | "sensor_ray", "sensor_core" | "sensor_spec") => true,
        ("sensor_camera" | "sensor_ray", "sensor_gpu") => true,
        ("sensor_shade", "sensor_core") | ("sensor_camera", "sensor_shade") => true,
        ("sensor_gpu", "sensor_core") => true,
        (
            "consumer_carla" | "consumer_drive" | "consumer_desk" | "consumer_bridge",
            "consumer_rpc",
        ) => true,
        ("consumer_drive", "consumer_driver") => true,
        ("consumer_view" | "consumer_desk", "consumer_fly" | "consumer_forms") => true,
        ("consumer_record" | "consumer_bridge" | "consumer_replay", "consumer_forms") => true,
        ("consumer_sets", "consumer_forms") | ("consumer_export", "consumer_sets") => true,
        ("consumer_python", "consumer_forms" | "consumer_gpu") => true,
        // `gantry.envs` holds worlds in the Python process; they know no bus, so it reads nothing
        // of a daemon that other consumers could not.
        ("consumer_python", "simd_worlds") => true,
        (from, "consumer_kit") => district(from) == "consumer",
        // All programs in one file, and nothing else.
        ("launch_all", "gantry" | "simd" | "simd_render") => true,
        ("launch_all", to) => district(to) == "consumer",
        _ => false,
    }
}

fn manifests() -> BTreeMap<String, (String, toml::Table)> {
    let mut found = BTreeMap::new();
    for path in files(&["toml"]) {
        if path.file_name().is_some_and(|n| n == "Cargo.toml")
            && path.parent() != Some(repository().as_path())
            // A workspace of its own, built for coverage.
            && path.parent() != Some(repository().join("fuzz").as_path())
        {
            let table: toml::Table = read(&path)
                .parse()
                .unwrap_or_else(|error| panic!("{}: {error}", relative(&path)));
            let name = table["package"]["name"]
                .as_str()
                .expect("crates have names")
                .to_owned();
            found.insert(name, (relative(&path), table));
        }
    }
    found
}

#[test]
fn crates_depend_only_in_the_allowed_direction() {
    let manifests = manifests();
    let mut wrong = Vec::new();
    for (name, (path, table)) in manifests
        .iter()
        .filter(|(name, _)| !name.starts_with("test_"))
    {
        let dependencies = table
            .get("dependencies")
            .and_then(|d| d.as_table())
            .cloned()
            .unwrap_or_default();
        for dependency in dependencies.keys().filter(|d| manifests.contains_key(*d)) {
            if !allowed(name, dependency) {
                wrong.push(format!("{path}: {name} must not depend on {dependency}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_crate_depends_on_a_program() {
    let manifests = manifests();
    let is_program = |name: &str| {
        let found = manifests.get(name);
        found.is_some_and(|(_, table)| table.contains_key("bin"))
    };
    let mut found = BTreeSet::new();
    for (name, (_, table)) in &manifests {
        // Tests start programs, and launch_all holds all of them in one file.
        if name == "launch_all" || name.starts_with("test_") {
            continue;
        }
        let dependencies = table.get("dependencies").and_then(|d| d.as_table());
        let names = dependencies.into_iter().flat_map(|d| d.keys());
        let programs = names.filter(|dependency| is_program(dependency));
        found.extend(programs.map(|program| (name.as_str(), program.as_str())));
    }
    assert!(found.is_empty(), "a crate depends on a program: {found:?}");
}

#[test]
fn only_one_crate_names_each_engine() {
    let owners = [
        ("iceoryx2", ["schema_bus"].as_slice()),
        ("rapier3d", &["simd_world"]),
        ("rerun", &["consumer_view"]),
        (
            "mcap",
            &[
                "schema_recording",
                "consumer_record",
                "test_e2e",
                "test_fuzz",
            ],
        ),
        ("xodr", &["schema_roads"]),
        ("obvhs", &["sensor_ray"]),
        ("ash", &["sensor_gpu"]),
        ("pyo3", &["consumer_python"]),
        ("cudarc", &["consumer_gpu"]),
    ];
    let mut wrong = Vec::new();
    for (name, (path, table)) in manifests() {
        for (engine, crates) in owners {
            let uses = ["dependencies", "dev-dependencies"]
                .iter()
                .any(|kind| table.get(*kind).is_some_and(|d| d.get(engine).is_some()));
            if uses && !crates.contains(&name.as_str()) {
                wrong.push(format!("{path}: only {crates:?} may depend on {engine}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Simulators of many worlds link the driver, so it must not wait, look at a clock or open a file.
#[test]
fn the_pure_driver_knows_no_bus_clock_thread_or_file() {
    let manifests = manifests();
    let (path, table) = &manifests["consumer_driver"];
    let allowed = [
        "schema_types",
        "schema_frames",
        "schema_roads",
        "nalgebra",
        "serde",
        "tracing",
    ];
    let dependencies = table["dependencies"].as_table().expect("a table");
    let mut wrong: Vec<String> = dependencies
        .keys()
        .filter(|name| !allowed.contains(&name.as_str()))
        .map(|name| format!("{path}: consumer_driver must not depend on {name}"))
        .collect();
    let words = [
        "std::time",
        "std::thread",
        "std::fs",
        "std::net",
        "std::env",
    ];
    let sources = files(&["rs"]);
    for source in sources
        .iter()
        .filter(|file| relative(file).starts_with("consumers/consumer_driver/src/"))
    {
        for (i, line) in read(source).lines().enumerate() {
            if words.iter().any(|word| line.contains(word)) {
                wrong.push(format!("{}:{}: {}", relative(source), i + 1, line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn packages_hold_every_program() {
    let all = read(&repository().join("launch/launch_all/src/main.rs"));
    let manifests = manifests().into_iter();
    // All programs in one file is no program in it, and tests are not packed.
    let packed = manifests.filter(|(name, _)| name != "launch_all" && !name.starts_with("test_"));
    let bins = packed.filter_map(|(_, (_, table))| table.get("bin")?.as_array().cloned());
    let missing: Vec<String> = bins
        .flatten()
        .filter_map(|bin| Some(bin.get("name")?.as_str()?.to_owned()))
        .filter(|name| !all.contains(&format!("(\"{name}\", ")))
        .collect();
    assert!(
        missing.is_empty(),
        "launch/launch_all/src/main.rs lacks {}",
        missing.join(", ")
    );
}

/// Linking is most of what a test program costs, and every one links its crate with all below it.
#[test]
fn tests_of_a_crate_are_one_program() {
    let mut wrong = Vec::new();
    for (path, _) in manifests().into_values() {
        let folder = repository().join(&path).with_file_name("tests");
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let paths = entries.map(|entry| entry.path());
        let mut programs: Vec<String> = paths
            .filter(|path| {
                path.extension().is_some_and(|it| it == "rs") || path.join("main.rs").is_file()
            })
            .map(|path| relative(&path))
            .collect();
        programs.sort();
        if programs.len() > 1 {
            wrong.push(format!(
                "{} are test programs, not modules of one",
                programs.join(", ")
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A target without tests is not built for them, and one with tests is.
#[test]
fn only_targets_with_tests_are_built_for_tests() {
    let says =
        |target: &toml::Value, key| target.get(key).and_then(toml::Value::as_bool) != Some(false);
    let none = toml::Value::Table(toml::Table::new());
    let mut wrong = Vec::new();
    for (path, table) in manifests().into_values() {
        let source = repository().join(&path).with_file_name("src");
        let sources: Vec<_> = files(&["rs"])
            .into_iter()
            .filter(|path| path.starts_with(&source))
            .collect();
        let (programs, library): (Vec<_>, Vec<_>) = sources.iter().partition(|path| {
            path.parent() == Some(&source.join("bin")) || **path == source.join("main.rs")
        });
        let has_tests =
            |paths: &[&std::path::PathBuf]| paths.iter().any(|path| read(path).contains("#[test]"));
        let lib = table.get("lib").unwrap_or(&none);
        if source.join("lib.rs").is_file() && says(lib, "test") != has_tests(&library) {
            wrong.push(format!(
                "{path}: the library says test = {}",
                says(lib, "test")
            ));
        }
        let bins = table.get("bin").and_then(|bins| bins.as_array());
        let is_built = bins.map_or(!programs.is_empty(), |bins| {
            bins.iter().any(|bin| says(bin, "test"))
        });
        if is_built != has_tests(&programs) {
            wrong.push(format!("{path}: its programs say test = {is_built}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn crates_are_named_like_their_folders() {
    for (name, (path, _)) in manifests() {
        let folder = path
            .trim_end_matches("/Cargo.toml")
            .rsplit('/')
            .next()
            .unwrap_or_default()
            .to_owned();
        assert_eq!(folder, name, "{path}");
    }
}

#[test]
fn versions_live_in_the_root_manifest() {
    let mut wrong = Vec::new();
    for (_, (path, table)) in manifests() {
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            for (dependency, value) in table
                .get(kind)
                .and_then(|d| d.as_table())
                .into_iter()
                .flatten()
            {
                if value.get("workspace").and_then(|w| w.as_bool()) != Some(true) {
                    wrong.push(format!("{path}: {dependency} must say workspace = true"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_unsafe_block_has_its_proof() {
    let mut wrong = Vec::new();
    for path in files(&["rs"]) {
        let text = read(&path);
        let lines: Vec<&str> = text.lines().collect();
        for (i, line) in lines.iter().enumerate() {
            let code = line.split("//").next().unwrap_or_default();
            let is_block = [concat!("unsa", "fe {"), concat!("unsa", "fe impl")]
                .iter()
                .any(|word| code.contains(word));
            if is_block
                && !lines[i.saturating_sub(8)..=i]
                    .iter()
                    .any(|l| l.contains("SAFETY:"))
            {
                wrong.push(format!(
                    "{}:{}: unsafe without a SAFETY comment above",
                    relative(&path),
                    i + 1
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn nothing_is_left_to_do_or_switched_off() {
    // Spelled in parts so that this file does not accuse itself.
    let words = [
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("#[ig", "nore"),
        concat!("todo", "!("),
        concat!("unimple", "mented!"),
        concat!("dbg", "!("),
    ];
    let mut wrong = Vec::new();
    for path in files(&["rs", "py", "wgsl", "sh"]) {
        for (i, line) in read(&path).lines().enumerate() {
            if words.iter().any(|word| line.contains(word)) {
                wrong.push(format!("{}:{}: {}", relative(&path), i + 1, line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_file_knows_the_machine_it_was_written_on() {
    let wanted = ["/ho", "me/"].concat();
    let roots = ["/ro", "ot/"].concat();
    let mut wrong = Vec::new();
    for path in files(&["rs", "py", "md", "toml", "sh", "wgsl"]) {
        for (i, line) in read(&path).lines().enumerate() {
            if line.contains(&wanted) || line.contains(&roots) {
                wrong.push(format!("{}:{}: {}", relative(&path), i + 1, line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_source_file_says_what_it_is_for() {
    let silent: Vec<String> = files(&["rs"])
        .iter()
        .filter(|path| !read(path).starts_with("//!") && !read(path).is_empty())
        .map(|p| relative(p))
        .collect();
    assert!(
        silent.is_empty(),
        "files without an opening //! line:\n{}",
        silent.join("\n")
    );
}

/// The last of several generic arguments, whose list begins at the front of the text.
fn last_argument(text: &str) -> Option<&str> {
    let (mut depth, mut begin) = (1, 0);
    let mut before = ' ';
    for (at, letter) in text.char_indices() {
        match letter {
            '<' | '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            '>' if before != '-' => depth -= 1,
            ',' if depth == 1 => begin = at + 1,
            _ => {}
        }
        if depth == 0 {
            return (begin > 0).then(|| text[begin..at].trim());
        }
        before = letter;
    }
    None
}

/// Parsers of arguments give clap a sentence; everything else has an error with a type.
#[test]
fn few_results_have_a_text_as_their_error() {
    const MOST: usize = 40;
    let word = concat!("Res", "ult<");
    let mut found = Vec::new();
    for path in files(&["rs"]) {
        let text = read(&path);
        for (at, _) in text.match_indices(word) {
            if last_argument(&text[at + word.len()..]) == Some("String") {
                let line = text[..at].matches('\n').count() + 1;
                found.push(format!("{}:{line}", relative(&path)));
            }
        }
    }
    assert!(found.len() <= MOST, "{}", found.join("\n"));
}

#[test]
fn the_last_of_generic_arguments_is_found() {
    assert_eq!(last_argument("(u32, u32), String> {"), Some("String"));
    assert_eq!(last_argument("Vec<(A, B)>, Error>"), Some("Error"));
    assert_eq!(last_argument("fn() -> A, String>"), Some("String"));
    assert_eq!(last_argument("String>"), None, "of one there is no error");
    assert_eq!(last_argument("no end, String"), None);
}

/// Words in backticks of the architecture page that look like a crate or a path must exist.
#[test]
fn the_architecture_page_names_things_that_exist() {
    let page = read(&repository().join("ARCHITECTURE.md"));
    let crates: BTreeSet<String> = manifests().into_keys().collect();
    let districts = [
        "schema_",
        "sensor_",
        "simd_",
        "launch_",
        "consumer_",
        "test_",
    ];
    let mut wrong = Vec::new();
    for word in page.split('`').skip(1).step_by(2) {
        let head = word.split("::").next().unwrap_or(word);
        let is_crate_name =
            districts.iter().any(|d| head.starts_with(d)) && !head.contains(['/', '.', ' ']);
        if is_crate_name && !crates.contains(head) {
            wrong.push(format!("`{word}`: there is no crate {head}"));
        }
        let is_path = word.contains('/')
            && !word.contains(['<', '*', ' ', '{', ':', '…'])
            && !word.starts_with("world/")
            && !word.starts_with("control/");
        if is_path && !repository().join(word).exists() {
            wrong.push(format!("`{word}`: there is no such file or folder"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
