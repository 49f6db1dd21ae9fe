//! Projects that `gantry new` makes outside the repository: they build, pass their own tests, and run
//! with the simulator from their launch file.

use std::path::{Path, PathBuf};

use schema_frames::Box2d;
use test_e2e::{assert_nothing_left, join_bus, python_package, venv_program};
use test_kit::sandbox::{binary_path, repository};
use test_kit::{Ended, Sandbox, eventually};

/// Small images, which a software renderer draws quickly, and nothing to look at.
const QUICK: [&str; 8] = [
    "--view",
    "none",
    "--set",
    "sensor.front.width_px=96",
    "--set",
    "sensor.front.height_px=64",
    "--set",
    "scenario.vehicles=2",
];

/// Makes a project in a folder of the sandbox.
fn make(sandbox: &Sandbox, name: &str, lang: &str) -> PathBuf {
    let words = ["new", "consumer", name, "--lang", lang];
    sandbox.spawn("gantry", &words).wait().expect_code(0);
    sandbox.path(name)
}

/// `PATH` with a folder before all others, as an activated environment has it.
fn path_with(first: &Path) -> String {
    let old = std::env::var_os("PATH").unwrap_or_default();
    let all = std::iter::once(first.to_path_buf()).chain(std::env::split_paths(&old));
    let path = std::env::join_paths(all).expect("folders without colons");
    path.into_string().expect("PATH is text")
}

/// Runs the project's launch file until a result has come that answers an image, and stops it.
fn up(sandbox: &Sandbox, project: &Path, env: &[(&str, &str)], set: &[&str]) -> Ended {
    // Its processes start in the project, so that its folder has the private configuration.
    std::fs::create_dir_all(project.join("config")).unwrap();
    std::fs::copy(
        sandbox.iceoryx_config(),
        project.join("config/iceoryx2.toml"),
    )
    .unwrap();
    let (launch, data) = (project.join("launch.toml"), sandbox.path("data"));
    let words = [
        &["up", launch.to_str().unwrap()][..],
        &["--domain", sandbox.domain()],
        &["--data", data.to_str().unwrap()],
        &QUICK[..],
        set,
    ]
    .concat();
    let mut gantry = sandbox.spawn_program("gantry", &binary_path("gantry"), &words, env);
    let bus = join_bus(sandbox, "test");
    let topic = format!("{}/boxes", project.file_name().unwrap().to_str().unwrap());
    let mut boxes = eventually("a topic of boxes", || {
        assert!(gantry.is_running(), "{}", gantry.lines().join("\n"));
        bus.result_reader(&topic).ok()
    });
    let result = eventually("boxes", || {
        assert!(gantry.is_running(), "{}", gantry.lines().join("\n"));
        boxes.next().unwrap()
    });
    assert!(result.records::<Box2d>().is_some());
    let input = &result.inputs()[0];
    assert_eq!(
        (input.topic().as_str(), input.tick),
        ("ego/front/semantic", result.header().tick)
    );
    drop((result, boxes));
    drop(bus);
    let ended = gantry.stop();
    assert_nothing_left(sandbox);
    ended
}

#[test]
fn a_rust_consumer_builds_passes_its_tests_and_runs_from_its_launch_file() {
    let sandbox = Sandbox::new("new-rust");
    let project = make(&sandbox, "rust_net", "rust");
    // Kept from run to run, so that only the first one compiles the dependencies.
    let target = concat!(env!("CARGO_TARGET_TMPDIR"), "/new_consumer");
    // The checkout's products may lie elsewhere than in its folder target.
    let gantry = binary_path("gantry");
    let path = path_with(gantry.parent().expect("programs lie in a folder"));
    let env = [
        ("PATH", path.as_str()),
        ("CARGO_TARGET_DIR", target),
        // Nobody debugs it; the folder has 0.5 GB instead of 1.4.
        ("CARGO_PROFILE_DEV_DEBUG", "0"),
        ("CARGO_INCREMENTAL", "0"),
        // Whatever is not in the workspace's lock file would have to be fetched.
        ("CARGO_NET_OFFLINE", "true"),
    ];
    let manifest = project.join("Cargo.toml");
    let words = ["test", "--manifest-path", manifest.to_str().unwrap()];
    let ended = sandbox
        .spawn_program("cargo", Path::new(env!("CARGO")), &words, &env)
        .wait_longer(std::time::Duration::from_secs(1800))
        .expect_code(0);
    let passed = |test: &str| ended.says(&format!("test {test} ... ok"));
    assert!(
        passed("every_image_is_answered_and_the_car_ahead_has_an_exact_box")
            && passed("detect::tests::two_cars_side_by_side_get_a_box_each_and_a_lamp_gets_none")
            && !ended.says("warning"),
        "{:#?}",
        ended.lines
    );
    // As the tests were built, which saves building all of it again.
    let cmd = "process.rust_net.cmd=[\"cargo\", \"run\", \"--quiet\"]";
    up(&sandbox, &project, &env, &["--set", cmd]).expect_code(0);
}

#[test]
fn a_python_consumer_passes_its_tests_and_runs_from_its_launch_file() {
    let sandbox = Sandbox::new("new-python");
    let project = make(&sandbox, "python_net", "python");
    let python = venv_program("python");
    let package = python_package();
    let path = path_with(python.parent().unwrap());
    let env = [
        ("PYTHONPATH", package.to_str().unwrap()),
        ("PYTHONDONTWRITEBYTECODE", "1"),
        ("PATH", path.as_str()),
    ];
    let words = [
        "-m",
        "pytest",
        "-q",
        "-rs",
        "-W",
        "error",
        // Where it stands is said before the patience of this test ends.
        "-o",
        "faulthandler_timeout=60",
        project.to_str().unwrap(),
    ];
    let pytest = |extra: &[&str]| {
        let words = [&words[..], extra].concat();
        sandbox
            .spawn_program("pytest", &python, &words, &env)
            // The simulator of its tests says itself what it waited for in vain, after two minutes.
            .wait_longer(std::time::Duration::from_secs(600))
    };
    let ended = pytest(&[]).expect_code(0);
    assert!(ended.says("3 passed"), "{:#?}", ended.lines);
    // The folder of the programs can be named, and a wrong one is said.
    let folder = binary_path("simd");
    let folder = folder.parent().unwrap().to_str().unwrap();
    pytest(&["--gantry-bin", folder]).expect_code(0);
    let ended = pytest(&["--gantry-bin", "elsewhere"]).expect_code(1);
    assert!(
        ended.says("there is no program 'simd' in elsewhere"),
        "{:#?}",
        ended.lines
    );
    up(&sandbox, &project, &env, &[]).expect_code(0);
}

/// Builds one program of a project in C++, as its CMakeLists.txt does, with warnings as errors.
fn build_cpp(sandbox: &Sandbox, project: &Path, source: &str) -> PathBuf {
    let build = project.join("build");
    std::fs::create_dir_all(&build).unwrap();
    // A program finds the library by its name of this interface.
    let link = build.join("libgantry.so.1");
    if !link.exists() {
        std::os::unix::fs::symlink(binary_path("libgantry.so"), &link).unwrap();
    }
    let prefix = repository().join("consumers/consumer_c/include");
    let stem = Path::new(source).file_stem().unwrap();
    let made = match source {
        "src/main.cpp" => build.join(project.file_name().unwrap()),
        _ => build.join(stem),
    };
    let rpath = format!("-Wl,-rpath,{}", build.display());
    let (source, own) = (project.join(source), project.join("src"));
    let words = [
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-I",
        prefix.to_str().unwrap(),
        "-I",
        own.to_str().unwrap(),
        "-o",
        made.to_str().unwrap(),
        source.to_str().unwrap(),
        link.to_str().unwrap(),
        &rpath,
    ];
    let compiler = Path::new("c++");
    sandbox
        .spawn_program("c++", compiler, &words, &[])
        .wait()
        .expect_code(0);
    made
}

#[test]
fn a_cpp_consumer_builds_passes_its_tests_and_runs_from_its_launch_file() {
    let sandbox = Sandbox::new("new-cpp");
    let project = make(&sandbox, "cpp_net", "cpp");
    let program = build_cpp(&sandbox, &project, "src/main.cpp");
    let alone = build_cpp(&sandbox, &project, "tests/detect_test.cpp");
    let ended = sandbox
        .spawn_program("detect_test", &alone, &[], &[])
        .wait();
    assert!(ended.expect_code(0).says("2 passed"));
    let beside = build_cpp(&sandbox, &project, "tests/simulator_test.cpp");
    let (launch, simd) = (project.join("launch.toml"), binary_path("simd"));
    let words = [&program, &launch, &simd].map(|path| path.to_str().unwrap());
    let ended = sandbox
        .spawn_program("simulator_test", &beside, &words, &[])
        .wait_longer(std::time::Duration::from_secs(300))
        .expect_code(0);
    assert!(ended.says("1 passed"), "{:#?}", ended.lines);
    up(&sandbox, &project, &[], &[]).expect_code(0);
}
