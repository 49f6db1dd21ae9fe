//! A made-up report, the same every time: a slow accurate program, a fast crude one, and one that
//! stumbles; two tasks, six scenarios, all modes.

use std::collections::BTreeMap;
use std::path::Path;

use consumer_perception::capture::Mode;
use consumer_perception::report::{
    Counts, CurvePoint, Latency, Machine, ProcessUsage, REPORT_VERSION, Report, ResultEvent, Run,
    ScenarioInfo, ScenarioRun, Spread, Stratum, TaskScore, Throughput, WorstFrame,
};
use fastrand::Rng;

const FRAME_SECS: f64 = 0.05;
const SECS: f64 = 20.0;
const QUERY_HZ: f64 = 200.0;

/// What a made-up program is like.
struct Kind {
    name: &'static str,
    command: &'static [&'static str],
    /// Accuracy without time: AP of boxes, end-point error of flow in pixels.
    ap: f64,
    epe: Option<f64>,
    /// Median milliseconds a frame.
    work_ms: f64,
    /// How much they vary.
    spread: f64,
    /// Share of frames that are never answered.
    dropped: f64,
}

const KINDS: [Kind; 3] = [
    Kind {
        name: "hog",
        command: &["python", "programs/hog.py", "--scale=1.05"],
        ap: 0.612,
        epe: None,
        work_ms: 170.0,
        spread: 0.12,
        dropped: 0.0,
    },
    Kind {
        name: "blobs",
        command: &["programs/blobs"],
        ap: 0.374,
        epe: Some(4.1),
        work_ms: 6.0,
        spread: 0.25,
        dropped: 0.0,
    },
    Kind {
        name: "stumbling <dis>",
        command: &["python", "programs/dis.py", "it's \"quoted\" & <odd>"],
        ap: 0.33,
        epe: Some(1.7),
        work_ms: 28.0,
        spread: 0.6,
        dropped: 0.1,
    },
];

const SCENARIOS: [(&str, &str, &str); 6] = [
    ("town01-clear-noon-light", "noon", "clear"),
    ("town01-rain-night-dense", "night", "rain"),
    ("town03-clear-dusk-dense", "dusk", "clear"),
    ("town03-fog-noon-light", "noon", "fog"),
    ("town05-clear-night-light", "night", "clear"),
    ("town05-rain-noon-dense", "noon", "rain"),
];

/// The report. Pictures of worst frames are written below `folder`.
pub fn report(folder: &Path) -> Report {
    let mut random = Rng::with_seed(15);
    let mut runs = Vec::new();
    for kind in &KINDS {
        let mut modes = vec![(Mode::Offline, 0.0), (Mode::Streaming, 1.0)];
        if kind.name == "hog" {
            modes.push((Mode::Streaming, 0.5));
        }
        if kind.name == "blobs" {
            modes.push((Mode::Stress, 0.0));
        }
        for (mode, speed) in modes {
            runs.push(run(kind, mode, speed, folder, &mut random));
        }
    }
    runs[6].faults = vec!["stumbling <dis> ended with exit code 1 after 214 frames in town05-rain-noon-dense and was started again".into()];
    Report {
        version: REPORT_VERSION,
        suite: "example".into(),
        suite_hash: "9f2c4e".repeat(10) + "9f2c",
        suite_text: "version = 1\nname = \"example\"\nseed = 7\n\n[program.hog]\ncmd = [\"python\", \"programs/hog.py\"]\n".into(),
        command: ["gantry", "bench", "perception", "launch/bench/example.toml"].map(str::to_owned).into(),
        settings: BTreeMap::from([
            ("source".into(), "recording".into()),
            ("simulator cores".into(), "0".into()),
        ]),
        build: "gantry 1.0.0 (0123456789)".into(),
        seed: 7,
        has_drawn_seed: true,
        is_sealed: true,
        given_truth: vec!["noisy/boxes".into()],
        has_crash: true,
        training_maps: vec!["Town02".into()],
        began: "2026-03-01T12:30:00Z".into(),
        took_secs: 642.0,
        machine: Machine {
            cpu: "Example CPU @ 2 GHz".into(),
            n_cpus: 2,
            memory_bytes: 25_000_000_000,
            adapter: "llvmpipe (LLVM 15.0.6, 256 bits)".into(),
            kernel: "6.1.0".into(),
            load: 0.42,
        },
        scenarios: SCENARIOS
            .iter()
            .enumerate()
            .map(|(at, (name, time, weather))| ScenarioInfo {
                name: (*name).into(),
                settings: BTreeMap::from([
                    ("map".into(), name[..6].into()),
                    ("time".into(), (*time).into()),
                    ("weather".into(), (*weather).into()),
                ]),
                secs: SECS,
                frames_hash: format!("{at:02x}").repeat(32),
                query_hz: QUERY_HZ,
            })
            .collect(),
        runs,
        warnings: vec!["the machine was busy when it began: load 2.31 on 2 cores".into()],
    }
}

fn run(kind: &Kind, mode: Mode, speed: f64, folder: &Path, random: &mut Rng) -> Run {
    let scenarios: Vec<ScenarioRun> = SCENARIOS
        .iter()
        .map(|(name, time, _)| scenario(kind, mode, speed, name, *time == "night", folder, random))
        .collect();
    let mut counts = Counts::default();
    for one in &scenarios {
        counts.n_frames += one.counts.n_frames;
        counts.n_answered += one.counts.n_answered;
        counts.n_results += one.counts.n_results;
        counts.n_repeated += one.counts.n_repeated;
        counts.miss += one.counts.miss;
        counts.in_time += one.counts.in_time;
        counts.mismatch += one.counts.mismatch;
        counts.n_queries += one.counts.n_queries;
    }
    let merged =
        |of: fn(&Latency) -> &Spread| Spread::merged(scenarios.iter().map(|it| of(&it.latency)));
    let cpu = (kind.work_ms / 50.0).min(1.0);
    Run {
        program: kind.name.into(),
        command: kind.command.iter().map(|word| (*word).to_owned()).collect(),
        mode,
        speed,
        added_delay_ms: 0.0,
        cores: if kind.name == "hog" {
            vec![1]
        } else {
            Vec::new()
        },
        nice: (kind.name == "hog").then_some(5),
        scores: mean_scores(&scenarios),
        latency: Latency {
            end_to_end: merged(|it| &it.end_to_end),
            answer: merged(|it| &it.answer),
            work: merged(|it| &it.work),
            age_at_use: merged(|it| &it.age_at_use),
        },
        counts,
        usage: vec![
            ProcessUsage {
                process: kind.name.into(),
                of_program: true,
                cpu_cores: cpu,
                cpu_ms_per_frame: kind.work_ms,
                peak_bytes: 180_000_000,
            },
            ProcessUsage {
                process: "replay".into(),
                of_program: false,
                cpu_cores: 0.21,
                cpu_ms_per_frame: 4.2,
                peak_bytes: 90_000_000,
            },
        ],
        faults: Vec::new(),
        scenarios,
    }
}

/// Scores of all scenarios: the mean of theirs, as if all had as many truths.
fn mean_scores(scenarios: &[ScenarioRun]) -> Vec<TaskScore> {
    let n = scenarios.len() as f64;
    let mut scores = scenarios[0].scores.clone();
    for (at, score) in scores.iter_mut().enumerate() {
        let all = || scenarios.iter().map(|it| &it.scores[at]);
        for (name, value) in &mut score.offline {
            *value = all().map(|it| it.offline[name]).sum::<f64>() / n;
        }
        for (name, value) in &mut score.streaming {
            *value = all().map(|it| it.streaming[name]).sum::<f64>() / n;
        }
        for (nth, point) in score.curve.iter_mut().enumerate() {
            point.value = all().map(|it| it.curve[nth].value).sum::<f64>() / n;
        }
        score.n_scored = all().map(|it| it.n_scored).sum();
        score.n_ignored = all().map(|it| it.n_ignored).sum();
    }
    scores
}

fn scenario(
    kind: &Kind,
    mode: Mode,
    speed: f64,
    name: &str,
    is_night: bool,
    folder: &Path,
    random: &mut Rng,
) -> ScenarioRun {
    let n_frames = (SECS / FRAME_SECS) as u64;
    let pace = if mode == Mode::Streaming { speed } else { 1.0 };
    let mut events = Vec::new();
    let (mut latencies, mut works, mut ages) = (Vec::new(), Vec::new(), Vec::new());
    let (mut sent, mut published) = (Vec::new(), Vec::new());
    let (mut free_at, mut frame) = (0.0_f64, 0_u64);
    for seq in 0..n_frames {
        sent.push((seq, (seq as f64 * FRAME_SECS / pace * 1e9) as u64));
    }
    while frame < n_frames {
        let frame_secs = frame as f64 * FRAME_SECS;
        // A sum of twelve even draws is nearly a normal one.
        let normal = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
        let tail = if random.f64() < 0.01 { 3.0 } else { 1.0 };
        let work = kind.work_ms * 1e-3 * (kind.spread * normal).exp() * tail;
        let waits = mode != Mode::Offline;
        let taken = if waits {
            free_at.max(frame_secs + 0.0004 * pace)
        } else {
            frame_secs
        };
        let done = taken + work * pace;
        free_at = done;
        if random.f64() >= kind.dropped {
            let published_secs = if waits { done } else { frame_secs };
            events.push(ResultEvent {
                topic: format!("{}/boxes", kind.name),
                frame_secs,
                taken_secs: taken,
                published_secs,
                seq: frame,
            });
            let wall = |secs: f64| (secs / pace * 1e9).max(1.0) as u64;
            works.push(wall(work * pace));
            ages.push(wall((taken - frame_secs).max(1e-6)));
            latencies.push(wall(taken - frame_secs + work * pace));
            published.push((frame, wall(if waits { done } else { frame_secs + work })));
        }
        // The newest frame when it is free again; every one in lockstep.
        let newest = (free_at / FRAME_SECS).floor() as u64;
        frame = if waits {
            newest.max(frame + 1)
        } else {
            frame + 1
        };
    }
    let streaming = mode == Mode::Streaming;
    let counts = counts(&events, n_frames, streaming);
    let light = if is_night { 0.72 } else { 1.0 } * (0.95 + 0.1 * random.f64());
    let lag_ms = kind.work_ms * pace * 1.5 + 10.0;
    let mut scores = vec![boxes(kind, mode, light, lag_ms)];
    if let Some(epe) = kind.epe {
        scores.push(flow(kind, mode, epe / light, lag_ms));
    }
    if mode == Mode::Stress {
        scores.clear();
    }
    let spread = |nanos: &[u64]| Spread::of(nanos.iter().copied());
    let worst = if streaming {
        pictures(kind, name, folder, random)
    } else {
        Vec::new()
    };
    ScenarioRun {
        scenario: name.into(),
        pace: streaming.then_some(speed * 0.998),
        scores,
        latency: Latency {
            end_to_end: spread(&latencies),
            answer: spread(&latencies),
            work: spread(&works),
            age_at_use: spread(&ages),
        },
        throughput: Throughput::of(&sent, &published),
        counts,
        frame_secs: if streaming {
            (0..n_frames).map(|it| it as f64 * FRAME_SECS).collect()
        } else {
            Vec::new()
        },
        events: if streaming { events } else { Vec::new() },
        worst,
    }
}

fn counts(events: &[ResultEvent], n_frames: u64, streaming: bool) -> Counts {
    let mut counts = Counts {
        n_frames,
        n_answered: events.len() as u64,
        n_results: events.len() as u64,
        ..Counts::default()
    };
    if streaming {
        counts.n_queries = (SECS * QUERY_HZ) as u64;
        for query in 0..counts.n_queries {
            let now = query as f64 / QUERY_HZ;
            let newest_frame = (now / FRAME_SECS).floor() as u64;
            match events
                .iter()
                .rev()
                .find(|event| event.published_secs <= now)
            {
                None => counts.miss += 1,
                Some(event) => {
                    counts.in_time += u64::from(event.seq >= newest_frame);
                    counts.mismatch += newest_frame.saturating_sub(event.seq);
                }
            }
        }
    }
    counts
}

fn boxes(kind: &Kind, mode: Mode, light: f64, lag_ms: f64) -> TaskScore {
    let late = |delay_ms: f64| (-(lag_ms + delay_ms) / 220.0).exp();
    let ap = kind.ap * light;
    let streaming = mode == Mode::Streaming;
    let values = |ap: f64| {
        let named = [
            ("AP", 1.0),
            ("AP50", 1.45),
            ("AP75", 0.93),
            ("APs", 0.4),
            ("APm", 0.9),
            ("APl", 1.3),
            ("AP/car", 1.1),
            ("AP/person", 0.9),
        ];
        named
            .iter()
            .map(|(name, times)| ((*name).to_owned(), (ap * times).min(1.0)))
            .collect::<BTreeMap<_, _>>()
    };
    let mut strata = Vec::new();
    for (at, part) in ["0-10", "10-20", "20-30", "30-50", "50-80"]
        .iter()
        .enumerate()
    {
        let far = 1.0 - 0.19 * at as f64;
        strata.push(stratum(
            "distance_m",
            part,
            900 - 150 * at as u64,
            ap * 1.4 * far,
            streaming.then(|| ap * 1.4 * far * late(0.0).powf(1.4 - 0.2 * at as f64)),
        ));
    }
    for (part, times) in [
        ("0-25 %", 1.2),
        ("25-50 %", 0.9),
        ("50-75 %", 0.5),
        ("75-100 %", 0.2),
    ] {
        strata.push(stratum(
            "occlusion",
            part,
            300,
            ap * times,
            streaming.then(|| ap * times * late(0.0)),
        ));
    }
    for (part, times) in [("day", 1.1), ("dusk", 1.0), ("night", 0.75)] {
        strata.push(stratum(
            "light",
            part,
            700,
            ap * times,
            streaming.then(|| ap * times * late(0.0)),
        ));
    }
    TaskScore {
        task: "boxes2d".into(),
        topic: format!("{}/boxes", kind.name),
        headline: "AP".into(),
        unit: String::new(),
        higher_is_better: true,
        offline: values(ap),
        streaming: if streaming {
            values(ap * late(0.0))
        } else {
            BTreeMap::new()
        },
        curve: curve(streaming, |delay| ap * late(delay)),
        strata,
        n_scored: 2871,
        n_ignored: 310,
    }
}

fn flow(kind: &Kind, mode: Mode, epe: f64, lag_ms: f64) -> TaskScore {
    let late = |delay_ms: f64| epe + (lag_ms + delay_ms) * 0.03;
    let streaming = mode == Mode::Streaming;
    let values = |epe: f64| {
        BTreeMap::from([
            ("EPE".to_owned(), epe),
            ("Fl".to_owned(), 5.0 * epe),
            ("3px".to_owned(), 6.0 * epe),
        ])
    };
    TaskScore {
        task: "flow".into(),
        topic: format!("{}/flow", kind.name),
        headline: "EPE".into(),
        unit: "px".into(),
        higher_is_better: false,
        offline: values(epe),
        streaming: if streaming {
            values(late(0.0))
        } else {
            BTreeMap::new()
        },
        curve: curve(streaming, late),
        strata: ["moving", "static", "occluded"]
            .iter()
            .zip([1.8, 0.7, 2.4])
            .map(|(part, times)| {
                stratum(
                    "what",
                    part,
                    90_000,
                    epe * times,
                    streaming.then(|| late(0.0) * times),
                )
            })
            .collect(),
        n_scored: 12_000_000,
        n_ignored: 0,
    }
}

fn stratum(by: &str, part: &str, n: u64, offline: f64, streaming: Option<f64>) -> Stratum {
    Stratum {
        by: by.into(),
        part: part.into(),
        n,
        offline: Some(offline.min(1e3)),
        streaming,
    }
}

fn curve(streaming: bool, value: impl Fn(f64) -> f64) -> Vec<CurvePoint> {
    let delays = [
        0.0, 10.0, 20.0, 33.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0,
    ];
    let points = delays.iter().map(|delay_ms| CurvePoint {
        delay_ms: *delay_ms,
        value: value(*delay_ms),
    });
    points.filter(|_| streaming).collect()
}

/// A street in a few rectangles, the result's box shifted.
fn pictures(kind: &Kind, scenario: &str, folder: &Path, random: &mut Rng) -> Vec<WorstFrame> {
    let folder_name = "pictures";
    std::fs::create_dir_all(folder.join(folder_name)).unwrap();
    let stem: String = kind
        .name
        .chars()
        .filter(char::is_ascii_alphabetic)
        .collect();
    (0..2)
        .map(|nth| {
            let (x, shift) = (60 + random.u32(0..120), random.u32(18..50));
            let names = ["truth", "result"]
                .map(|what| format!("{folder_name}/{stem}-{scenario}-{nth}-{what}.jpg"));
            for (at, name) in names.iter().enumerate() {
                let mut picture = image::RgbImage::from_fn(320, 180, |_, row| match row {
                    0..80 => image::Rgb([120, 150, 190]),
                    80..100 => image::Rgb([90, 110, 80]),
                    _ => image::Rgb([70, 70, 74]),
                });
                let left = x + if at == 1 { shift } else { 0 };
                let colour = if at == 1 {
                    [230, 120, 40]
                } else {
                    [60, 220, 120]
                };
                for (row, column) in
                    (0..180).flat_map(|row| (0..320).map(move |column| (row, column)))
                {
                    let (in_x, in_y) = ((x..x + 60).contains(&column), (85..130).contains(&row));
                    if in_x && in_y {
                        picture.put_pixel(column, row, image::Rgb([150, 30, 40]));
                    }
                    let in_box = (left..left + 60).contains(&column) && in_y;
                    let is_edge = column == left || column == left + 59 || row == 85 || row == 129;
                    if in_box && is_edge {
                        picture.put_pixel(column, row, image::Rgb(colour));
                    }
                }
                picture.save(folder.join(name)).unwrap();
            }
            let [truth_image, result_image] = names;
            WorstFrame {
                task: "boxes2d".into(),
                secs: 3.0 + f64::from(nth) * 4.35,
                why: format!(
                    "box of car {} overlaps by {:.2}; {shift} px behind",
                    100 + nth,
                    1.0 - f64::from(shift) / 60.0
                ),
                truth_image,
                result_image,
            }
        })
        .collect()
}
