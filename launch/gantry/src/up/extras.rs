//! What `--replay`, `--keep-up`, `--record`, `--view` and `--desk` change in a launch file.

use std::path::Path;

use launch_spec::{Launch, Period, Process, Restart, Stop};

use crate::cli::{UpArgs, ViewMode};

/// The launch file with what `--replay`, `--keep-up`, `--record`, `--view` and `--desk` ask for.
pub fn with_extras(mut launch: Launch, args: &UpArgs) -> Launch {
    if let Some(file) = &args.replay {
        replay_into(&mut launch, file, args.rate.as_deref());
    }
    if args.keep_up {
        let simulators = launch.processes.iter_mut().filter(|it| it.is_simulator());
        simulators.for_each(|simulator| simulator.cmd.push("--keep-up".into()));
    }
    if let Some(file) = &args.record {
        // In lockstep the world waits for the disk: nothing is lost, from the first tick on.
        let cmd = vec![
            "gantry-record".into(),
            "--lockstep".into(),
            "--out".into(),
            file.display().to_string(),
        ];
        // Required, so that a run without its recording does not look like a success.
        let recorder = Extra {
            name: "record",
            cmd,
            stop: Some(finishes_a_file()),
            required: true,
            lockstep: true,
        };
        recorder.put_into(&mut launch);
    }
    match args.view.as_ref().map(view_command) {
        None => {}
        Some(None) => launch.processes.retain(|process| process.name != "view"),
        Some(Some(cmd)) => {
            let saves = matches!(args.view, Some(ViewMode::Save(_)));
            let viewer = Extra {
                name: "view",
                cmd,
                stop: saves.then(finishes_a_file),
                required: false,
                lockstep: false,
            };
            viewer.put_into(&mut launch);
        }
    }
    if args.desk {
        let desk = Extra {
            name: "desk",
            cmd: vec!["gantry-desk".into()],
            stop: None,
            required: false,
            lockstep: false,
        };
        desk.put_into(&mut launch);
    }
    launch
}

/// How a program is stopped that then writes what is queued, and perhaps an index.
fn finishes_a_file() -> Stop {
    Stop {
        grace: Period::from_millis(60_000),
        ..Stop::default()
    }
}

/// Programs of Gantry that act on the world. A recording cannot be acted on.
const DRIVERS: [&str; 1] = ["gantry-drive"];

/// Puts a recording in the simulator's place, under its name, so that what comes after it still does.
fn replay_into(launch: &mut Launch, file: &Path, rate: Option<&str>) {
    let drives = |process: &Process| {
        let program = process.cmd.first().map(Path::new);
        program
            .and_then(Path::file_name)
            .is_some_and(|name| DRIVERS.iter().any(|driver| name == *driver))
    };
    let dropped: Vec<String> = launch
        .processes
        .extract_if(.., |process| drives(process))
        .map(|process| process.name)
        .collect();
    for process in &mut launch.processes {
        process.after.retain(|name| !dropped.contains(name));
    }
    let rate = rate.map(|rate| ["--rate".to_owned(), rate.to_owned()]);
    // The processes make results of their own, on topics that the recording may have too.
    let words = ["--results".to_owned(), "none".to_owned()];
    let idle_s = launch.scenario.lockstep_timeout_s;
    let timeout = (idle_s > 0.0).then(|| ["--lockstep-timeout".to_owned(), idle_s.to_string()]);
    let cmd: Vec<String> = ["gantry-replay".to_owned(), file.display().to_string()]
        .into_iter()
        .chain(words)
        .chain(rate.into_iter().flatten())
        .chain(timeout.into_iter().flatten())
        .collect();
    match launch
        .processes
        .iter_mut()
        .find(|process| process.is_daemon())
    {
        Some(daemon) => daemon.cmd = cmd,
        None => {
            let replay = Extra {
                name: "replay",
                cmd,
                stop: None,
                required: true,
                lockstep: false,
            };
            replay.put_into(launch);
        }
    }
}

/// A process that a flag asks for.
struct Extra {
    name: &'static str,
    cmd: Vec<String>,
    /// How it ends where the launch file says nothing of it; `None` is the default there.
    stop: Option<Stop>,
    required: bool,
    /// Whether it takes part in lockstep, if there is a daemon.
    lockstep: bool,
}

impl Extra {
    /// Replaces the process of this name, or adds it behind the daemon.
    fn put_into(self, launch: &mut Launch) {
        let Extra {
            name,
            cmd,
            stop,
            required,
            lockstep,
        } = self;
        let daemon = launch
            .processes
            .iter()
            .find(|process| process.is_daemon())
            .map(|process| process.name.clone());
        let env = launch
            .processes
            .first()
            .map(|process| process.env.clone())
            .unwrap_or_default();
        if let Some(process) = launch
            .processes
            .iter_mut()
            .find(|process| process.name == name)
        {
            process.cmd = cmd;
            if process.stop == Stop::default() {
                process.stop = stop.unwrap_or(process.stop);
            }
            process.required |= required;
            process.lockstep |= lockstep && daemon.is_some();
            if let Some(name) = daemon.filter(|name| lockstep && !process.after.contains(name)) {
                process.after.push(name);
            }
            return;
        }
        launch.processes.push(Process {
            name: name.into(),
            cmd,
            cwd: None,
            venv: None,
            required,
            ready: None,
            lockstep: lockstep && daemon.is_some(),
            after: daemon.into_iter().collect(),
            restart: Restart::default(),
            stop: stop.unwrap_or_default(),
            env,
            cores: Vec::new(),
            nice: None,
            params: None,
        });
    }
}

fn view_command(mode: &ViewMode) -> Option<Vec<String>> {
    let words: Vec<String> = match mode {
        ViewMode::None => return None,
        // The viewer chooses by itself: a window if there is a display, else a page.
        ViewMode::Auto => vec![],
        ViewMode::Native => vec!["--native".into()],
        ViewMode::Web => vec!["--web".into()],
        // A process of a launch has no terminal of its own.
        ViewMode::Fly => vec!["--fly=window".into()],
        ViewMode::Save(file) => vec!["--save".into(), file.display().to_string()],
    };
    Some(
        std::iter::once("gantry-view".to_owned())
            .chain(words)
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    fn up(words: &[&str]) -> UpArgs {
        let args = crate::cli::Args::try_parse_from(["gantry", "up"].iter().chain(words)).unwrap();
        let crate::cli::Word::Up(up) = args.word else {
            panic!("up is up")
        };
        up
    }

    const LAUNCH: &str = "version = 1\n[process.world]\ncmd = [\"simd\"]\n[process.view]\ncmd = [\"gantry-view\"]\nstop = { grace = \"9s\" }\n\
        [process.other]\ncmd = [\"sh\", \"-c\", \"${domain} ${name} ${run_dir}\"]\nafter = [\"world\"]\n";

    fn launch(words: &[&str]) -> Launch {
        with_extras(Launch::parse(LAUNCH, "x").unwrap(), &up(words))
    }

    #[test]
    fn only_the_simulator_is_told_to_keep_up() {
        let told = |args: &[&str]| {
            let launch = launch(args);
            let has = |process: &&Process| process.cmd.iter().any(|word| word == "--keep-up");
            let names = launch.processes.iter().filter(has);
            names
                .map(|process| process.name.clone())
                .collect::<Vec<_>>()
        };
        assert_eq!(told(&["--keep-up"]), ["world"]);
        assert_eq!(told(&["--record", "a.mcap"]), [""; 0]);
    }

    #[test]
    fn record_and_view_become_processes_after_the_daemon() {
        let both = launch(&["--record", "a.mcap", "--view", "save:b.rrd"]);
        let record = both.process("record").unwrap();
        assert_eq!(
            record.cmd,
            ["gantry-record", "--lockstep", "--out", "a.mcap"]
        );
        assert_eq!(both.process("world").unwrap().cmd, ["simd"]);
        assert!(record.lockstep && record.required);
        assert_eq!(record.after, ["world"]);
        let view = both.process("view").unwrap();
        assert_eq!(view.cmd, ["gantry-view", "--save", "b.rrd"]);
        assert_eq!(
            view.stop.grace,
            Period::from_millis(9_000),
            "what the file says of its view holds"
        );
        let fly = launch(&["--view", "fly"]);
        assert_eq!(
            fly.process("view").unwrap().cmd,
            ["gantry-view", "--fly=window"]
        );
        assert!(launch(&["--view", "none"]).process("view").is_none());
        assert!(launch(&[]).process("view").is_some());
    }

    #[test]
    fn a_recording_takes_the_simulators_place_and_drivers_go() {
        let driven = format!(
            "{LAUNCH}[process.drive]\ncmd = [\"gantry-drive\"]\nafter = [\"world\"]\n\
             [process.detector]\ncmd = [\"sh\"]\nlockstep = true\nafter = [\"drive\"]\n"
        );
        let args = up(&["--replay", "drive.mcap", "--rate", "max"]);
        let launch = with_extras(Launch::parse(&driven, "x").unwrap(), &args);
        let world = launch.process("world").unwrap();
        assert_eq!(
            world.cmd.join(" "),
            "gantry-replay drive.mcap --results none --rate max"
        );
        assert!(world.is_daemon() && !world.is_simulator());
        assert!(launch.process("drive").is_none(), "nobody can drive in it");
        let detector = launch.process("detector").unwrap();
        assert_eq!(detector.after, ["world"], "it follows the recording");
        let patient = driven.replace(
            "version = 1\n",
            "version = 1\n[scenario]\nlockstep_timeout_s = 2.5\n",
        );
        assert_ne!(patient, driven);
        let launch = with_extras(Launch::parse(&patient, "x").unwrap(), &args);
        let cmd = launch.process("world").unwrap().cmd.join(" ");
        assert!(cmd.ends_with(" --lockstep-timeout 2.5"), "{cmd}");
        let alone = with_extras(
            Launch::parse("version = 1\n[process.a]\ncmd = [\"sh\"]\n", "x").unwrap(),
            &up(&["--replay", "drive.mcap"]),
        );
        assert!(alone.process("replay").unwrap().required);
    }
}
