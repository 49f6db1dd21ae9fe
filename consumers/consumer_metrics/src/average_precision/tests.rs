//! Values that follow from the definition by hand; COCO's own code is held against in `test_e2e`.

use super::*;

fn square(x: f64, y: f64, side: f64) -> BoxPx {
    BoxPx::new([x, y], [x + side, y + side])
}

fn close(value: Option<f64>, expected: f64) {
    let value = value.unwrap();
    assert!((value - expected).abs() < 1e-12, "{value} {expected}");
}

#[test]
fn all_found_and_nothing_else_is_one() {
    let mut collector = Collector::new();
    let truths = [
        Truth::new(3, square(0.0, 0.0, 20.0)),
        Truth::new(3, square(50.0, 0.0, 40.0)),
        Truth::new(4, square(50.0, 50.0, 100.0)),
    ];
    let found: Vec<_> = truths
        .iter()
        .map(|truth| Detection::new(truth.class, 0.5, truth.region))
        .collect();
    collector.add(&truths, &found);
    collector.add::<BoxPx>(&[], &[]);
    let scores = collector.scores();
    assert_eq!(scores.named().len(), 12);
    for (name, value) in scores.named() {
        // One detection a class and image is too few for class 3: ½ and 1.
        let expected = if name == "AR1" { 0.75 } else { 1.0 };
        assert!((value - expected).abs() < 1e-12, "{name} {value}");
    }
    assert_eq!(
        (
            scores.all.n_truths,
            scores.all.n_detections,
            collector.n_images()
        ),
        (3, 3, 2)
    );
    let classes = scores.named_classes(|class| format!("c{class}"));
    assert_eq!(classes.len(), 6);
    close(classes.get("AP/c3").copied(), 1.0);
}

#[test]
fn half_found_behind_a_false_one_has_the_area_under_its_steps() {
    // Best first: false, right; one of two truths is never found. Precision ½ up to recall ½, which
    // 51 of 101 recalls reach, and 0 behind. The overlap of the right one is 90 / 110: enough for
    // the thresholds 0.50 … 0.80, seven of ten.
    let mut collector = Collector::new();
    let truths = [
        Truth::new(0, BoxPx::new([0.0, 0.0], [10.0, 10.0])),
        Truth::new(0, BoxPx::new([90.0, 90.0], [99.0, 99.0])),
    ];
    let found = [
        Detection::new(0, 0.9, BoxPx::new([40.0, 40.0], [50.0, 50.0])),
        Detection::new(0, 0.8, BoxPx::new([1.0, 0.0], [11.0, 10.0])),
    ];
    collector.add(&truths, &found);
    let scores = collector.scores();
    close(scores.all.ap50, 0.5 * 51.0 / 101.0);
    close(scores.all.ap75, 0.5 * 51.0 / 101.0);
    close(scores.all.ap, 0.7 * 0.5 * 51.0 / 101.0);
    close(scores.all.ar100, 0.7 * 0.5);
    close(scores.all.ar1, 0.0);
    assert_eq!(scores.all.ap_large, None);
    assert!(!scores.named().contains_key("APl"));

    // The false one, told not to count, leaves precision 1 up to recall ½.
    let pairs = Pairs::new(&truths, &found);
    let mut part = Collector::new();
    part.add_part(&pairs, |_| false, |index| index == 0);
    close(part.scores().all.ap50, 51.0 / 101.0);
    // With the missed truth out of the part as well everything is right.
    let mut part = Collector::new();
    part.add_part(&pairs, |index| index == 1, |index| index == 0);
    close(part.scores().all.ap50, 1.0);
    assert_eq!(part.scores().all.n_ignored, 1);
    let matches = pairs.matches(0.5);
    assert_eq!(matches.pairs, [(0, 1)]);
    assert_eq!((matches.missed, matches.unmatched), (vec![1], vec![0]));
    assert_eq!(pairs.matches(0.85).pairs, []);
}

#[test]
fn what_does_not_count_swallows_detections_as_its_kind_says() {
    let object = Truth::new(0, square(0.0, 0.0, 10.0));
    let at = |x: f64, side: f64| Detection::new(0, 0.9, square(x, 0.0, side));
    let ap50 = |truths: &[Truth<BoxPx>], found: &[Detection<BoxPx>]| {
        let mut collector = Collector::new();
        collector.add(truths, found);
        collector.scores().all.ap50
    };
    // Two small detections inside of a large region, before the right one.
    let found = [at(100.0, 5.0), at(110.0, 5.0), at(0.0, 10.0)];
    let region = square(100.0, 0.0, 50.0);
    close(ap50(std::slice::from_ref(&object), &found), 1.0 / 3.0);
    close(
        ap50(&[object.clone(), Truth::crowd(0, region)], &found),
        1.0,
    );
    close(
        ap50(&[object.clone(), Truth::crowd(ANY_CLASS, region)], &found),
        1.0,
    );
    close(
        ap50(&[object.clone(), Truth::crowd(1, region)], &found),
        1.0 / 3.0,
    );
    // An ignored object must fit, and is found once.
    close(
        ap50(&[object.clone(), Truth::ignored(0, region)], &found),
        1.0 / 3.0,
    );
    let found = [at(100.0, 50.0), at(100.0, 50.0), at(0.0, 10.0)];
    close(
        ap50(&[object.clone(), Truth::ignored(0, region)], &found),
        0.5,
    );
    // Nothing but what does not count: no score, rather than one that is 0.
    assert_eq!(ap50(&[Truth::crowd(0, region)], &found), None);
}

#[test]
fn numbers_that_say_nothing_are_counted_and_left_out() {
    let mut collector = Collector::for_classes(&[0]);
    let whole = square(0.0, 0.0, 10.0);
    let found = [
        Detection::new(0, f64::NAN, whole),
        Detection::new(0, 0.9, square(f64::NAN, 0.0, 1.0)),
        Detection::new(0, 0.9, square(5.0, 5.0, -1.0)),
        Detection::new(
            0,
            0.9,
            BoxPx::new([f64::NEG_INFINITY; 2], [f64::INFINITY; 2]),
        ),
        Detection::new(ANY_CLASS, 0.9, whole),
        Detection::new(7, 0.9, whole),
        Detection::new(0, 0.1, whole),
    ];
    collector.add(&[Truth::new(0, whole)], &found);
    assert_eq!(collector.n_invalid(), 5);
    let scores = collector.scores();
    close(scores.all.ap, 1.0);
    assert_eq!(scores.classes.len(), 1);
}

#[test]
fn images_in_two_collectors_merged_score_like_in_one() {
    let mut rng = fastrand::Rng::with_seed(4);
    let (mut one, mut first, mut second) = (Collector::new(), Collector::new(), Collector::new());
    for image in 0..60 {
        let mut any = |n: usize| -> Vec<BoxPx> {
            let side = |rng: &mut fastrand::Rng| f64::from(rng.u32(4..12)) * 5.0;
            let place = |rng: &mut fastrand::Rng| f64::from(rng.u32(0..12)) * 5.0;
            (0..n)
                .map(|_| square(place(&mut rng), place(&mut rng), side(&mut rng)))
                .collect()
        };
        let truths: Vec<_> = any(6).into_iter().map(|r| Truth::new(0, r)).collect();
        let found = any(9).into_iter().zip(0..);
        let found: Vec<_> = found
            .map(|(r, i)| Detection::new(0, f64::from(i % 3), r))
            .collect();
        one.add(&truths, &found);
        let part = if image < 25 { &mut first } else { &mut second };
        part.add(&truths, &found);
    }
    first.merge(&second);
    assert_eq!(first.scores(), one.scores());
    assert!(one.scores().all.ap50.unwrap() > 0.05);
}

#[test]
fn masks_say_the_same_as_their_pixels() {
    let mut rng = fastrand::Rng::with_seed(11);
    for _ in 0..300 {
        let (width, height) = (rng.u32(1..14), rng.u32(1..14));
        let mut some = || {
            let dense = rng.f64() * rng.f64();
            let pixels: Vec<bool> = (0..width * height).map(|_| rng.f64() < dense).collect();
            let has = |x: u32, y: u32| pixels[(y * width + x) as usize];
            let mask = RunMask::from_pixels(width, height, has).unwrap();
            (pixels.clone(), mask)
        };
        let ((a, mask), (b, other)) = (some(), some());
        assert_eq!(
            RunMask::from_runs(width, height, &mask.runs()).as_ref(),
            Ok(&mask)
        );
        let n = |has: &dyn Fn(usize) -> bool| (0..a.len()).filter(|i| has(*i)).count() as f64;
        assert_eq!(mask.area(), n(&|i| a[i]));
        assert_eq!(mask.intersection(&other), n(&|i| a[i] && b[i]));
        if let Some([x0, y0, x1, y1]) = mask.bounds() {
            let around = [x0, y0, x1 + rng.u32(0..3), y1 + rng.u32(0..3)];
            let has = |x: u32, y: u32| a[(y * width + x) as usize];
            let part = RunMask::from_part(width, height, around, has);
            assert_eq!(part.as_ref(), Ok(&mask));
            for (i, _) in a.iter().enumerate().filter(|(_, inside)| **inside) {
                let (x, y) = (i as u32 % width, i as u32 / width);
                assert!((x0..x1).contains(&x) && (y0..y1).contains(&y));
            }
        }
    }
    // Runs of length 0 join their neighbours.
    let joined = RunMask::from_runs(2, 3, &[1, 2, 0, 1, 2]).unwrap();
    assert_eq!(joined.runs(), [1, 3, 2]);
    assert_eq!(joined.bounds(), Some([0, 0, 2, 3]));
    assert_eq!(RunMask::from_runs(2, 3, &[6]).unwrap().bounds(), None);
    let short = RunMask::from_runs(2, 3, &[1, 2]).unwrap_err().to_string();
    assert!(
        short.contains("cover 3 pixels") && short.contains("2 x 3 = 6"),
        "{short}"
    );
    let large = RunMask::from_runs(70_000, 70_000, &[]).unwrap_err();
    assert!(large.to_string().contains("at most 4294967295"));
    let other_size = RunMask::from_runs(3, 2, &[0, 6]).unwrap();
    assert_eq!(joined.intersection(&other_size), 0.0);
}
