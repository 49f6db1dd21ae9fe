//! Lines whose distances follow by hand.

use super::*;

/// A straight line of points every metre, this far to the left.
fn line(from: i32, to: i32, left: f64) -> Line {
    (from..=to).map(|x| [f64::from(x), left, 0.0]).collect()
}

#[test]
fn lines_half_a_metre_apart_count_at_one_metre() {
    let mut collector = Collector::new(Settings::default());
    let truths = [line(0, 110, 1.5), line(0, 110, -1.5)];
    let results = [line(0, 110, 2.1), line(0, 110, -1.5), line(0, 110, 30.0)];
    collector.add(&truths, &[], &results).unwrap();
    let named = collector.scores().named();
    assert_eq!((named["recall"], named["precision"]), (1.0, 2.0 / 3.0));
    assert_eq!((named["F1"], named["F1@1m"]), (0.8, 0.8));
    assert_eq!(named["F1@0.5m"], 0.4);
    assert!((named["lateral_near"] - 0.3).abs() < 1e-12);
    assert!((named["lateral_far"] - 0.3).abs() < 1e-12);
}

#[test]
fn a_half_of_a_line_is_right_but_finds_nothing() {
    let mut collector = Collector::new(Settings::default());
    collector
        .add(&[line(0, 110, 0.0)], &[], &[line(0, 50, 0.0)])
        .unwrap();
    let at = &collector.scores().at[2];
    assert_eq!(
        (at.recall, at.precision, at.f1),
        (Some(0.0), Some(1.0), Some(0.0))
    );
    assert_eq!(at.lateral_near_m, Some(0.0));
}

#[test]
fn direction_does_not_matter_and_what_turns_back_is_cut() {
    let mut backward = line(0, 110, 0.0);
    backward.reverse();
    let mut loops = line(0, 110, 0.0);
    loops.extend(line(20, 60, 5.0));
    let mut collector = Collector::new(Settings::default());
    collector
        .add(&[line(0, 110, 0.0)], &[], &[backward])
        .unwrap();
    collector.add(&[line(0, 110, 0.0)], &[], &[loops]).unwrap();
    assert_eq!(collector.scores().named()["F1@0.5m"], 1.0);
}

#[test]
fn an_ignored_truth_takes_its_result_with_it() {
    let mut collector = Collector::new(Settings::default());
    let lines = [line(0, 110, 1.5), line(0, 110, -1.5)];
    collector.add(&lines, &[false, true], &lines).unwrap();
    let scores = collector.scores();
    assert_eq!(scores.named()["precision"], 1.0);
    assert_eq!(
        (scores.n_truths, scores.n_results, scores.n_ignored),
        (1, 1, 1)
    );
    assert!(collector.add(&lines, &[true], &lines).is_err());
}

#[test]
fn bad_lines_and_no_lines() {
    let mut collector = Collector::new(Settings::default());
    assert!(collector.scores().named().is_empty());
    let bad = [
        vec![],
        vec![[5.0, 0.0, 0.0]],
        vec![[f64::NAN; 3]; 4],
        line(-50, -20, 0.0),
    ];
    collector.add(&[], &[], &bad).unwrap();
    assert!(collector.scores().named().is_empty());
    collector.add(&[], &[], &[line(0, 110, 0.0)]).unwrap();
    let named = collector.scores().named();
    assert_eq!((named["F1"], named["precision"]), (0.0, 0.0));
    assert!(!named.contains_key("recall"));
}

#[test]
fn collectors_merge() {
    let mut all = Collector::new(Settings::default());
    let mut parts = all.clone();
    for left in [0.0, 0.7] {
        let (truths, results) = ([line(0, 110, 0.0)], [line(0, 110, left)]);
        all.add(&truths, &[], &results).unwrap();
        let mut part = Collector::new(Settings::default());
        part.add(&truths, &[], &results).unwrap();
        parts.merge(&part).unwrap();
    }
    assert_eq!(all.scores(), parts.scores());
}
