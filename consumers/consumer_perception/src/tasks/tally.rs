//! What the sums of all tasks have in common, whichever metrics they are of.

use std::collections::BTreeMap;

use consumer_metrics::{
    average_precision, classes, depth, detection3d, event_flow, flow, lanes, odometry, stereo,
    tracking,
};

use crate::tasks::classes::name_of;

/// Parts of a task, added up.
pub trait Tally: Clone + Send + Sync {
    /// Adds another scenario's.
    fn take_in(&mut self, other: &Self);

    /// All metrics by name.
    fn named(&self) -> BTreeMap<String, f64>;

    /// Truths that were scored, and those that were ignored.
    fn counts(&self) -> (u64, u64);
}

/// Says of a metric's collector how its scores count truths, and with which classes they are named.
macro_rules! tallies {
    ($($metric:ident $(with classes $name_of:ident)?: |$scores:ident| $counts:expr;)*) => {$(
        impl Tally for $metric::Collector {
            fn take_in(&mut self, other: &Self) {
                self.merge(other);
            }

            fn named(&self) -> BTreeMap<String, f64> {
                let scores = self.scores();
                #[allow(unused_mut, reason = "not all have classes")]
                let mut named = scores.named();
                $(named.extend(scores.named_classes($name_of));)?
                named
            }

            fn counts(&self) -> (u64, u64) {
                let $scores = self.scores();
                $counts
            }
        }
    )*};
}

tallies! {
    depth: |scores| (scores.n_scored, scores.n_ignored);
    event_flow: |scores| (scores.n_scored, scores.n_ignored);
    flow: |scores| (scores.all.n_scored, scores.n_ignored);
    stereo: |scores| (scores.n_scored, scores.n_ignored);
    classes with classes name_of: |scores| (scores.n_scored, scores.n_ignored);
    odometry: |scores| (scores.n_poses, scores.n_missing);
    tracking: |scores| (scores.n_truths, scores.n_ignored);
    average_precision with classes name_of: |scores| {
        let of = scores.classes.values();
        of.fold((0, 0), |(n, ignored), class| {
            (n + class.n_truths, ignored + class.n_ignored)
        })
    };
    detection3d with classes name_of: |scores| {
        let of = scores.classes.values();
        of.fold((0, 0), |(n, ignored), class| {
            (n + class.n_truths, ignored + class.n_ignored)
        })
    };
}

impl Tally for lanes::Collector {
    fn take_in(&mut self, other: &Self) {
        let merged = self.merge(other);
        debug_assert!(merged.is_ok(), "the settings are the same");
    }

    fn named(&self) -> BTreeMap<String, f64> {
        self.scores().named()
    }

    fn counts(&self) -> (u64, u64) {
        let scores = self.scores();
        (scores.n_truths, scores.n_ignored)
    }
}
