//! Compares one view of several modalities with one view and one submission per modality, by turns
//! in one run.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_camera::{Quality, Submission};
use sensor_core::Scene;
use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

use crate::Cameras;
use crate::measure::{WARM_UP, cpu_millis, finish};

/// Sets per turn where several submissions may be in flight. A turn pays the latency of the round
/// trip to the GPU once for all its sets.
const SETS_PER_TURN: usize = 16;

/// Times of sets, one per turn: milliseconds per set.
#[derive(Clone, Debug, Default)]
pub struct Turns {
    /// Wall time.
    pub wall_ms: Vec<f64>,
    /// CPU time of the process.
    pub cpu_ms: Vec<f64>,
}

/// Result of a comparison.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// All modalities as one view, one submission per set.
    pub merged: Turns,
    /// One view and one submission per modality.
    pub separate: Turns,
    /// Wall time of each of those submissions, in the order of the modalities; empty if several are
    /// in flight at once.
    pub each_ms: Vec<Vec<f64>>,
}

impl Turns {
    fn ratios<'t>(these: &'t [f64], those: &'t [f64]) -> impl Iterator<Item = f64> + 't {
        these.iter().zip(those).map(|(a, b)| a / b)
    }
}

/// Median of a list.
pub fn median(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let mut numbers: Vec<f64> = numbers.into_iter().collect();
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Smallest number of a list.
pub fn best(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(f64::INFINITY, f64::min)
}

impl Comparison {
    /// Medians of the turns' ratios, wall and CPU time. Other load on the machine disturbs both
    /// sides of a turn alike.
    pub fn ratios(&self) -> [f64; 2] {
        let Comparison {
            merged, separate, ..
        } = self;
        [
            median(Turns::ratios(&separate.wall_ms, &merged.wall_ms)),
            median(Turns::ratios(&separate.cpu_ms, &merged.cpu_ms)),
        ]
    }

    /// Ratios of the best turns, wall and CPU.
    pub fn best_ratios(&self) -> [f64; 2] {
        let Comparison {
            merged, separate, ..
        } = self;
        [
            best(&separate.wall_ms) / best(&merged.wall_ms),
            best(&separate.cpu_ms) / best(&merged.cpu_ms),
        ]
    }
}

/// The views of a comparison. They share one renderer, as the sensors of a daemon do.
pub struct Sides {
    cameras: Cameras,
    n_in_flight: usize,
}

impl Sides {
    /// One view of all `modalities`, and one of each.
    pub fn new(
        gpu: &Gpu,
        quality: Quality,
        lens: Intrinsics,
        modalities: &[Modality],
        n_in_flight: usize,
    ) -> Sides {
        let mut asked = vec![modalities];
        asked.extend(modalities.chunks(1));
        Sides {
            cameras: Cameras::new(gpu, quality, lens, &asked, n_in_flight),
            n_in_flight,
        }
    }

    /// Renders `n_sets` of both kinds; `look` returns the scene and the pose of each set, which all
    /// its views share.
    pub fn run(
        &mut self,
        n_sets: usize,
        mut look: impl FnMut(usize) -> (Arc<Scene>, Isometry3<f64>),
    ) -> Comparison {
        let per_turn = if self.n_in_flight == 1 {
            1
        } else {
            SETS_PER_TURN
        };
        let n_modalities = self.cameras.n_views() - 1;
        let submissions: [Vec<usize>; 2] = [vec![0], (1..=n_modalities).collect()];
        let mut comparison = Comparison {
            each_ms: vec![Vec::new(); n_modalities],
            ..Default::default()
        };
        let n_turns = n_sets.div_ceil(per_turn);
        for turn in 0..n_turns + WARM_UP {
            for (side, views) in submissions.iter().enumerate() {
                let mut each_ms = Vec::new();
                let (begin, cpu_begin) = (Instant::now(), cpu_millis());
                let mut in_flight: VecDeque<Submission<'static>> = VecDeque::new();
                let mut last = begin;
                for set in 0..per_turn {
                    let (scene, pose) = look(turn * per_turn + set);
                    for view in views {
                        while in_flight.len() >= self.n_in_flight {
                            in_flight.pop_front().into_iter().for_each(finish);
                        }
                        in_flight.push_back(self.cameras.submit_one(&scene, &pose, *view));
                        if self.n_in_flight == 1 {
                            in_flight.drain(..).for_each(finish);
                            each_ms.push(last.elapsed().as_secs_f64() * 1e3);
                            last = Instant::now();
                        }
                    }
                }
                in_flight.drain(..).for_each(finish);
                if turn < WARM_UP {
                    continue;
                }
                let turns = if side == 0 {
                    &mut comparison.merged
                } else {
                    &mut comparison.separate
                };
                turns
                    .wall_ms
                    .push(begin.elapsed().as_secs_f64() * 1e3 / per_turn as f64);
                turns
                    .cpu_ms
                    .push((cpu_millis() - cpu_begin) / per_turn as f64);
                if side == 1 {
                    comparison
                        .each_ms
                        .iter_mut()
                        .zip(each_ms)
                        .for_each(|(list, millis)| list.push(millis));
                }
            }
        }
        comparison.each_ms.retain(|list| !list.is_empty());
        comparison
    }
}
