//! Values that follow from the definition by hand; nuScenes' own code is held against in `test_e2e`.

use std::f64::consts::TAU;

use super::*;

fn car(x: f64, y: f64) -> Box3 {
    Box3 {
        centre_m: [x, y, 0.5],
        size_m: [4.0, 2.0, 1.5],
        yaw_rad: 0.0,
    }
}

fn close(value: Option<f64>, expected: f64) {
    let value = value.unwrap();
    assert!((value - expected).abs() < 1e-9, "{value} {expected}");
}

fn scored(truths: &[Truth], found: &[Detection]) -> Scores {
    let mut collector = Collector::new(Settings::default());
    collector.add(truths, found);
    collector.scores()
}

#[test]
fn one_metre_beside_is_right_from_two_metres_on() {
    let truth = Truth {
        velocity_mps: Some([3.0, 4.0]),
        ..Truth::new(0, car(10.0, 0.0))
    };
    let mut found = Detection::new(0, 0.7, car(11.0, 0.0));
    found.shape.centre_m[2] = 9.0;
    found.shape.size_m = [4.0, 2.0, 3.0];
    found.shape.yaw_rad = -0.25 + TAU;
    found.velocity_mps = Some([0.0, 4.0]);
    let scores = scored(&[truth], &[found]);
    // A distance of exactly 1 m is not below 1 m.
    assert_eq!(
        scores.ap_at.map(Option::unwrap).map(|ap| ap.round()),
        [0.0, 0.0, 1.0, 1.0]
    );
    close(scores.map, 0.5);
    close(scores.ate_m, 1.0);
    close(scores.ase, 0.5);
    close(scores.aoe_rad, 0.25);
    close(scores.ave_mps, 3.0);
    // No truth has an attribute: the score is that of four errors.
    assert_eq!(scores.aae, None);
    assert_eq!(scores.nds_parts, ["ATE", "ASE", "AOE", "AVE"]);
    close(scores.nds, (5.0 * 0.5 + 0.0 + 0.5 + 0.75 + 0.0) / 9.0);
    let named = scores.named();
    assert_eq!(named.len(), 2 + 4 + 4);
    close(named.get("AP@0.5m").copied(), 0.0);
    close(named.get("mAVE").copied(), 3.0);
    close(
        scores
            .named_classes(|_| "car".into())
            .get("AVE/car")
            .copied(),
        3.0,
    );
}

#[test]
fn a_program_that_says_no_velocity_has_the_worst_error_and_an_attribute_counts_if_truth_has_one() {
    let truth = Truth {
        velocity_mps: Some([3.0, 4.0]),
        attribute: Some(2),
        ..Truth::new(0, car(10.0, 0.0))
    };
    let scores = scored(&[truth], &[Detection::new(0, 0.7, car(10.0, 0.0))]);
    close(scores.map, 1.0);
    close(scores.ave_mps, 1.0);
    close(scores.aae, 1.0);
    close(scores.nds, 8.0 / 10.0);
}

#[test]
fn headings_differ_as_the_rule_of_the_class_says() {
    let turned = |yaw_rad: f64| Box3 {
        yaw_rad,
        ..car(0.0, 0.0)
    };
    let error = |heading: Heading| {
        let rule = ClassRule {
            heading,
            ..ClassRule::default()
        };
        let mut collector = Collector::new(Settings {
            classes: [(0, rule)].into(),
            count_absent: false,
        });
        let found = Detection::new(0, 0.7, turned(3.0));
        collector.add(&[Truth::new(0, turned(-0.1))], &[found]);
        collector.scores().aoe_rad
    };
    close(error(Heading::Full), 3.1);
    close(error(Heading::HalfTurn), std::f64::consts::PI - 3.1);
    assert_eq!(error(Heading::None), None);
}

#[test]
fn ranges_ignored_truths_and_detections_that_do_not_count_leave_out_what_they_say() {
    let truths = [Truth::new(0, car(0.0, 0.0)), Truth::new(0, car(20.0, 0.0))];
    let found = [
        Detection::new(0, 0.9, car(20.2, 0.0)),
        Detection::new(0, 0.8, car(40.0, 0.0)),
        Detection::new(0, 0.7, car(0.2, 0.0)),
    ];
    let part = |ignored: &[usize], unmatched: &[usize]| {
        let mut collector = Collector::new(Settings::default());
        let ignored = |index: usize| ignored.contains(&index);
        let unmatched = |index: usize| unmatched.contains(&index);
        collector.add_part(&truths, &found, ignored, unmatched);
        let scores = collector.scores();
        (scores.map.unwrap(), scores.classes[&0].n_ignored)
    };
    assert!(part(&[], &[]).0 < 0.99);
    // Without the false one all is right.
    assert!((part(&[], &[1]).0 - 1.0).abs() < 1e-9);
    // The second truth swallows its detection. From the false one to the right one precision
    // rises in a line from 0 to ½ over recall; the mean of r / 2 - 0.1 over the recalls above 0.2
    // is 16.2 / 90, of at most 0.9.
    let (map, n_ignored) = part(&[1], &[]);
    assert!(
        (map - 16.2 / 90.0 / 0.9).abs() < 1e-9 && n_ignored == 1,
        "{map}"
    );
    let matched = matches(&truths, &found, 2.0);
    assert_eq!(matched.pairs, [(1, 0), (0, 2)]);
    assert_eq!((matched.missed, matched.unmatched), (vec![], vec![1]));

    let rule = ClassRule {
        range_m: Some(30.0),
        ..ClassRule::default()
    };
    let mut collector = Collector::new(Settings {
        classes: [(0, rule), (1, ClassRule::default())].into(),
        count_absent: false,
    });
    let mut far = found.to_vec();
    far[1].distance_m = 30.0;
    far.push(Detection::new(9, 0.9, car(0.0, 0.0)));
    collector.add(&truths, &far);
    close(collector.scores().map, 1.0);
    assert_eq!(collector.scores().classes[&0].n_detections, 2);
    collector.settings.count_absent = true;
    close(collector.scores().map, 0.5);
    assert_eq!(collector.scores().classes[&1].ave_mps, None);
}

#[test]
fn floods_and_numbers_that_say_nothing_are_counted() {
    let truth = Truth::new(0, car(0.0, 0.0));
    let mut found = vec![Detection::new(0, f64::NAN, car(0.0, 0.0))];
    found.push(Detection::new(0, 0.5, car(f64::INFINITY, 0.0)));
    found.push(Detection::new(
        0,
        0.5,
        Box3 {
            size_m: [0.0; 3],
            ..car(0.0, 0.0)
        },
    ));
    found.extend((0..700).map(|i| Detection::new(0, 0.1, car(100.0 + f64::from(i), 0.0))));
    found.push(Detection::new(0, 0.9, car(0.0, 0.0)));
    let mut collector = Collector::new(Settings::default());
    collector.add(&[truth], &found);
    assert_eq!((collector.n_invalid(), collector.n_too_many()), (3, 201));
    // At recall 1 the precision is that behind the last false one, which is below the least: one of
    // 90 recalls is lost.
    close(collector.scores().map, 89.0 / 90.0);
    assert_eq!(scored(&[], &[]).named(), BTreeMap::new());
}

#[test]
fn frames_in_two_collectors_merged_score_like_in_one() {
    let mut rng = fastrand::Rng::with_seed(5);
    let new = || Collector::new(Settings::default());
    let (mut one, mut first, mut second) = (new(), new(), new());
    for frame in 0..40 {
        let mut place = || {
            car(
                f64::from(rng.u32(0..60)) * 0.5,
                f64::from(rng.u32(0..8)) * 0.5,
            )
        };
        let truths: Vec<_> = (0..5).map(|_| Truth::new(0, place())).collect();
        let found = (0..8).map(|i| Detection::new(0, f64::from(1 + i % 3), place()));
        let found: Vec<_> = found.collect();
        one.add(&truths, &found);
        let part = if frame < 17 { &mut first } else { &mut second };
        part.add(&truths, &found);
    }
    first.merge(&second);
    assert_eq!(first.scores(), one.scores());
    assert!(one.scores().map.unwrap() > 0.05);
}
