//! Performance under the keys of NVIDIA's `ros2_benchmark`, one file per run, so that what reads its
//! results reads these: `BasicPerformanceMetrics.*` as its calculator defines them, over all
//! scenarios and for each alone, `BenchmarkMetadata.*`, and what it has no key for under `custom`.

use consumer_report::{Folder, FolderError};
use serde_json::{Map, Value, json};

use super::throughput::Throughput;
use super::types::{Latency, Report, Run};
use crate::capture::Mode;

/// Writes `ros2_benchmark/RUN.json` for every run.
///
/// # Errors
///
/// A file cannot be written.
pub fn write(report: &Report, folder: &mut Folder) -> Result<(), FolderError> {
    for run in &report.runs {
        let name = format!("ros2_benchmark/{}.json", run.file_stem());
        folder.json(&name, &value(report, run))?;
    }
    Ok(())
}

/// The result of a run.
pub fn value(report: &Report, run: &Run) -> Value {
    let parts: Vec<Map<String, Value>> = run
        .scenarios
        .iter()
        .map(|scenario| metrics(&scenario.throughput, &scenario.latency))
        .collect();
    let mut result = together(&parts);
    for (scenario, part) in run.scenarios.iter().zip(parts) {
        result.insert(scenario.scenario.clone(), Value::Object(part));
    }
    result.insert("custom".into(), custom(run));
    result.insert("metadata".into(), metadata(report, run));
    Value::Object(result)
}

fn key(name: &str) -> String {
    format!("BasicPerformanceMetrics.{name}")
}

/// How metrics of several scenarios become one.
#[derive(Clone, Copy)]
enum Over {
    Mean,
    Max,
    Min,
}

/// All metrics, and how the calculator concludes them.
const METRICS: [(&str, Over); 16] = [
    ("RECEIVED_DURATION", Over::Mean),
    ("MEAN_PLAYBACK_FRAME_RATE", Over::Mean),
    ("MEAN_FRAME_RATE", Over::Mean),
    ("NUM_MISSED_FRAMES", Over::Mean),
    ("NUM_FRAMES_SENT", Over::Mean),
    ("FIRST_SENT_RECEIVED_LATENCY", Over::Mean),
    ("LAST_SENT_RECEIVED_LATENCY", Over::Mean),
    ("FIRST_INPUT_LATENCY", Over::Mean),
    ("LAST_INPUT_LATENCY", Over::Mean),
    ("MAX_LATENCY", Over::Max),
    ("MIN_LATENCY", Over::Min),
    ("MEAN_LATENCY", Over::Mean),
    ("MAX_JITTER", Over::Max),
    ("MIN_JITTER", Over::Min),
    ("MEAN_JITTER", Over::Max),
    ("STD_DEV_JITTER", Over::Mean),
];

fn metrics(rates: &Throughput, latency: &Latency) -> Map<String, Value> {
    let some = (rates.n_sent > 0).then_some(());
    let spread = Some(&latency.answer).filter(|it| it.n > 0);
    let jitter = rates.jitter;
    let values = [
        rates.received_ms,
        rates.sent_fps,
        rates.received_fps,
        some.map(|()| rates.n_sent.saturating_sub(rates.n_received) as f64),
        some.map(|()| rates.n_sent as f64),
        rates.first_to_first_ms,
        rates.last_to_last_ms,
        rates.first_latency_ms,
        rates.last_latency_ms,
        spread.map(|it| it.max),
        spread.map(|it| it.min),
        spread.map(|it| it.mean),
        jitter.map(|it| it.max),
        jitter.map(|it| it.min),
        jitter.map(|it| it.mean),
        jitter.map(|it| it.std_dev),
    ];
    let named = METRICS.iter().zip(values);
    named
        .filter_map(|((name, _), value)| Some((key(name), json!(value?))))
        .collect()
}

/// Metrics that every scenario has, over all of them. The calculator first takes away the best and
/// the worst of several equal trials; scenarios differ, so all of them count.
fn together(parts: &[Map<String, Value>]) -> Map<String, Value> {
    let mut all = Map::new();
    for (name, over) in METRICS {
        let name = key(name);
        let values: Vec<f64> = parts
            .iter()
            .filter_map(|part| part.get(&name)?.as_f64())
            .collect();
        if values.is_empty() || values.len() < parts.len() {
            continue;
        }
        let value = match over {
            Over::Mean => values.iter().sum::<f64>() / values.len() as f64,
            Over::Max => values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            Over::Min => values.iter().copied().fold(f64::INFINITY, f64::min),
        };
        all.insert(name, json!(value));
    }
    all
}

fn custom(run: &Run) -> Value {
    let latency: Map<String, Value> = run
        .latency
        .named()
        .into_iter()
        .filter(|(_, spread)| spread.n > 0)
        .map(|(name, it)| {
            let ms = json!({"p50_ms": it.p50, "p90_ms": it.p90, "p99_ms": it.p99, "p99.9_ms": it.p999, "max_ms": it.max});
            (name.to_owned(), ms)
        })
        .collect();
    json!({"mode": run.mode, "speed": run.speed, "cores": run.cores, "latency": latency, "usage": run.usage})
}

fn metadata(report: &Report, run: &Run) -> Value {
    let hashes: Vec<&str> = report
        .scenarios
        .iter()
        .map(|it| it.frames_hash.as_str())
        .collect();
    let live = report
        .settings
        .get("source")
        .is_some_and(|source| source == "live");
    // Their modes: 0 plays a recording by its time line, 2 as fast as asked for, 3 is live.
    let mode = match run.mode {
        _ if live => 3,
        Mode::Stress => 2,
        Mode::Offline | Mode::Streaming => 0,
    };
    json!({
        "BenchmarkMetadata.NAME": format!("{} {}", report.suite, run.label()),
        "BenchmarkMetadata.TEST_DATETIME": report.began,
        "BenchmarkMetadata.DEVICE_ARCH": std::env::consts::ARCH,
        "BenchmarkMetadata.DEVICE_OS": format!("Linux {}", report.machine.kernel).trim_end(),
        "BenchmarkMetadata.BENCHMARK_MODE": mode,
        "BenchmarkMetadata.INPUT_DATA_HASH": hashes.join(","),
        "BenchmarkMetadata.CONFIG": report.suite_text,
    })
}
