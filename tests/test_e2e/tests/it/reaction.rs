//! The measurer of reaction times, measured: programs with a delay that is known exactly
//! (`examples/reaction_fake.rs`) run under `gantry-bench reaction` on a road of its own, and what it
//! says is compared with what they wrote down themselves.

use std::collections::BTreeMap;
use std::time::Duration;

use consumer_perception::reaction::suite::Kind;
use consumer_perception::reaction::summary::{BRAKES, KindReport, Reactions, StageReport};
use test_e2e::assert_nothing_left;
use test_kit::sandbox::binary_path;
use test_kit::{Ended, Process, Sandbox, eventually};

/// A straight, level road of 500 m with three lanes and a light at its end.
const ROAD: &str = r#"<?xml version="1.0"?>
<OpenDRIVE><header revMajor="1" revMinor="6" name="straight"/>
<road id="1" length="500" junction="-1"><link/><planView><geometry s="0" x="0" y="0" hdg="0" length="500"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>
<lane id="-1" type="driving"><width sOffset="0" a="3.6" b="0" c="0" d="0"/></lane>
<lane id="-2" type="driving"><width sOffset="0" a="3.6" b="0" c="0" d="0"/></lane>
<lane id="-3" type="driving"><width sOffset="0" a="3.6" b="0" c="0" d="0"/></lane></right></laneSection></lanes>
<signals><signal id="9" s="300" t="-12" dynamic="yes" orientation="+" type="1000001" value="-1"><validity fromLane="-3" toLane="-1"/></signal></signals></road>
<controller id="1"><control signalId="9"/></controller>
</OpenDRIVE>"#;

/// Ticks are long, so that a delay of 80 ms ends before the next image.
const TICK_HZ: u64 = 10;

/// What a run says, and what the fake programs wrote down.
struct Run {
    reactions: Reactions,
    /// Moments before and after publication by (what, tick).
    log: BTreeMap<(String, u64), (u64, u64)>,
    ended: Ended,
}

impl Run {
    fn kind(&self, kind: Kind) -> &KindReport {
        self.reactions
            .kinds
            .iter()
            .find(|it| it.kind == kind)
            .unwrap_or_else(|| panic!("no {kind:?}:\n{}", self.ended.lines.join("\n")))
    }

    fn stage(&self, kind: Kind, name: &str) -> &StageReport {
        let kind = self.kind(kind);
        let stage = kind.stages.iter().find(|it| it.stage == name);
        stage.unwrap_or_else(|| panic!("no {name} in {kind:?}\n{}", self.ended.lines.join("\n")))
    }
}

/// Reactions, misses and false alarms.
fn counts(stage: &StageReport) -> (u32, u32, u32) {
    (stage.n_reactions, stage.n_misses, stage.n_false_alarms)
}

/// Writes a suite for fake programs (name, mode and delay of each) and starts `gantry-bench reaction`.
fn start(sandbox: &Sandbox, name: &str, programs: &[(&str, &str, u64)], suite: &str) -> Process {
    sandbox.write("straight.xodr", ROAD);
    let log = sandbox.path("log.txt");
    let fake = binary_path("examples/reaction_fake");
    let mut launch = format!(
        "version = 1\n[scenario]\nmap = \"straight.xodr\"\ntick_hz = {TICK_HZ}\n\
         [ego]\nspawn_point = 0\n[sensor.front]\nkind = \"camera\"\nwidth_px = 96\nheight_px = 64\n\
         rate_hz = {TICK_HZ}\nmount.position_m = [0.6, 0.0, 1.6]\n\
         [process.simd]\ncmd = [\"simd\"]\nrequired = true\nready = {{ service = \"world/info\" }}\n"
    );
    for (name, mode, delay) in programs {
        launch += &format!(
            "[process.{name}]\ncmd = [{fake:?}, {mode:?}, \"{delay}\", {log:?}]\nafter = [\"simd\"]\n"
        );
    }
    sandbox.write("chain.toml", &launch);
    let suite = format!(
        "version = 1\nname = {name:?}\nlaunch = [\"chain.toml\"]\nseed = 5\nspeed_mps = 5.0\n\
         road_m = 250\nsettle_s = 0.6\nwait_s = [0.3, 0.8]\nwindow_s = 1.5\n\
         truth = {{ sensor = \"front\", width_px = 160, height_px = 96 }}\n{suite}"
    );
    let file = sandbox.write("suite.toml", &suite);
    let words = ["reaction", file.to_str().unwrap(), "--out", "out"];
    sandbox.spawn("gantry-bench", &words)
}

/// Runs a suite for fake programs to its end.
fn run(name: &str, programs: &[(&str, &str, u64)], suite: &str) -> Run {
    let sandbox = Sandbox::new(name);
    let ended = start(&sandbox, name, programs, suite).wait_longer(Duration::from_secs(900));
    let json = std::fs::read_to_string(sandbox.path("out/reaction.json")).unwrap_or_else(|_| {
        let up = std::fs::read_to_string(sandbox.path("out/processes/1/up.log"));
        panic!("{}\n{}", ended.lines.join("\n"), up.unwrap_or_default())
    });
    let reactions = serde_json::from_str(&json).unwrap();
    let text = std::fs::read_to_string(sandbox.path("log.txt")).unwrap_or_default();
    let noted = text.lines().map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        let number = |at: usize| words[at].parse::<u64>().unwrap();
        ((words[0].to_owned(), number(1)), (number(2), number(3)))
    });
    let log = noted.collect();
    assert_nothing_left(&sandbox);
    Run {
        reactions,
        log,
        ended,
    }
}

const EYE: &str = "[[stage]]\nname = \"eye\"\ntopic = \"fake/boxes\"\ndistance_m = 0.5\n";
const FOOT: &str = "[[stage]]\nname = \"foot\"\ncontrol = \"foot\"\n";
const PEOPLE: &str = "[kind.pedestrian_steps_out]\ndistance_m = [12, 20]\n";

#[test]
fn known_delays_are_measured_to_a_millisecond() {
    let programs = [("eye", "see", 80), ("foot", "brake", 30)];
    let run = run(
        "known",
        &programs,
        &format!("trials = 6\n{PEOPLE}{EYE}{FOOT}"),
    );
    let kind = Kind::PedestrianStepsOut;
    assert_eq!(
        counts(run.stage(kind, "eye")),
        (6, 0, 0),
        "{:#?}",
        run.reactions.trials
    );
    assert_eq!(
        counts(run.stage(kind, "foot")),
        (6, 0, 0),
        "{:#?}",
        run.reactions.trials
    );
    assert_eq!(run.stage(kind, BRAKES).n_reactions, 6);
    let mut quickest_nanos = [u64::MAX; 2];
    for trial in &run.reactions.trials {
        let stimulus = trial.stimulus.expect("it was seen");
        let [eye, foot, _] = &trial.stages[..] else {
            panic!("{trial:?}")
        };
        let (eye, foot) = (eye.reaction.unwrap(), foot.reaction.unwrap());
        assert_eq!(eye.tick, stimulus.tick, "{trial:?}");
        // What the programs wrote down is what was measured.
        let told = |what: &str| {
            let (before, after) = run.log[&(what.to_owned(), stimulus.tick)];
            before - stimulus.mono_nanos..=after - stimulus.mono_nanos
        };
        let sent = told("box");
        assert!(sent.contains(&eye.wall_nanos), "{sent:?}: {eye:?}");
        quickest_nanos[0] = quickest_nanos[0].min(sent.end() - sent.start());
        // A control carries no time: it is seen at most one look later, which is said.
        let (sent, seen) = (told("brake"), foot.wall_nanos);
        assert!(
            *sent.start() <= seen && seen <= sent.end() + foot.within_nanos,
            "{sent:?}: {foot:?}"
        );
        let late = seen.saturating_sub(sent.start() + foot.within_nanos);
        quickest_nanos[1] = quickest_nanos[1].min(late);
        // The delays themselves, which a busy machine can only make longer.
        let sensor = eye.sensor_nanos.expect("it answers a frame");
        assert!(eye.wall_nanos - sensor >= 80_000_000, "{eye:?}");
        assert!(foot.wall_nanos - eye.wall_nanos >= 30_000_000, "{foot:?}");
    }
    // On a busy machine a program may wait between its clock and its publication, but not each time.
    assert!(
        quickest_nanos.iter().all(|nanos| *nanos < 1_000_000),
        "{quickest_nanos:?}"
    );
    let report = run.stage(kind, "foot");
    assert_eq!(report.step_ms.n, 6);
    assert!(report.step_ms.min >= 30.0, "{report:?}");
}

#[test]
fn an_answer_two_frames_later_is_two_frames_late() {
    let run = run(
        "later",
        &[("eye", "later", 2)],
        &format!("trials = 3\n{PEOPLE}{EYE}"),
    );
    assert_eq!(
        counts(run.stage(Kind::PedestrianStepsOut, "eye")),
        (3, 0, 0),
        "{:#?} {:?}",
        run.reactions.trials,
        run.log
    );
    for trial in &run.reactions.trials {
        let (stimulus, eye) = (trial.stimulus.unwrap(), trial.stages[0].reaction.unwrap());
        assert_eq!(eye.tick, stimulus.tick + 2);
        assert!(eye.sim_nanos >= 2 * 1_000_000_000 / TICK_HZ, "{eye:?}");
    }
}

#[test]
fn a_chain_that_never_reacts_has_only_misses() {
    let programs = [("eye", "blind", 0), ("foot", "brake", 0)];
    let run = run(
        "blind",
        &programs,
        &format!("trials = 3\n{PEOPLE}{EYE}{FOOT}"),
    );
    let kind = Kind::PedestrianStepsOut;
    for stage in ["eye", "foot", BRAKES] {
        assert_eq!(counts(run.stage(kind, stage)), (0, 3, 0), "{stage}");
    }
    assert_eq!(run.stage(kind, "eye").wall_ms.n, 0);
    // It looked at every image, so it was not absent.
    assert!(
        run.reactions
            .trials
            .iter()
            .all(|it| it.stages[0].n_results > 5)
    );
}

#[test]
fn a_chain_that_always_shouts_has_only_false_alarms() {
    let programs = [("eye", "shout", 0), ("foot", "brake", 0)];
    let run = run(
        "shout",
        &programs,
        &format!("trials = 3\n{PEOPLE}{EYE}{FOOT}"),
    );
    let kind = Kind::PedestrianStepsOut;
    for stage in ["eye", "foot"] {
        assert_eq!(counts(run.stage(kind, stage)), (0, 0, 3), "{stage}");
        assert!(run.stage(kind, stage).n_alarming_results >= 6, "{stage}");
    }
}

#[test]
fn a_crash_fails_its_own_trial_and_no_other() {
    let programs = [("eye", "fall", 10), ("foot", "brake", 0)];
    let run = run(
        "fall",
        &programs,
        &format!("trials = 4\n{PEOPLE}{EYE}{FOOT}"),
    );
    let report = run.kind(Kind::PedestrianStepsOut);
    assert_eq!((report.n_trials, report.n_counted), (4, 3), "{report:?}");
    assert_eq!(
        report.failed["eye ended with exit code 3"], 1,
        "{:?}",
        report.failed
    );
    assert_eq!(
        counts(run.stage(Kind::PedestrianStepsOut, "eye")),
        (3, 0, 0)
    );
    run.ended.expect_code(0);
}

#[test]
fn cars_that_cut_in_or_brake_and_lights_show_at_the_tick_they_change() {
    let stages = "[[stage]]\nname = \"red\"\ntopic = \"fake/words\"\nkinds = [\"light_turns_red\"]\ncontains = \"red\"\n\
        [[stage]]\nname = \"lamps\"\ntopic = \"fake/words\"\nkinds = [\"lead_brakes\"]\ncontains = \"lamps\"\n\
        [[stage]]\nname = \"in path\"\ntopic = \"fake/boxes\"\nkinds = [\"cut_in\"]\ndistance_m = 0.5\npath_half_m = 1.2\n";
    let kinds = "[kind.light_turns_red]\ndistance_m = [20, 30]\n[kind.lead_brakes]\ndistance_m = [12, 18]\n\
        [kind.cut_in]\ndistance_m = [10, 14]\nspeed_mps = [5, 6]\nside = \"right\"\n";
    let run = run(
        "kinds",
        &[("words", "states", 0)],
        &format!("trials = 2\n{kinds}{stages}"),
    );
    assert_eq!(
        counts(run.stage(Kind::LightTurnsRed, "red")),
        (2, 0, 0),
        "{:#?}",
        run.reactions.trials
    );
    assert_eq!(
        counts(run.stage(Kind::LeadBrakes, "lamps")),
        (2, 0, 0),
        "{:#?}",
        run.reactions.trials
    );
    assert_eq!(
        counts(run.stage(Kind::CutIn, "in path")),
        (2, 0, 0),
        "{:#?}",
        run.reactions.trials
    );
    for trial in &run.reactions.trials {
        let (stimulus, said) = (trial.stimulus.unwrap(), trial.stages[0].reaction.unwrap());
        match trial.plan.kind {
            // Its side needs time to reach the path after it has begun to move.
            Kind::CutIn => assert!(said.tick > stimulus.tick, "{trial:?}"),
            _ => assert_eq!(said.tick, stimulus.tick, "{trial:?}"),
        }
    }
}

#[test]
fn a_killed_benchmark_takes_its_processes_with_it() {
    let sandbox = Sandbox::new("killed");
    let suite = format!("trials = 500\n{PEOPLE}{EYE}");
    let bench = start(&sandbox, "killed", &[("eye", "see", 0)], &suite);
    let here = sandbox.dir().to_str().expect("paths are UTF-8").to_owned();
    let log = sandbox.path("log.txt");
    eventually("the fake sees a person", || {
        std::fs::metadata(&log)
            .is_ok_and(|it| it.len() > 0)
            .then_some(())
    });
    bench.kill9();
    // The simulator and the fake program name files of this sandbox.
    eventually("its processes have ended", || {
        let commands = std::fs::read_dir("/proc")
            .ok()?
            .flatten()
            .filter_map(|entry| std::fs::read_to_string(entry.path().join("cmdline")).ok());
        (commands.filter(|it| it.contains(&here)).count() == 0).then_some(())
    });
}
