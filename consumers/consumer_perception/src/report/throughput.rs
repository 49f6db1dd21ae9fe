//! Rates and jitter by the wall clock, by the definitions of NVIDIA's `ros2_benchmark`
//! (`BasicPerformanceCalculator`): sent is a frame's publication, received its first result's.

use std::collections::HashMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Rates and jitter of one run of one scenario. What has too few frames to exist is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Throughput {
    /// Frames that were sent.
    pub n_sent: u64,
    /// Frames with at least one result.
    pub n_received: u64,
    /// Frames sent per second.
    pub sent_fps: Option<f64>,
    /// Frames answered per second.
    pub received_fps: Option<f64>,
    /// From the first result to the last, milliseconds.
    pub received_ms: Option<f64>,
    /// From the first frame to the first result, milliseconds.
    pub first_to_first_ms: Option<f64>,
    /// From the last frame to the last result, milliseconds.
    pub last_to_last_ms: Option<f64>,
    /// Latency of the first frame that was answered, milliseconds.
    pub first_latency_ms: Option<f64>,
    /// Latency of the last frame that was answered, milliseconds.
    pub last_latency_ms: Option<f64>,
    /// How much the time between one result and the next changes, milliseconds.
    pub jitter: Option<Jitter>,
}

/// Absolute differences between one gap between results and the next, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Jitter {
    /// Smallest.
    pub min: f64,
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
    /// Standard deviation (of the population).
    pub std_dev: f64,
}

fn ms(from: u64, to: u64) -> f64 {
    (to as f64 - from as f64) / 1e6
}

impl Throughput {
    /// Of frames and results, each with the frame's key (any number that tells frames apart) and the
    /// time of its publication, nanoseconds of one clock, in order of time. Only the first result
    /// of a frame counts, and only of frames that were sent.
    pub fn of(sent: &[(u64, u64)], published: &[(u64, u64)]) -> Throughput {
        let sent_at: HashMap<u64, u64> = sent.iter().copied().collect();
        let mut received: Vec<(u64, u64)> = Vec::new();
        let mut seen = HashMap::new();
        for (key, at) in published {
            if sent_at.contains_key(key) && seen.insert(*key, *at).is_none() {
                received.push((*key, *at));
            }
        }
        let mut it = Throughput {
            n_sent: sent.len() as u64,
            n_received: received.len() as u64,
            ..Throughput::default()
        };
        let rate = |n: usize, ms: f64| (ms > 0.0).then(|| n as f64 / (ms / 1000.0));
        if let [(_, first), .., (_, last)] = sent {
            it.sent_fps = rate(sent.len(), ms(*first, *last));
        }
        let (Some((_, first_sent)), Some((_, last_sent))) = (sent.first(), sent.last()) else {
            return it;
        };
        let (Some((_, first)), Some((_, last))) = (received.first(), received.last()) else {
            return it;
        };
        let received_ms = ms(*first, *last);
        it.received_ms = Some(received_ms);
        it.received_fps = rate(received.len(), received_ms);
        it.first_to_first_ms = Some(ms(*first_sent, *first));
        it.last_to_last_ms = Some(ms(*last_sent, *last));
        let mut answered = sent
            .iter()
            .filter_map(|(key, at)| Some(ms(*at, *seen.get(key)?)));
        it.first_latency_ms = answered.next();
        it.last_latency_ms = answered.next_back().or(it.first_latency_ms);
        let gaps: Vec<f64> = received.windows(2).map(|w| ms(w[0].1, w[1].1)).collect();
        let changes: Vec<f64> = gaps.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
        if !changes.is_empty() {
            let n = changes.len() as f64;
            let mean = changes.iter().sum::<f64>() / n;
            let variance = changes.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / n;
            it.jitter = Some(Jitter {
                min: changes.iter().copied().fold(f64::INFINITY, f64::min),
                mean,
                max: changes.iter().copied().fold(0.0, f64::max),
                std_dev: variance.sqrt(),
            });
        }
        it
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn rates_latencies_and_jitter_are_those_of_the_definition() {
        let sent = [(1, 0), (2, 100 * MS), (3, 200 * MS), (4, 300 * MS)];
        // Frame 2 has two results, frame 3 none, frame 9 was never sent.
        let published = [
            (1, 30 * MS),
            (2, 140 * MS),
            (2, 150 * MS),
            (9, 160 * MS),
            (4, 350 * MS),
        ];
        let found = Throughput::of(&sent, &published);
        let expected = Throughput {
            n_sent: 4,
            n_received: 3,
            sent_fps: Some(4.0 / 0.3),
            received_fps: Some(3.0 / 0.32),
            received_ms: Some(320.0),
            first_to_first_ms: Some(30.0),
            last_to_last_ms: Some(50.0),
            first_latency_ms: Some(30.0),
            last_latency_ms: Some(50.0),
            jitter: Some(Jitter {
                min: 100.0,
                mean: 100.0,
                max: 100.0,
                std_dev: 0.0,
            }),
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn too_few_frames_give_no_rate() {
        assert_eq!(Throughput::of(&[], &[(1, 5)]), Throughput::default());
        let one = Throughput::of(&[(1, 0)], &[(1, 5 * MS)]);
        assert_eq!((one.n_sent, one.n_received), (1, 1));
        assert_eq!(
            (one.sent_fps, one.received_fps, one.jitter),
            (None, None, None)
        );
        assert_eq!(
            (one.first_latency_ms, one.last_latency_ms),
            (Some(5.0), Some(5.0))
        );
    }
}
