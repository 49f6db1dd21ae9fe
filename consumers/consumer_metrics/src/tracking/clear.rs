//! CLEAR MOT: misses, false alarms and switches, with matches that stay as they are while they can.

use super::scores::Scores;
use super::sequence::{ROUNDING, Sequence};
use crate::assignment::{Pair, best_pairs};
use crate::numbers::{mean, share};

/// Worth of staying with the track of the frame before; more than any likeness.
const LOYALTY: f64 = 1000.0;

#[derive(Clone, Debug, Default)]
pub(super) struct Counts {
    n_truths: u64,
    n_results: u64,
    n_matched: u64,
    likeness: f64,
    n_switches: u64,
    n_fragmentations: u64,
    n_mostly_tracked: u64,
    n_partly_tracked: u64,
    n_mostly_lost: u64,
}

/// What became of a truth so far.
#[derive(Clone, Copy, Debug, Default)]
struct Fate {
    n_frames: u64,
    n_matched: u64,
    /// How often it was taken up.
    n_beginnings: u64,
    /// Its track when it last had one.
    track: Option<usize>,
    /// Its track in the frame before.
    current: Option<usize>,
}

impl Counts {
    pub(super) fn add(&mut self, sequence: &Sequence, threshold: f64) {
        let mut fates = vec![Fate::default(); sequence.truth_numbers.len()];
        for frame in &sequence.frames {
            self.n_truths += frame.truths.len() as u64;
            self.n_results += frame.results.len() as u64;
            for &truth in &frame.truths {
                fates[truth].n_frames += 1;
            }
            // A frame without truths or without results leaves all as it was.
            if frame.truths.is_empty() || frame.results.is_empty() {
                continue;
            }
            let mut can_match = frame.pairs.clone();
            can_match.retain(|pair| pair.worth >= threshold - ROUNDING);
            let loyal = can_match.iter().map(|pair| {
                let stays =
                    fates[frame.truths[pair.row]].current == Some(frame.results[pair.column]);
                Pair {
                    worth: pair.worth + if stays { LOYALTY } else { 0.0 },
                    ..*pair
                }
            });
            let chosen = best_pairs(&loyal.collect::<Vec<_>>());
            let before: Vec<bool> = fates.iter().map(|fate| fate.current.is_some()).collect();
            for fate in &mut fates {
                fate.current = None;
            }
            for pair in chosen.into_iter().map(|at| can_match[at]) {
                let truth = frame.truths[pair.row];
                let track = frame.results[pair.column];
                let fate = &mut fates[truth];
                self.n_matched += 1;
                self.likeness += pair.worth;
                self.n_switches += u64::from(fate.track.is_some_and(|before| before != track));
                fate.n_matched += 1;
                fate.n_beginnings += u64::from(!before[truth]);
                (fate.track, fate.current) = (Some(track), Some(track));
            }
        }
        for fate in &fates {
            let tracked = share(fate.n_matched, fate.n_frames).unwrap_or(0.0);
            self.n_mostly_tracked += u64::from(tracked > 0.8);
            self.n_partly_tracked += u64::from((0.2..=0.8).contains(&tracked));
            self.n_mostly_lost += u64::from(tracked < 0.2);
            self.n_fragmentations += fate.n_beginnings.saturating_sub(1);
        }
    }

    pub(super) fn write(&self, scores: &mut Scores) {
        let missed = self.n_truths - self.n_matched;
        let wrong = missed + self.n_results - self.n_matched + self.n_switches;
        scores.mota = share(wrong, self.n_truths).map(|wrong| 1.0 - wrong);
        scores.motp = mean(self.likeness, self.n_matched);
        scores.recall = share(self.n_matched, self.n_truths);
        scores.precision = share(self.n_matched, self.n_results);
        scores.n_switches = self.n_switches;
        scores.n_fragmentations = self.n_fragmentations;
        scores.n_mostly_tracked = self.n_mostly_tracked;
        scores.n_partly_tracked = self.n_partly_tracked;
        scores.n_mostly_lost = self.n_mostly_lost;
    }
}
