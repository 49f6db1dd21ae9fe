//! Tracks whose figures follow by counting.

use super::*;

fn add(collector: &mut Collector, truths: &[u64], results: &[u64], similarity: &[f64]) {
    let frame = Frame {
        truths,
        ignored: &[],
        results,
        similarity,
    };
    collector.add(frame).unwrap();
}

#[test]
fn a_switch_in_the_middle() {
    // One object of 4 frames; track 7 has the first two, track 8 the others.
    let mut collector = Collector::new(Settings::default());
    for result in [7, 7, 8, 8] {
        add(&mut collector, &[1], &[result], &[1.0]);
    }
    let scores = collector.scores();
    assert_eq!(scores.mota, Some(0.75));
    assert_eq!((scores.n_switches, scores.n_fragmentations), (1, 0));
    assert_eq!((scores.idf1, scores.idp), (Some(0.5), Some(0.5)));
    // Found is everything; each match shares 2 of 4 frames with its track.
    assert_eq!((scores.det_a, scores.ass_a), (Some(1.0), Some(0.5)));
    assert!((scores.hota.unwrap() - 0.5_f64.sqrt()).abs() < 1e-12);
    assert_eq!(scores.n_mostly_tracked, 1);
}

#[test]
fn what_is_lost_and_found_again_is_a_fragmentation() {
    let mut collector = Collector::new(Settings::default());
    add(&mut collector, &[1], &[7], &[1.0]);
    add(&mut collector, &[1], &[7], &[0.1]);
    add(&mut collector, &[1], &[7], &[1.0]);
    let scores = collector.scores();
    assert_eq!((scores.n_fragmentations, scores.n_switches), (1, 0));
    assert_eq!(scores.mota, Some(1.0 - 2.0 / 3.0));
    assert_eq!(scores.n_partly_tracked, 1);
}

#[test]
fn a_track_stays_while_it_can() {
    // In the second frame track 8 lies better, but 7 still fits.
    let mut collector = Collector::new(Settings::default());
    add(&mut collector, &[1], &[7], &[0.9]);
    add(&mut collector, &[1], &[7, 8], &[0.6, 0.9]);
    let scores = collector.scores();
    assert_eq!((scores.n_switches, scores.motp), (0, Some(0.75)));
}

#[test]
fn ignored_truths_take_their_results_with_them() {
    let mut collector = Collector::new(Settings::default());
    let frame = Frame {
        truths: &[1, 2],
        ignored: &[false, true],
        results: &[7, 8],
        similarity: &[0.9, 0.0, 0.0, 0.9],
    };
    collector.add(frame).unwrap();
    let scores = collector.scores();
    assert_eq!((scores.mota, scores.precision), (Some(1.0), Some(1.0)));
    assert_eq!((scores.n_truths, scores.n_results), (1, 1));
    assert_eq!(scores.n_ignored, 1);
    assert!(
        collector
            .add(Frame {
                similarity: &[],
                ..frame
            })
            .is_err()
    );
}

#[test]
fn identities_hold_within_a_sequence() {
    let mut first = Collector::new(Settings::default());
    add(&mut first, &[1], &[7], &[1.0]);
    let mut second = Collector::new(Settings::default());
    add(&mut second, &[1], &[8], &[1.0]);
    first.merge(&second);
    let scores = first.scores();
    assert_eq!((scores.n_switches, scores.idf1), (0, Some(1.0)));
    assert_eq!(scores.n_tracks, 2);
}

#[test]
fn a_result_that_is_there_twice_is_a_track_more() {
    let mut collector = Collector::new(Settings::default());
    for _ in 0..2 {
        add(&mut collector, &[1], &[7, 7], &[1.0, f64::NAN]);
    }
    let scores = collector.scores();
    assert_eq!((scores.precision, scores.recall), (Some(0.5), Some(1.0)));
    assert_eq!(scores.n_tracks, 3);
}

#[test]
fn nothing_and_nothing_found() {
    let mut collector = Collector::new(Settings::default());
    assert_eq!(collector.scores(), Scores::default());
    assert!(collector.scores().named().is_empty());
    add(&mut collector, &[1], &[], &[]);
    let scores = collector.scores();
    assert_eq!((scores.hota, scores.mota), (Some(0.0), Some(0.0)));
    assert_eq!((scores.loc_a, scores.n_mostly_lost), (None, 1));
}

#[test]
fn likeness_of_boxes_and_of_centres() {
    let boxes = [[0.0, 0.0, 2.0, 2.0]];
    let found = iou_similarity(&boxes, &[[1.0, 0.0, 3.0, 2.0], [5.0, 5.0, 6.0, 6.0]]);
    assert_eq!(found, [1.0 / 3.0, 0.0]);
    assert_eq!(
        centre_similarity(&[[0.0; 3]], &[[2.0, 0.0, 0.0]], 4.0),
        [0.5]
    );
}
