//! `gantry up --replay`: a pipeline that was written for the simulator runs on a recording.

use test_e2e::processes::{python_package, venv_program};
use test_e2e::recording::sequences;
use test_e2e::{SMALL_RIG, assert_nothing_left, spawn_consumer, start_daemon};
use test_kit::Sandbox;

/// Ticks of the recording.
const N_TICKS: &str = "40";

/// A detector in lockstep: it says which ticks it got, slower than they would come by themselves,
/// and publishes a result for each.
const DETECTOR: &str = "import gantry, time
with gantry.open('ego/front/rgb', timeout=60.0) as camera, gantry.publish('detector/mean', 'scalars') as means:
    with gantry.lockstep('detector') as lockstep:
        for tick in lockstep:
            frame = camera.next(timeout=60.0)
            print('tick', frame.tick, int(frame.array.sum()), flush=True)
            means.send(gantry.scalars({'mean': float(frame.array.mean())}), answers=frame)
            time.sleep(0.002)
";

#[test]
fn a_pipeline_gets_every_frame_of_a_recording_and_publishes_its_own_results() {
    let sandbox = Sandbox::new("up-replay");
    let args = ["--unpaced", "--await-lockstep", "1", "--ticks", N_TICKS];
    let daemon = start_daemon(&sandbox, SMALL_RIG, &args);
    let recorder = spawn_consumer(
        &sandbox,
        "gantry-record",
        &["--out", "drive.mcap", "--lockstep"],
    );
    daemon.wait().expect_code(0);
    let recorder = recorder.stop().expect_code(0);
    assert!(
        !recorder.says("cannot learn whether the tick is complete"),
        "the simulator ends once everybody in lockstep is done with its last tick: {:#?}",
        recorder.lines
    );
    let recorded = sequences(&sandbox.path("drive.mcap"));
    let frames = &recorded["/ego/front/rgb/gantry"];
    assert_eq!(frames.len().to_string(), N_TICKS);

    let detector = sandbox.write("detector.py", DETECTOR);
    let pipeline = format!(
        "version = 1\n[process.simd]\ncmd = [\"simd\"]\nrequired = true\nready = {{ service = \"world/snapshot\" }}\n\
         [process.drive]\ncmd = [\"gantry-drive\"]\nafter = [\"simd\"]\n\
         [process.detector]\ncmd = [{:?}, {:?}]\nlockstep = true\n\
         env = {{ PYTHONPATH = {:?}, PYTHONDONTWRITEBYTECODE = \"1\" }}\n",
        venv_program("python"),
        detector,
        python_package(),
    );
    let pipeline = sandbox.write("pipeline.toml", &pipeline);
    let data = sandbox.path("data");
    let words = [
        "up",
        pipeline.to_str().unwrap(),
        "--replay",
        "drive.mcap",
        "--rate",
        "max",
        "--record",
        "again.mcap",
        "--data",
        data.to_str().unwrap(),
        "--domain",
        sandbox.domain(),
    ];
    let ended = sandbox.spawn("gantry", &words).wait().expect_code(0);
    let seen: Vec<&str> = ended
        .lines
        .iter()
        .filter_map(|line| line.split_once("tick ").map(|(_, rest)| rest))
        .filter_map(|rest| rest.split_once(' ').map(|(tick, _)| tick))
        .filter(|tick| tick.parse::<u64>().is_ok())
        .collect();
    let expected: Vec<String> = (1..=40).map(|tick| tick.to_string()).collect();
    assert_eq!(seen, expected, "{:#?}", ended.lines);
    assert!(!ended.says("started drive"), "nobody drives in a recording");
    let again = sequences(&sandbox.path("again.mcap"));
    assert_eq!(again["/ego/front/rgb/gantry"], *frames);
    // The recorder may find the topic only when the first tick is complete, so that it misses its
    // result, but no later one.
    let n_results = again["/detector/mean/gantry"].len();
    assert!((39..=40).contains(&n_results), "{n_results} results of 40");
    assert_nothing_left(&sandbox);
}

#[test]
fn a_recording_that_is_not_there_is_a_sentence() {
    let sandbox = Sandbox::new("up-replay-none");
    let words = [
        "up",
        "--replay",
        "nothing.mcap",
        "--domain",
        sandbox.domain(),
    ];
    let ended = sandbox.spawn("gantry", &words).wait().expect_code(2);
    assert!(
        ended.says("there is no recording nothing.mcap"),
        "{:#?}",
        ended.lines
    );
}
