//! Drives whose figures follow by hand.

use super::*;

fn car(x: f64, speed: f64, heading_rad: f64) -> Body {
    Body {
        centre_m: [x * heading_rad.cos(), x * heading_rad.sin()],
        heading_rad,
        velocity_mps: [speed * heading_rad.cos(), speed * heading_rad.sin()],
        half_m: [2.0, 1.0],
    }
}

fn near(found: Option<f64>, wanted: f64) -> bool {
    found.is_some_and(|found| (found - wanted).abs() < 1e-6)
}

#[test]
fn half_a_route_and_two_infractions() {
    let mut collector = Collector::new(Settings::default());
    let mut drive = Drive::new(0.1, 200.0);
    drive.complete(110.0);
    drive.complete(90.0);
    drive.off_road(4.0);
    drive.off_road(6.0);
    drive.collide(CollisionWith::Vehicle, 300.0);
    drive.infringe(Infraction::RedLight);
    collector.add(&drive);
    let scores = collector.scores();
    assert!(near(scores.route_completion, 0.5));
    assert!(near(scores.infraction_penalty, 0.6 * 0.7));
    assert!(near(scores.driving_score, 0.5 * 0.6 * 0.7));
    assert_eq!(scores.max_impulse_ns, Some(300.0));
    let mut clean = Drive::new(0.1, 100.0);
    clean.complete(150.0);
    let mut other = Collector::new(Settings::default());
    other.add(&clean);
    collector.merge(&other);
    let scores = collector.scores();
    assert!(near(scores.driving_score, (0.21 + 1.0) / 2.0));
    assert_eq!((scores.n_drives, scores.n_red_lights), (2, 1));
}

#[test]
fn steady_braking_has_no_jerk() {
    // From 20 m/s at 3 m/s², on a slanting road.
    let mut drive = Drive::new(0.05, 100.0);
    for at in 0..100 {
        let t = 0.05 * f64::from(at);
        drive.add(&car(20.0 * t - 1.5 * t * t, 20.0 - 3.0 * t, 0.7), 0.0, &[]);
    }
    let mut collector = Collector::new(Settings::default());
    collector.add(&drive);
    let scores = collector.scores();
    assert!(near(scores.acceleration_longitudinal.p50, 3.0));
    assert!(near(scores.acceleration_lateral.max, 0.0));
    assert!(near(scores.jerk_longitudinal.max, 0.0));
    assert_eq!((scores.comfortable, scores.min_ttc_secs), (Some(1.0), None));
    let named = scores.named();
    assert!(!named.contains_key("ttc_min") && named["ttc_below_1.5s"] == 0.0);
}

#[test]
fn a_parked_car_comes_nearer() {
    let parked = car(44.0, 0.0, 0.0);
    let mut drive = Drive::new(0.5, 100.0);
    for at in 0..8 {
        drive.add(&car(5.0 * f64::from(at), 10.0, 0.0), 0.0, &[parked]);
    }
    let mut collector = Collector::new(Settings::default());
    collector.add(&drive);
    let scores = collector.scores();
    // The gap is 40 m at first and 5 m at last; it is below 15 m twice.
    assert!(near(scores.min_ttc_secs, 0.5));
    assert!(near(scores.ttc_below_limit, 2.0 / 8.0));
    assert!(near(Some(scores.driven_m), 35.0));
}

#[test]
fn hard_braking_is_not_comfortable() {
    let mut drive = Drive::new(0.05, 100.0);
    for at in 0..100 {
        let t = 0.05 * f64::from(at);
        drive.add(&car(0.0, 40.0 - 7.0 * t, 0.0), 0.0, &[]);
    }
    let mut unknown = car(0.0, f64::NAN, 0.0);
    unknown.centre_m = [f64::INFINITY; 2];
    drive.add(&unknown, 0.0, &[unknown]);
    let mut collector = Collector::new(Settings::default());
    collector.add(&drive);
    let scores = collector.scores();
    assert_eq!(scores.comfortable, Some(0.0));
    assert!(scores.named().values().all(|figure| figure.is_finite()));
    assert!(
        Collector::new(Settings::default())
            .scores()
            .named()
            .is_empty()
    );
}
