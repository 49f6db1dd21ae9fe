//! Runs a launch file, recorded in lockstep, for as many keyframes as are asked for.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::Duration;

use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use launch_cli::programs::find;
use launch_cli::wrong_usage;
use launch_run::{Ending, Output, Process, Program, RunError, domain_name};

use consumer_sets::options::Options;
use consumer_sets::tree::STATE_FOLDER;

/// How many lines of the launcher's log are quoted when it makes no recording.
const QUOTED_LINES: usize = 12;

/// Runs launch files into recordings that are kept in the export's state until it is complete.
#[derive(Debug)]
pub struct Live {
    folder: PathBuf,
}

impl Live {
    /// Nothing is started or written yet.
    ///
    /// # Errors
    /// [`wrong_usage`] if the folder of the export holds anything and the export is not continued,
    /// so that nobody waits for a simulation in vain.
    pub fn new(options: &Options) -> anyhow::Result<Live> {
        let out = &options.out;
        let holds_anything = fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
        if holds_anything && !options.resume {
            return Err(wrong_usage(format!(
                "{} is not empty; give another --out, remove it, or go on with --resume if an export was stopped there",
                out.display()
            )));
        }
        Ok(Live {
            folder: out.join(STATE_FOLDER),
        })
    }

    /// Runs `launch` and returns its recording; a complete one of an export that was stopped is
    /// used again. `None` if it was stopped.
    ///
    /// # Errors
    /// A sentence if the launch file is wrong, or the simulation or the recorder fails.
    pub fn record(
        &self,
        launch: &Path,
        number: usize,
        options: &Options,
        stop: &dyn Fn() -> bool,
    ) -> anyhow::Result<Option<PathBuf>> {
        fs::create_dir_all(&self.folder)
            .with_context(|| format!("cannot write {}", self.folder.display()))?;
        let recording = self.folder.join(format!("launch_{number}.mcap"));
        if recording.exists() {
            return Ok(Some(recording));
        }
        let part = self.folder.join(format!("launch_{number}.mcap.part"));
        if part.exists() {
            fs::remove_file(&part).with_context(|| format!("cannot remove {}", part.display()))?;
        }
        let plan = Plan::read(launch, options)?;
        let overlay = self.folder.join(format!("launch_{number}.toml"));
        fs::write(&overlay, &plan.overlay)
            .with_context(|| format!("cannot write {}", overlay.display()))?;
        let bar = ProgressBar::new_spinner();
        bar.set_style(ProgressStyle::with_template("{spinner} {msg} {elapsed}").expect("constant"));
        bar.set_message(format!(
            "running {} for {} ticks",
            launch.display(),
            plan.n_ticks
        ));
        bar.enable_steady_tick(Duration::from_millis(200));
        let mut launcher = Program::new("gantry up", &find("gantry")?)
            .on_domain(&domain_name("export"))
            .words(["up".as_ref(), launch.as_os_str(), overlay.as_os_str()])
            .words(["--view", "none", "--record"])
            .words([&recording])
            .with_parent()
            .in_own_group()
            .quotes_lines(QUOTED_LINES)
            .start(Output::Log(
                &self.folder.join(format!("launch_{number}.log")),
            ))?;
        let ended = wait(&mut launcher, stop);
        bar.finish_and_clear();
        match ended? {
            None => Ok(None),
            Some(_) if recording.exists() => Ok(Some(recording)),
            Some(status) => anyhow::bail!(
                "{} ran without making a recording ({status}); its last words:\n  {}",
                launch.display(),
                launcher.last_words()
            ),
        }
    }
}

/// Waits for the launcher; ends it if `stop` says so, and then returns `None`.
fn wait(launcher: &mut Process, stop: &dyn Fn() -> bool) -> Result<Option<ExitStatus>, RunError> {
    loop {
        if let Some(status) = launcher.wait(Duration::from_millis(50))? {
            return Ok(Some(status));
        }
        if stop() {
            // It ends its processes in order, which takes as long as it takes.
            launcher.end_by(&Ending::term(Duration::MAX))?;
            return Ok(None);
        }
    }
}

/// What is laid over a launch file so that it makes a repeatable recording of a known length.
#[derive(Debug)]
struct Plan {
    overlay: String,
    n_ticks: u64,
}

/// Why a launch file makes no recording of a known length.
#[derive(Debug, thiserror::Error)]
enum PlanError {
    #[error("it says no scenario.tick_hz")]
    NoTickHz,
    #[error("its simulator has --ticks already; --frames decides here")]
    HasTicks,
    #[error("it starts no simulator (a process whose command is simd)")]
    NoSimulator,
}

impl Plan {
    fn read(launch: &Path, options: &Options) -> anyhow::Result<Plan> {
        let shown = launch.display();
        let output = Command::new(find("gantry")?)
            .args(["up".as_ref(), launch.as_os_str()])
            .args(["--dry-run", "--view", "none"])
            .output()
            .context("cannot start gantry")?;
        let errors = String::from_utf8_lossy(&output.stderr);
        if !output.status.success() {
            return Err(wrong_usage(format!(
                "{shown} cannot be run: {}",
                errors.trim()
            )));
        }
        let text = String::from_utf8_lossy(&output.stdout);
        let file: toml::Table = text
            .parse()
            .with_context(|| format!("gantry up {shown} --dry-run prints no launch file"))?;
        Plan::of(&file, options).map_err(|what| wrong_usage(format!("{shown}: {what}")))
    }

    fn of(file: &toml::Table, options: &Options) -> Result<Plan, PlanError> {
        let number = |value: Option<&toml::Value>| {
            value.and_then(|value| value.as_float().or(value.as_integer().map(|n| n as f64)))
        };
        let tick_hz = number(
            file.get("scenario")
                .and_then(|scenario| scenario.get("tick_hz")),
        )
        .filter(|hz| *hz > 0.0)
        .ok_or(PlanError::NoTickHz)?;
        let sensors = file.get("sensor").and_then(|sensors| sensors.as_table());
        let joined = |sensor: &&toml::Value| {
            let kind = sensor.get("kind").and_then(|kind| kind.as_str());
            matches!(kind, Some("camera" | "lidar"))
        };
        let slowest_hz = sensors
            .into_iter()
            .flat_map(|sensors| sensors.values())
            .filter(joined)
            .filter_map(|sensor| number(sensor.get("rate_hz")))
            .fold(f64::INFINITY, f64::min)
            .min(tick_hz);
        let frames = options.frames.unwrap_or(100).saturating_mul(options.every) as f64;
        let secs = options.from_nanos as f64 * 1e-9 + frames / slowest_hz;
        let secs = options
            .to_nanos
            .map_or(secs, |to| secs.min(to as f64 * 1e-9));
        // Sensors fire in one of the first ticks, and one more is there at the end.
        let n_ticks = ((secs * tick_hz).ceil() as u64).saturating_add(4);
        let processes = file
            .get("process")
            .and_then(|processes| processes.as_table());
        let mut overlay = toml::Table::new();
        let mut has_daemon = false;
        for (name, process) in processes.into_iter().flatten() {
            let Some(mut cmd) = process.get("cmd").and_then(|cmd| cmd.as_array()).cloned() else {
                continue;
            };
            let program = cmd
                .first()
                .and_then(|word| word.as_str())
                .unwrap_or_default()
                .to_string();
            let has = |cmd: &[toml::Value], flag: &str| {
                let words = cmd.iter().filter_map(|word| word.as_str());
                words
                    .into_iter()
                    .any(|word| word == flag || word.starts_with(&format!("{flag}=")))
            };
            let mut changed = toml::Table::new();
            match program.rsplit('/').next() {
                Some("simd") => {
                    has_daemon = true;
                    if has(&cmd, "--ticks") {
                        return Err(PlanError::HasTicks);
                    }
                    cmd.extend(["--ticks".into(), toml::Value::from(n_ticks.to_string())]);
                    if !has(&cmd, "--unpaced") {
                        cmd.push("--unpaced".into());
                    }
                }
                // A driver that the world does not wait for would answer old ticks at this pace.
                Some("gantry-drive") if !has(&cmd, "--lockstep") => {
                    cmd.push("--lockstep".into());
                    changed.insert("lockstep".into(), true.into());
                }
                _ => continue,
            }
            changed.insert("cmd".into(), cmd.into());
            overlay.insert(name.clone(), changed.into());
        }
        if !has_daemon {
            return Err(PlanError::NoSimulator);
        }
        let mut root = toml::Table::new();
        root.insert("version".into(), 1.into());
        root.insert("process".into(), overlay.into());
        Ok(Plan {
            overlay: root.to_string(),
            n_ticks,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use consumer_sets::exporter::Format;

    #[test]
    fn a_launch_file_is_run_in_lockstep_for_as_long_as_its_slowest_sensor_needs() {
        let file = "[scenario]\ntick_hz = 20.0\n[sensor.a]\nkind = \"camera\"\nrate_hz = 10.0\n[sensor.g]\nkind = \"gnss\"\nrate_hz = 1.0\n[process.s]\ncmd = [\"simd\"]\n[process.drive]\ncmd = [\"gantry-drive\"]\n";
        let mut options = Options::new(Format::Coco, "x".into());
        (options.frames, options.every) = (Some(30), 2);
        let plan = Plan::of(&file.parse().expect("TOML"), &options).expect("a plan");
        assert_eq!(plan.n_ticks, 30 * 2 * 2 + 4);
        let overlay: toml::Table = plan.overlay.parse().expect("TOML");
        assert_eq!(
            overlay["process"]["s"]["cmd"].as_array().map(Vec::len),
            Some(4)
        );
        assert_eq!(
            overlay["process"]["drive"]["lockstep"],
            toml::Value::Boolean(true)
        );
        let error = Plan::of(
            &"[scenario]\ntick_hz = 20.0\n".parse().expect("TOML"),
            &options,
        );
        assert!(matches!(error, Err(PlanError::NoSimulator)), "{error:?}");
    }
}
