//! What the always-on counters of stages cost: few spans a tick, whatever the scene holds.

use schema_stages::read::Process;
use test_kit::sandbox::repository;
use test_kit::{Setup, Simulator, eventually};

/// Topics of the quickstart's ego.
const TOPICS: [&str; 9] = [
    "ego/front/rgb",
    "ego/front/depth",
    "ego/front/semantic",
    "ego/front/instance",
    "ego/front/flow",
    "ego/front/dvs",
    "ego/roof/lidar",
    "ego/imu/imu",
    "ego/gnss/gnss",
];
/// Stages outside of parallel loops enter about thirty spans a tick.
const SPANS_A_TICK: u64 = 40;
/// A parallel loop enters a span for each of its jobs: rayon splits a loop into two jobs a thread,
/// and further where threads steal.
const SPANS_A_THREAD: u64 = 40;

/// A span costs a microsecond. Opened for each of a thousand slices of events it took a fifth of a
/// GPU machine's speed, so the number of spans must not follow the number of events, rays or tiles.
#[test]
fn a_tick_of_the_quickstart_opens_few_spans() {
    let mut simulator = Simulator::start(Setup::file(repository().join("launch/quickstart.toml")));
    let readers: Vec<_> = TOPICS.map(|topic| simulator.frames(topic)).into();
    simulator.step(4);
    let mut process = Process::new(simulator.daemon().pid());
    // Sums are posted ten times a second, so the posted tick lags behind the last one.
    let mut look_at = |simulator: &mut Simulator, least: u64| {
        eventually("the simulator posts its stages", || {
            simulator.step(1);
            process.look().filter(|look| look.tick >= Some(least))
        })
    };
    let before = look_at(&mut simulator, 4);
    let first = before.tick.expect("a tick was waited for");
    let after = look_at(&mut simulator, first + 20);
    let ticks = after.tick.expect("a tick was waited for") - first;
    let spans: Vec<(String, u64)> = after
        .stages
        .iter()
        // Threads of the graphics driver are counted, not spans.
        .filter(|(name, _)| *name != "render")
        .map(|(name, sums)| {
            let earlier = before.stages.get(name).map_or(0, |sums| sums.n_spans);
            (name.clone(), (sums.n_spans - earlier) / ticks)
        })
        .collect();
    let sum: u64 = spans.iter().map(|(_, n)| n).sum();
    let n_threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let most = SPANS_A_TICK + SPANS_A_THREAD * n_threads;
    println!("{sum} spans a tick: {spans:?}");
    assert!(
        (10..=most).contains(&sum),
        "{sum} spans a tick, at most {most}: {spans:?}"
    );
    let of_events = spans.iter().find(|(name, _)| name == "events");
    assert!(of_events.is_some_and(|(_, n)| *n > 0), "{spans:?}");
    drop(readers);
    simulator.finish();
}
