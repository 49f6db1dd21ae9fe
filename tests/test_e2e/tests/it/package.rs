//! What `./gantry package` makes, installed as a user does it: into an empty virtual environment, in
//! an empty home, far from the repository. Nothing there may reach back into it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use test_e2e::carla::{empty_town, free_port, run_script};
use test_e2e::venv_program;
use test_kit::sandbox::{binary_path, repository};
use test_kit::{Process, Sandbox};

/// Most that a user has to fetch.
const MOST_BYTES: u64 = 60_000_000;
/// Far beyond what packing or installing takes on any machine.
const LIMIT: Duration = Duration::from_secs(900);

/// Packs the programs that were built as this kind of package; returns its file.
fn pack(sandbox: &Sandbox, kind: &str, folder: &str) -> PathBuf {
    let script = repository().join("launch/package/package.py");
    let built = binary_path("launch_all");
    let built = built.parent().expect("a program is in a folder");
    let out = sandbox.path(folder);
    let words = [
        text(&script),
        "--binaries",
        text(built),
        "--only",
        kind,
        "--out",
        text(&out),
    ];
    sandbox
        .spawn_program("package", &venv_program("python"), &words, &[])
        .wait_longer(LIMIT)
        .expect_code(0);
    let mut made = std::fs::read_dir(&out)
        .expect("the folder was made")
        .map(|entry| entry.expect("readable").path());
    let package = made.next().expect("a package");
    assert!(made.next().is_none(), "one package");
    package
}

/// The program that starts with this file calls itself so.
fn assert_named(sandbox: &Sandbox, name: &str, file: &Path) {
    let ended = sandbox
        .spawn_program("named", file, &["--version"], &[])
        .wait()
        .expect_code(0);
    assert!(ended.says(&format!("{name} ")), "{:?}", ended.lines);
}

fn text(path: &Path) -> &str {
    path.to_str().expect("paths are UTF-8")
}

/// A virtual environment with the wheel, as a user's.
struct Installed<'a> {
    sandbox: &'a Sandbox,
    bin: PathBuf,
    home: PathBuf,
}

impl<'a> Installed<'a> {
    fn new(sandbox: &'a Sandbox, wheel: &Path) -> Installed<'a> {
        let place = sandbox.path("installed");
        let home = sandbox.path("home");
        std::fs::create_dir(&home).expect("an empty home");
        let python = venv_program("python");
        sandbox
            .spawn_program("venv", &python, &["-m", "venv", text(&place)], &[])
            .wait_longer(LIMIT)
            .expect_code(0);
        let installed = Installed {
            sandbox,
            bin: place.join("bin"),
            home,
        };
        let words = ["install", "--no-index", "--no-deps", "-q", text(wheel)];
        installed
            .start("pip", &words)
            .wait_longer(LIMIT)
            .expect_code(0);
        // numpy comes from the tests' own environment, so that no test needs a network.
        installed.python(
            "import pathlib, sys; print(sys.version_info >= (3, 10))\nfor site in sys.path:\n if site.endswith('site-packages'): \
             pathlib.Path(site, 'numpy.pth').write_text(sys.argv[1])",
            &[&packages_of(sandbox)],
        );
        installed
    }

    /// Starts a program of the environment as a user's shell does, whose search path leads to the
    /// environment and the system alone.
    fn start(&self, program: &str, words: &[&str]) -> Process {
        let path = format!("{}:/usr/bin:/bin", text(&self.bin));
        let env = [
            ("HOME", text(&self.home)),
            ("PATH", path.as_str()),
            ("PYTHONPATH", ""),
            ("GANTRY_DOMAIN", self.sandbox.domain()),
        ];
        self.sandbox
            .spawn_program(program, &self.bin.join(program), words, &env)
    }

    /// Runs a short program, which must end well; returns what it printed.
    fn python(&self, code: &str, words: &[&str]) -> Vec<String> {
        let words: Vec<&str> = ["-c", code].iter().chain(words).copied().collect();
        self.start("python", &words)
            .wait_longer(LIMIT)
            .expect_code(0)
            .lines
    }
}

/// Where the tests' own Python environment has its packages.
fn packages_of(sandbox: &Sandbox) -> String {
    let code = "import sysconfig; print('in', sysconfig.get_path('purelib'))";
    let ended = sandbox
        .spawn_program("python", &venv_program("python"), &["-c", code], &[])
        .wait()
        .expect_code(0);
    let line = ended.lines.iter().find_map(|line| line.split_once("in "));
    line.expect("a path").1.trim().to_owned()
}

#[test]
fn one_wheel_holds_everything() {
    let sandbox = Sandbox::new("package");
    let wheel = pack(&sandbox, "wheel", "one");
    let again = pack(&sandbox, "wheel", "two");
    assert_eq!(wheel.file_name(), again.file_name());
    assert!(
        std::fs::read(&wheel).expect("readable") == std::fs::read(&again).expect("readable"),
        "the same programs were packed into other bytes"
    );

    let installed = Installed::new(&sandbox, &wheel);
    let version = installed
        .start("gantry", &["--version", "--verbose"])
        .wait()
        .expect_code(0);
    assert!(version.says("commit: "), "{:?}", version.lines);
    let size = wheel.metadata().expect("a file").len();
    assert!(size <= MOST_BYTES, "the wheel has {size} bytes");

    // A program that was called by a link from elsewhere, as some installers make, and one that starts
    // itself again.
    let link = sandbox.path("viewer");
    std::os::unix::fs::symlink(installed.bin.join("gantry-view"), &link).expect("a link");
    assert_named(&sandbox, "gantry-view", &link);
    let words = ["bench", "latency", "--sizes", "1000", "--readers", "1"];
    let words = [&words[..], &["--rate", "200", "--count", "50"]].concat();
    installed
        .start("gantry", &words)
        .wait_longer(LIMIT)
        .expect_code(0);

    // The quickstart, whose launch file is inside the program.
    installed
        .start("gantry", &["up", "--for", "3s", "--view", "save:drive.rrd"])
        .wait_longer(LIMIT)
        .expect_code(0);
    let drive = sandbox.path("drive.rrd");
    assert!(drive.metadata().expect("a recording").len() > 100_000);

    // The Python package finds the daemon, and both are the installed ones.
    let file = sandbox.write("town.toml", test_e2e::SMALL_RIG);
    let mut daemon = installed.start("simd", &["--launch", text(&file)]);
    daemon.wait_line("ready");
    let name = std::fs::read_to_string(format!("/proc/{}/comm", daemon.pid()));
    assert_eq!(name.expect("it runs").trim(), "simd");
    let lines = installed.python(
        "import gantry\nwith gantry.open('ego/front/rgb') as topic:\n frame = next(iter(topic))\n \
         print('at', gantry.__file__, 'shape', frame.image.shape)",
        &[],
    );
    let line = lines.iter().find(|line| line.contains("at ")).expect("at");
    assert!(line.contains(text(&sandbox.path("installed"))), "{line}");
    daemon.stop().expect_code(0);

    // CARLA's client finds what it needs.
    let file = sandbox.write("carla.toml", &empty_town("Town10HD"));
    let mut daemon = installed.start("simd", &["--launch", text(&file)]);
    daemon.wait_line("ready");
    let port = free_port().to_string();
    let data = sandbox.path("data");
    let words = ["--port", port.as_str(), "--data", text(&data)];
    let mut gateway = installed.start("gantry-carla", &words);
    gateway.wait_line("listening on");
    let words = [port.as_str(), &free_port().to_string()];
    run_script(&sandbox, "carla_workflow.py", &words, &["ego", "sensors"]);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn a_tarball_holds_one_file_and_links_to_it() {
    let sandbox = Sandbox::new("tarball");
    let file = pack(&sandbox, "tar", "one");
    let place = sandbox.path("unpacked");
    std::fs::create_dir(&place).expect("a folder");
    let words = [
        "-xf",
        text(&file),
        "-C",
        text(&place),
        "--strip-components=1",
    ];
    sandbox
        .spawn_program("tar", Path::new("/bin/tar"), &words, &[])
        .wait_longer(LIMIT)
        .expect_code(0);
    let names = std::fs::read_dir(place.join("bin")).expect("a folder");
    let mut n_links = 0;
    for path in names.map(|entry| entry.expect("readable").path()) {
        let name = path.file_name().expect("files have names");
        let name = name.to_str().expect("names are UTF-8").to_owned();
        n_links += u32::from(path.is_symlink());
        assert_named(&sandbox, &name, &path);
        let page = place.join(format!("share/man/man1/{name}.1.gz"));
        assert!(page.is_file(), "{}", page.display());
    }
    assert!(n_links >= 12, "{n_links} links");
    // Programs in C and C++ are built with what lies beside them.
    for file in [
        "include/gantry/gantry.hpp",
        "lib/libgantry.so.1",
        "lib/pkgconfig/gantry.pc",
        "lib/cmake/gantry/gantry-config.cmake",
    ] {
        assert!(place.join(file).is_file(), "{file}");
    }
}
