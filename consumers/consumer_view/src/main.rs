//! `gantry-view`: shows a domain in rerun: in a window, in the browser, or into a file.

use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{ArgGroup, Parser, ValueEnum};
use consumer_view::convert::convert;
use consumer_view::fly;
use consumer_view::session::{Options, Shown, Target, show};
use consumer_view::viewer::{Viewer, ViewerKind, find_rerun};
use launch_cli::{CommonArgs, Exit, Shutdown, run, wrong_usage};

/// Shows every sensor, every result of users' programs, the map and all actors in rerun. Without a
/// choice: a window if there is a display, else a page for the browser.
#[derive(Debug, Parser)]
#[command(
    name = "gantry-view",
    version,
    group = ArgGroup::new("where").args(["native", "web", "save", "connect", "convert", "fly"]),
    after_help = "Examples:\n  gantry-view --native\n  gantry-view --fly\n  gantry-view --web --max-hz 5\n  gantry-view --save drive.rrd && rerun drive.rrd\n  gantry-view --convert drive.mcap drive.rrd"
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

    /// Show the spectator's image too, which is rendered only while it is shown
    #[arg(long, conflicts_with_all = ["fly", "convert"])]
    spectator: bool,

    /// Most frames and results per second and topic that are shown; lines and curves up to 200
    #[arg(long, value_name = "HZ", default_value_t = 10.0, value_parser = rate)]
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

fn rate(text: &str) -> Result<f64, String> {
    let hz: f64 = text.parse().map_err(|_| "not a number".to_string())?;
    if (0.01..=1000.0).contains(&hz) {
        Ok(hz)
    } else {
        Err(format!("{hz} is outside 0.01 to 1000"))
    }
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

fn main() -> ExitCode {
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
                print_shown(output, &convert(input, output)?)?;
                Ok(Exit::Done)
            }
            _ => start(&args),
        }
    })
}

fn start(args: &Args) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    launch_cli::raise_file_limit()?;
    let mut viewer = None;
    let target = match (&args.save, &args.connect) {
        (Some(file), _) if file.exists() => {
            return Err(wrong_usage(format!(
                "{} exists already; choose another name or remove it first",
                file.display()
            )));
        }
        (Some(file), _) => Target::Save(file.clone()),
        (_, Some(url)) => Target::Connect(url.clone()),
        _ => {
            let program = find_rerun(std::env::var_os("PATH").as_deref())?;
            let started = Viewer::start(&program, viewer_kind(args), &args.memory_limit)?;
            let target = Target::Connect(started.data_url.clone());
            viewer = Some(started);
            target
        }
    };
    let mut stdout = std::io::stdout();
    if let Some(page) = viewer.as_ref().and_then(|viewer| viewer.page_url.as_ref()) {
        writeln!(stdout, "open {page}")?;
    }
    tracing::info!(domain = args.common.domain, "viewing");
    let options = Options {
        domain: args.common.domain.clone(),
        bus: Default::default(),
        max_hz: args.max_hz,
        target,
        spectator: args.spectator,
    };
    let mut stop =
        || shutdown.requested() || viewer.as_mut().is_some_and(|viewer| !viewer.is_running());
    let shown = show(&options, &mut stop)?;
    if let Some(file) = &args.save {
        print_shown(file, &shown)?;
    }
    Ok(Exit::Done)
}

/// Shows and flies the spectator.
fn start_flying(args: &Args, in_window: bool) -> anyhow::Result<Exit> {
    let shutdown = Shutdown::install()?;
    let options = fly::Options {
        domain: args.common.domain.clone(),
        bus: Default::default(),
    };
    let mut stop = || shutdown.requested();
    let flown = if in_window {
        let mut window = fly::window::Window::open().map_err(wrong_usage_of)?;
        writeln!(std::io::stdout(), "{}", fly::KEYS)?;
        fly::fly(&options, &mut window, &mut stop)?
    } else {
        let mut terminal = fly::terminal::Terminal::open().map_err(wrong_usage_of)?;
        fly::fly(&options, &mut terminal, &mut stop)?
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

/// Whether one of these environment variables names a display.
fn has_display(variables: &[&str]) -> bool {
    variables
        .iter()
        .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

impl FlyOn {
    /// Whether in a window. Windows are those of X11, which Wayland's desktops have too.
    fn is_window(self) -> bool {
        self == FlyOn::Window || (self == FlyOn::Auto && has_display(&["DISPLAY"]))
    }
}

fn viewer_kind(args: &Args) -> ViewerKind {
    let has_display = has_display(&["DISPLAY", "WAYLAND_DISPLAY"]);
    if args.native || (!args.web && has_display) {
        ViewerKind::Native
    } else {
        ViewerKind::Web
    }
}
