//! Which direction of a metric is better: needed where two reports are compared, and for the arrows
//! of tables. A metric that is not known is compared without a judgement.

use super::types::TaskScore;

/// Metrics of which more is better, by the part of their name before `/` and `@`.
const MORE: [&str; 47] = [
    "AP",
    "AP50",
    "AP75",
    "APs",
    "APm",
    "APl",
    "AR1",
    "AR10",
    "AR100",
    "ARs",
    "ARm",
    "ARl",
    "sAP",
    "mAP",
    "NDS",
    "mIoU",
    "IoU",
    "accuracy",
    "d1",
    "d2",
    "d3",
    "coverage",
    "HOTA",
    "DetA",
    "AssA",
    "LocA",
    "DetRe",
    "DetPr",
    "AssRe",
    "AssPr",
    "MOTA",
    "MOTP",
    "IDF1",
    "IDP",
    "IDR",
    "F1",
    "precision",
    "recall",
    "MT",
    "density",
    "fwIoU",
    "mAcc",
    "route_completion",
    "infraction_penalty",
    "driving_score",
    "ttc",
    "comfortable",
];

/// Metrics of which less is better.
const LESS: [&str; 57] = [
    "mATE",
    "mASE",
    "mAOE",
    "mAVE",
    "mAAE",
    "ATE",
    "ASE",
    "AOE",
    "AVE",
    "AAE",
    "AbsRel",
    "SqRel",
    "RMSE",
    "RMSElog",
    "SILog",
    "log10",
    "MAE",
    "D1",
    "D1-all",
    "D1-bg",
    "D1-fg",
    "EPE",
    "Fl",
    "Fl-all",
    "Fl-bg",
    "Fl-fg",
    "1PE",
    "2PE",
    "3PE",
    "5PE",
    "1px",
    "3px",
    "5px",
    "NPE",
    "AE",
    "IDSW",
    "FP",
    "FN",
    "Frag",
    "RPE",
    "collisions",
    "impulse",
    "jerk",
    "drift",
    "ML",
    "bad1",
    "bad2",
    "bad3",
    "lateral",
    "height",
    "t_err",
    "r_err",
    "red_lights",
    "stop_signs",
    "ttc_below",
    "acc",
    "collisions_per_km",
];

/// Whether more of a metric is better; `None` if that is not known.
pub fn higher_is_better(score: &TaskScore, metric: &str) -> Option<bool> {
    if metric == score.headline {
        return Some(score.higher_is_better);
    }
    let stem = |name: &str| name.split(['/', '@']).next().unwrap_or_default().to_owned();
    let name = stem(metric);
    if name == stem(&score.headline) {
        return Some(score.higher_is_better);
    }
    let is = |list: &[&str]| list.contains(&name.as_str());
    // `EPE-moving` and `RPE_trans` are kinds of EPE and RPE.
    let short = name.split(['-', '_']).next().unwrap_or_default();
    match (is(&MORE), is(&LESS)) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ if MORE.contains(&short) => Some(true),
        _ if LESS.contains(&short) => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_known_by_name_and_no_name_stands_in_both_lists() {
        let score = TaskScore {
            headline: "odd".into(),
            higher_is_better: false,
            ..TaskScore::default()
        };
        for (metric, expected) in [
            ("odd", Some(false)),
            ("odd/part", Some(false)),
            ("AP/car", Some(true)),
            ("AP@0.5m", Some(true)),
            ("EPE-moving", Some(false)),
            ("RPE_trans_m", Some(false)),
            ("n_pairs", None),
            ("", None),
        ] {
            assert_eq!(higher_is_better(&score, metric), expected, "{metric}");
        }
        assert!(MORE.iter().all(|name| !LESS.contains(name)));
    }
}
