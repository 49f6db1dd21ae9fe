//! `gantry-view --save` beside a real daemon, and what rerun then draws of the file, without a
//! display.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use schema_types::Class;
use test_e2e::{SMALL_RIG, assert_nothing_left, spawn_consumer, start_daemon, venv_program};
use test_kit::{Process, Sandbox, eventually};

/// An RGB image.
struct Picture {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    fn read(path: &Path) -> Option<Picture> {
        let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).ok()?));
        let mut reader = decoder.read_info().ok()?;
        let mut bytes = vec![0; reader.output_buffer_size()?];
        let info = reader.next_frame(&mut bytes).ok()?;
        let n = info.color_type.samples();
        let pixels = bytes[..info.buffer_size()]
            .chunks_exact(n)
            .map(|p| [p[0], p[1], p[2]])
            .collect();
        Some(Picture {
            width: info.width as usize,
            pixels,
        })
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// The pixels of a part, given as shares of the whole image's width and height.
    fn part(&self, x: Range<f64>, y: Range<f64>) -> Vec<[u8; 3]> {
        let scaled = |range: Range<f64>, n: usize| {
            (range.start * n as f64) as usize..(range.end * n as f64) as usize
        };
        let (columns, rows) = (scaled(x, self.width), scaled(y, self.height()));
        rows.flat_map(|row| {
            self.pixels[row * self.width..][columns.clone()]
                .iter()
                .copied()
        })
        .collect()
    }

    /// The view in a row and column of the grid of cameras, without its title and the rim.
    fn view(&self, row: usize, column: usize) -> Vec<[u8; 3]> {
        // The cameras have 1.35 of 2.35 parts of the width in three columns, and 3 of 4.3 parts of
        // the height in three rows.
        let (width, height) = (1.35 / 2.35 / 3.0, (1.0 - 0.04) * 3.0 / 4.3 / 3.0);
        let (left, top) = (column as f64 * width, 0.04 + row as f64 * height);
        self.part(
            left + 0.02..left + width - 0.02,
            top + 0.05..top + height - 0.01,
        )
    }
}

/// Counts the pixels of about this colour.
fn count(pixels: &[[u8; 3]], rgb: [u8; 3]) -> usize {
    pixels
        .iter()
        .filter(|pixel| (0..3).all(|i| pixel[i].abs_diff(rgb[i]) <= 3))
        .count()
}

/// Different colours, coarsely.
fn n_colours(pixels: &[[u8; 3]]) -> usize {
    pixels
        .iter()
        .map(|pixel| pixel.map(|channel| channel >> 3))
        .collect::<BTreeSet<_>>()
        .len()
}

/// Views a running daemon and traffic into `drive.rrd` until the file has `n_bytes`, then asks the
/// viewer to end.
fn view(sandbox: &Sandbox, n_bytes: u64) -> (Process, Process) {
    let daemon = start_daemon(sandbox, SMALL_RIG, &[]);
    let driver = spawn_consumer(sandbox, "gantry-drive", &[]);
    let viewer = spawn_consumer(sandbox, "gantry-view", &["--save", "drive.rrd"]);
    let file = sandbox.path("drive.rrd");
    eventually("the file grows", || {
        std::fs::metadata(&file)
            .is_ok_and(|file| file.len() > n_bytes)
            .then_some(())
    });
    let ended = viewer.stop().expect_code(0);
    assert!(ended.says("frames of 11 topics"), "{:?}", ended.lines);
    (daemon, driver)
}

fn rerun(sandbox: &Sandbox, args: &[&str]) -> Vec<String> {
    let env = [("DO_NOT_TRACK", "1"), ("RUST_LOG", "warn")];
    sandbox
        .spawn_program("rerun", &venv_program("rerun"), args, &env)
        .wait()
        .expect_code(0)
        .lines
}

#[test]
fn the_saved_file_is_whole_and_rerun_draws_every_view_of_it() {
    let sandbox = Sandbox::new("view");
    let (daemon, driver) = view(&sandbox, 2_000_000);
    driver.stop().expect_code(0);
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
    rerun(&sandbox, &["rrd", "verify", "drive.rrd"]);
    let shot = [
        "--headless",
        "--port",
        "auto",
        "--bind",
        "127.0.0.1",
        "--window-size",
        "1280x720",
        "--screenshot-to",
        "shot.png",
        "drive.rrd",
    ];
    rerun(&sandbox, &shot);
    if let Some(folder) = std::env::var_os("GANTRY_KEEP") {
        std::fs::copy(
            sandbox.path("shot.png"),
            Path::new(&folder).join("viewer.png"),
        )
        .expect("folder to keep pictures in");
    }
    let picture = Picture::read(&sandbox.path("shot.png")).expect("a readable picture");
    let [rgb, depth, semantic] = [0, 1, 2].map(|column| picture.view(0, column));
    let [instance, flow, dvs] = [0, 1, 2].map(|column| picture.view(1, column));
    let normals = picture.view(2, 0);
    let classes = [
        Class::ROADS,
        Class::SIDEWALKS,
        Class::BUILDINGS,
        Class::VEGETATION,
        Class::SKY,
        Class::CAR,
    ];
    let shares = classes.map(|class| {
        count(&semantic, class.info().expect("named").rgb) as f64 / semantic.len() as f64
    });
    assert!(shares[0] > 0.05, "the road has its colour: {shares:?}");
    assert!(
        shares.iter().filter(|share| **share > 0.005).count() >= 4,
        "{classes:?} have {shares:?} of the view"
    );
    let found = [
        ("rgb", &rgb, 60),
        ("depth", &depth, 30),
        ("instance", &instance, 6),
        ("flow", &flow, 6),
        ("dvs", &dvs, 3),
        ("normals", &normals, 3),
    ];
    for (name, pixels, least) in found {
        assert!(
            n_colours(pixels) >= least,
            "the view of {name} has only {} colours",
            n_colours(pixels)
        );
    }
    // Messages of rerun may cover the upper half.
    let world = picture.part(0.6..0.98, 0.55..0.95);
    assert!(
        n_colours(&world) >= 12,
        "map, cloud and boxes stand in the world: {} colours",
        n_colours(&world)
    );
    let plots = picture.part(0.0..0.57, 0.75..0.95);
    assert!(
        n_colours(&plots) >= 6,
        "curves are drawn: {} colours",
        n_colours(&plots)
    );
}
