//! Trajectories whose errors follow by hand.

use nalgebra::{UnitQuaternion, Vector3};

use super::*;

fn pose(x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::new(x, y, 0.0), Vector3::new(0.0, 0.0, yaw))
}

/// A straight drive of so many metres, and results that are this much too long.
fn straight(n: usize, factor: f64, settings: Settings) -> Scores {
    let mut collector = Collector::new(settings);
    for at in 0..n {
        let x = at as f64;
        collector.add(&pose(x, 0.0, 0.0), Some(&pose(factor * x, 0.0, 0.0)));
    }
    collector.scores()
}

fn near(found: Option<f64>, wanted: f64) -> bool {
    found.is_some_and(|found| (found - wanted).abs() < 1e-9)
}

#[test]
fn a_hundredth_too_far_is_one_percent() {
    let scores = straight(301, 1.01, Settings::default());
    // KITTI's segments end one pose behind their length.
    assert_eq!(scores.segments_m, Some([100.0, 200.0]));
    let per_segment = [(101.0, 100.0, 20.0), (201.0, 200.0, 10.0)];
    let sum: f64 = per_segment
        .iter()
        .map(|(d, length, n)| n * d / length)
        .sum();
    assert_eq!(scores.n_segments, 30);
    assert!(near(scores.t_err_percent, sum / 30.0), "{scores:?}");
    assert!(near(scores.r_err_deg_per_m, 0.0));
    assert!(near(scores.rpe_translation_rmse_m, 0.01));
    assert!(near(scores.ate_median_m, 0.01 * 75.0));
}

#[test]
fn short_drives_have_figures_with_other_names() {
    let named = straight(41, 1.01, Settings::default()).named();
    assert!(named.contains_key("t_err/10-80m") && !named.contains_key("t_err"));
    assert!(
        !straight(5, 1.0, Settings::default())
            .named()
            .contains_key("t_err/10-80m")
    );
}

#[test]
fn where_results_begin_does_not_matter_if_they_are_laid_on() {
    let moved = pose(5.0, -3.0, 1.0);
    for (alignment, error) in [
        (Alignment::Rigid, 0.0),
        (Alignment::Scaled, 0.0),
        (Alignment::Origin, 0.0),
    ] {
        let settings = Settings {
            alignment,
            ..Settings::default()
        };
        let mut collector = Collector::new(settings);
        for at in 0..20 {
            let at = f64::from(at);
            let truth = pose(at, at * at * 0.1, 0.1 * at);
            collector.add(&truth, Some(&(moved * truth)));
        }
        let scores = collector.scores();
        assert!(near(scores.ate_max_m, error), "{alignment:?} {scores:?}");
        assert!(
            near(scores.rpe_rotation_rmse_deg, 0.0) || scores.rpe_rotation_rmse_deg < Some(1e-5)
        );
    }
    let settings = Settings {
        alignment: Alignment::Scaled,
        ..Settings::default()
    };
    let scores = straight(10, 2.0, settings);
    assert!(near(scores.scale, 0.5) && near(scores.ate_rmse_m, 0.0));
}

#[test]
fn poses_that_are_missing_are_counted() {
    let mut collector = Collector::new(Settings::default());
    collector.add(&pose(0.0, 0.0, 0.0), None);
    collector.add(&pose(0.0, 0.0, 0.0), Some(&pose(f64::NAN, 0.0, 0.0)));
    let standing = Isometry3::from_parts(Vector3::zeros().into(), UnitQuaternion::identity());
    collector.add(&standing, Some(&standing));
    collector.add(&standing, Some(&standing));
    let scores = collector.scores();
    assert_eq!((scores.n_missing, scores.n_poses), (2, 2));
    assert_eq!(scores.ate_rmse_m, Some(0.0));
    assert_eq!(
        Collector::new(Settings::default()).scores(),
        Scores::default()
    );
}

#[test]
fn steps_over_metres_end_where_the_path_is_long_enough() {
    let truths: Vec<_> = (0..10).map(|at| pose(f64::from(at), 0.0, 0.0)).collect();
    assert_eq!(
        segments::steps(&truths, 2.5, false),
        [(0, 3), (3, 6), (6, 9)]
    );
    assert_eq!(segments::steps(&truths, 2.5, true), []);
    assert_eq!(segments::steps(&truths, 8.0, true), [(0, 8), (1, 9)]);
}
