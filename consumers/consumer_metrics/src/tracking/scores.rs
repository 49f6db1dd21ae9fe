//! The figures of tracks.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::numbers::{existing, share};

/// The figures; shares are 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Higher order tracking accuracy.
    pub hota: Option<f64>,
    /// Detection accuracy.
    pub det_a: Option<f64>,
    /// Association accuracy.
    pub ass_a: Option<f64>,
    /// Mean likeness of what matches; `None` if nothing does.
    pub loc_a: Option<f64>,
    /// Detection recall.
    pub det_re: Option<f64>,
    /// Detection precision.
    pub det_pr: Option<f64>,
    /// Association recall.
    pub ass_re: Option<f64>,
    /// Association precision.
    pub ass_pr: Option<f64>,
    /// HOTA at each of its thresholds; empty if there is nothing to score.
    pub hota_at: Vec<f64>,
    /// Multiple object tracking accuracy; may be negative.
    pub mota: Option<f64>,
    /// Mean likeness of matches.
    pub motp: Option<f64>,
    /// Share of truths that are matched.
    pub recall: Option<f64>,
    /// Share of results that are matched.
    pub precision: Option<f64>,
    /// Balance of `idp` and `idr`.
    pub idf1: Option<f64>,
    /// Share of results with the right identity.
    pub idp: Option<f64>,
    /// Share of truths whose identity was told.
    pub idr: Option<f64>,
    /// How often a truth fell to another track than before.
    pub n_switches: u64,
    /// How often a truth was found again after it had been lost.
    pub n_fragmentations: u64,
    /// Truths that were matched in more than 80 % of their frames.
    pub n_mostly_tracked: u64,
    /// Truths between the other two.
    pub n_partly_tracked: u64,
    /// Truths that were matched in less than 20 % of their frames.
    pub n_mostly_lost: u64,
    /// Truths, each counted in each frame.
    pub n_truths: u64,
    /// Results, each counted in each frame.
    pub n_results: u64,
    /// Truths that were left out, each counted in each frame.
    pub n_ignored: u64,
    /// Tracks.
    pub n_tracks: u64,
}

impl Scores {
    /// The figures that exist: `HOTA`, `DetA`, `AssA`, `LocA`, `MOTA`, `MOTP`, `IDF1`, `IDP`,
    /// `IDR`, `precision`, `recall`, and the counts `IDSW`, `Frag`, `MT`, `PT` and `ML`.
    #[must_use]
    pub fn named(&self) -> BTreeMap<String, f64> {
        let count = |n: u64| share(n, 1).filter(|_| self.n_truths + self.n_results > 0);
        existing([
            ("HOTA", self.hota),
            ("DetA", self.det_a),
            ("AssA", self.ass_a),
            ("LocA", self.loc_a),
            ("MOTA", self.mota),
            ("MOTP", self.motp),
            ("IDF1", self.idf1),
            ("IDP", self.idp),
            ("IDR", self.idr),
            ("precision", self.precision),
            ("recall", self.recall),
            ("IDSW", count(self.n_switches)),
            ("Frag", count(self.n_fragmentations)),
            ("MT", count(self.n_mostly_tracked)),
            ("PT", count(self.n_partly_tracked)),
            ("ML", count(self.n_mostly_lost)),
        ])
    }
}
