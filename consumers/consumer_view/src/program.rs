//! `gantry-view`: shows a domain in rerun: in a window, in the browser, or into a file.

use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::convert::convert;
use crate::look::{Images, Look};
use crate::screenshot::{self, Scratch, Size};
use crate::session::{Options, Shown, Target, show};
use crate::viewer::{Viewer, ViewerKind, find_rerun};
use clap::{ArgGroup, Parser, ValueEnum};
use launch_cli::browser::{has_display, has_x11_display, open_page};
use launch_cli::values::number;
use launch_cli::{CommonArgs, Exit, Shutdown, run, wrong_usage};

/// Shows every sensor, every result of users' programs, the map and all actors in rerun. Without a
/// choice: a window if there is a display, else a page for the browser.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-view",
    version,
    group = ArgGroup::new("where").args(["native", "web", "save", "connect", "convert", "fly", "screenshot"]),
    after_help = "Examples:\n  gantry-view --native\n  gantry-view --fly\n  gantry-view --web --images h264 --max-hz 5\n  gantry-view --topics 'ego/*' 'detector/*'\n  gantry-view --screenshot report.png --size 1920x1080\n  gantry-view --save drive.rrd && rerun drive.rrd\n  gantry-view --convert drive.mcap drive.rrd"
)]
struct Args {
    /// Show a window (the rerun viewer, started and ended with this program)
    #[arg(long)]
    native: bool,

    /// Show a page for the browser on 127.0.0.1
    #[arg(long)]
    web: bool,

    /// Write a new file that `rerun FILE` opens; never overwrites
    #[arg(long, value_name = "FILE.rrd")]
    save: Option<PathBuf>,

    /// Send to a viewer that already runs, e.g. rerun+http://127.0.0.1:9876/proxy
    #[arg(long, value_name = "URL")]
    connect: Option<String>,

    /// Write a recording of gantry-record as a new file that rerun opens, every frame of it
    #[arg(long, num_args = 2, value_names = ["IN.mcap", "OUT.rrd"])]
    convert: Option<Vec<PathBuf>>,

    /// Fly the spectator in a window of its own, or in this terminal where there is no display:
    /// W A S D Q E and Shift fly, the mouse looks around, N and P follow actors, T looks from above
    #[arg(long, value_name = "WHERE", num_args = 0..=1, require_equals = true, default_missing_value = "auto")]
    fly: Option<FlyOn>,

    /// Draw the window into a new PNG, when every topic has been seen, and end; needs no display
    #[arg(long, value_name = "FILE.png")]
    screenshot: Option<PathBuf>,

    /// Size of that window; the picture has two pixels for each point of it
    #[arg(
        long,
        value_name = "WIDTHxHEIGHT",
        default_value = "1600x1000",
        requires = "screenshot"
    )]
    size: Size,

    /// Do not open the page in a browser; without a display it is never opened
    #[arg(long)]
    no_open: bool,

    /// Divide the window as this file says, which rerun's viewer saved with "Save blueprint"
    #[arg(long, value_name = "FILE.rbl", conflicts_with_all = ["save", "connect", "convert", "fly"])]
    blueprint: Option<PathBuf>,

    /// Show these topics only; patterns with * and ?, e.g. 'ego/*' '*/boxes'
    #[arg(long, value_name = "PATTERN", num_args = 1.., conflicts_with_all = ["convert", "fly"])]
    topics: Vec<String>,

    /// How images go to the viewer
    #[arg(
        long,
        value_name = "FORM",
        value_enum,
        default_value_t,
        conflicts_with = "fly"
    )]
    images: Images,

    /// Quality of JPEGs, 1 to 100
    #[arg(long, value_name = "N", default_value_t = 80, value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: u8,

    /// Most points that are shown of a cloud; larger ones are thinned evenly
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    max_points: u32,

    /// Leave out the boxes of actors that are drawn over images from their instance ids
    #[arg(long)]
    no_truth: bool,

    /// Show events also as a time surface: how long ago each pixel changed
    #[arg(long)]
    time_surface: bool,

    /// Show the spectator's image too, which is rendered only while it is shown
    #[arg(long, conflicts_with_all = ["fly", "convert"])]
    spectator: bool,

    /// Most frames and results per second and topic that are shown; lines and curves up to 200
    #[arg(long, value_name = "HZ", default_value_t = 10.0, value_parser = number("rate in Hz", 0.01..=1000.0))]
    max_hz: f64,

    /// Most memory the viewer keeps for its past, e.g. 2GB; the oldest goes first
    #[arg(long, value_name = "SIZE", default_value = "2GB", value_parser = memory)]
    memory_limit: String,

    #[command(flatten)]
    common: CommonArgs,
}

/// Where to fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FlyOn {
    /// A window if there is a display, else this terminal.
    Auto,
    /// A window.
    Window,
    /// This terminal.
    Terminal,
}

fn memory(text: &str) -> Result<String, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let known = ["MB", "GB", "MiB", "GiB"].contains(&&text[digits.len()..]);
    if known && digits.parse::<u32>().is_ok_and(|n| n > 0) {
        Ok(text.to_string())
    } else {
        Err("must be a whole number and MB or GB, e.g. 2GB".to_string())
    }
}

/// The program `gantry-view`, from its arguments to its exit code.
pub fn main() -> ExitCode {
    run(|args: Args| {
        let fly_in_window = args.fly.map(|on| on.is_window());
        // In a terminal that shows an image, lines of a log would tear it.
        if fly_in_window != Some(false) || !std::io::stderr().is_terminal() {
            args.common.init_logging();
        }
        if let Some(in_window) = fly_in_window {
            return start_flying(&args, in_window);
        }
        match args.convert.as_deref() {
            Some([input, output]) => {
                print_shown(output, &convert(input, output, &args.look())?)?;
                Ok(Exit::Done)
            }
            _ => start(&args),
        }
    })
}

fn start(args: &Args) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    launch_cli::raise_file_limit()?;
    for file in [&args.save, &args.screenshot].into_iter().flatten() {
        if file.exists() {
            return Err(wrong_usage(format!(
                "{} exists already; choose another name or remove it first",
                file.display()
            )));
        }
    }
    if let Some(file) = &args.blueprint
        && !file.is_file()
    {
        return Err(wrong_usage(format!(
            "{} is no file; save one with \"Save blueprint\" in rerun's viewer",
            file.display()
        )));
    }
    if let Some(picture) = &args.screenshot {
        return start_drawing(args, picture, &shutdown);
    }
    let mut viewer = None;
    let target = match (&args.save, &args.connect) {
        (Some(file), _) => Target::Save(file.clone()),
        (_, Some(url)) => Target::Connect(url.clone()),
        _ => {
            let program = find_rerun(std::env::var_os("PATH").as_deref())?;
            let kind = viewer_kind(args);
            let blueprint = args.blueprint.as_deref();
            let started = Viewer::start(&program, kind, &args.memory_limit, blueprint)?;
            let target = Target::Connect(started.data_url.clone());
            viewer = Some(started);
            target
        }
    };
    let mut stdout = std::io::stdout();
    if let Some(page) = viewer.as_ref().and_then(|viewer| viewer.page_url.as_ref()) {
        writeln!(stdout, "open {page}")?;
        if !args.no_open && has_display() {
            open_page(page);
        }
    }
    tracing::info!(domain = args.common.domain, "viewing");
    let options = args.options(target);
    let mut stop =
        || shutdown.requested() || viewer.as_mut().is_some_and(|viewer| !viewer.is_running());
    let shown = show(&options, &mut stop)?;
    if let Some(file) = &args.save {
        print_shown(file, &shown)?;
    }
    Ok(Exit::Done)
}

/// Shows until every topic has been seen, and draws that.
fn start_drawing(args: &Args, picture: &Path, shutdown: &Shutdown) -> anyhow::Result<Exit> {
    let program = find_rerun(std::env::var_os("PATH").as_deref())?;
    let scratch = Scratch::beside(picture);
    let options = Options {
        enough: Some(FRAMES_TO_DRAW),
        ..args.options(Target::Save(scratch.path().to_owned()))
    };
    let begun = std::time::Instant::now();
    let mut stop = || shutdown.requested() || begun.elapsed() > DRAW_AFTER;
    let shown = show(&options, &mut stop)?;
    if shown.frames.is_empty() && shown.results.is_empty() {
        return Err(wrong_usage(format!(
            "nothing was to be seen on domain {:?} for {} s; start something with `gantry up`, or name another with --domain",
            args.common.domain,
            begun.elapsed().as_secs()
        )));
    }
    let blueprint = args.blueprint.as_deref();
    // Who asked for the end while topics were awaited gets a picture of those that were seen.
    let was_asked = shutdown.requested();
    let stop = || shutdown.requested() && !was_asked;
    screenshot::draw(&program, &scratch, blueprint, picture, args.size, &stop)?;
    print_shown(picture, &shown)?;
    Ok(Exit::Done)
}

/// Frames of every topic behind a picture: curves need some.
const FRAMES_TO_DRAW: u64 = 10;
/// How long a picture waits for topics that send nothing.
const DRAW_AFTER: std::time::Duration = std::time::Duration::from_secs(30);

impl Args {
    fn look(&self) -> Look {
        Look {
            images: self.images,
            quality: self.quality,
            max_points: self.max_points as usize,
            truth: !self.no_truth,
            time_surface: self.time_surface,
            arranges: self.blueprint.is_none(),
        }
    }

    fn options(&self, target: Target) -> Options {
        Options {
            domain: self.common.domain.clone(),
            bus: Default::default(),
            max_hz: self.max_hz,
            look: self.look(),
            topics: self.topics.clone(),
            target,
            spectator: self.spectator,
            enough: None,
        }
    }
}

/// Shows and flies the spectator.
fn start_flying(args: &Args, in_window: bool) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let options = consumer_fly::Options {
        domain: args.common.domain.clone(),
        bus: Default::default(),
    };
    let mut stop = || shutdown.requested();
    let flown = if in_window {
        let mut window = consumer_fly::window::Window::open().map_err(wrong_usage_of)?;
        writeln!(std::io::stdout(), "{}", consumer_fly::KEYS)?;
        consumer_fly::fly(&options, &mut window, &mut stop)?
    } else {
        let mut terminal = consumer_fly::terminal::Terminal::open().map_err(wrong_usage_of)?;
        consumer_fly::fly(&options, &mut terminal, &mut stop)?
    };
    writeln!(std::io::stdout(), "{} images shown", flown.n_images)?;
    Ok(Exit::Done)
}

fn wrong_usage_of(error: anyhow::Error) -> anyhow::Error {
    wrong_usage(format!("{error:#}"))
}

/// Says what a file holds.
fn print_shown(file: &Path, shown: &Shown) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    let n_frames: u64 = shown.frames.values().sum();
    let n_results: u64 = shown.results.values().sum();
    writeln!(
        stdout,
        "{}: {n_frames} frames of {} topics, {n_results} results of {} topics",
        file.display(),
        shown.frames.len(),
        shown.results.len()
    )?;
    for (topic, n) in &shown.bad_items {
        writeln!(stdout, "{topic}: {n} items were broken and not drawn")?;
    }
    Ok(())
}

impl FlyOn {
    /// Whether in a window. Windows are those of X11, which Wayland's desktops have too.
    fn is_window(self) -> bool {
        self == FlyOn::Window || (self == FlyOn::Auto && has_x11_display())
    }
}

fn viewer_kind(args: &Args) -> ViewerKind {
    if args.native || (!args.web && has_display()) {
        ViewerKind::Native
    } else {
        ViewerKind::Web
    }
}
