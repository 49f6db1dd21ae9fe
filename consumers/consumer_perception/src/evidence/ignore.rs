//! Which truths count, and which are left out so that finding them is neither right nor wrong.
//!
//! A benchmark that asks for what cannot be seen measures luck. So every truth has one of three
//! fates, by what exact images and clouds show of it (`consumer_truth` defines the words):
//!
//! - it **counts**: not finding it is a miss;
//! - it is **ignored**: a result that matches it is neither a hit nor a false alarm, and not finding
//!   it costs nothing;
//! - it is **absent**: nothing shows it, so there is no truth, and a result there is a false alarm.
//!
//! # Objects in images (`boxes2d`, `masks`, `tracking` in the image, `boxes3d` of a camera)
//!
//! An object is the pixels of one id and one class of the exact images: a motorcycle and its rider are
//! two. Its box is the visible one, its mask those pixels. It is absent without a pixel. It is
//! ignored if any of these holds, and counts otherwise:
//!
//! | Rule | Default |
//! |---|---|
//! | fewer visible pixels than `min_pixels` | 64 |
//! | a visible box lower than `min_height_px` rows | 10 |
//! | a visible fraction below `min_visible` | 0.25 |
//! | a truncation above `max_truncation` | 0.75 |
//! | farther away than `max_distance_m` (0: no limit) | 0 |
//! | it is a rider: for `person`, riders are neither asked for nor wrong | always |
//!
//! Objects of the map without a box in space have pixels only; of their rules the first two apply.
//! Cars of the map (parked ones) have boxes and count like all others.
//! The vehicle that carries the sensor is absent. So are classes that are not asked for: a truth of
//! one is no ignored region, and a program's detection of such a class is left out.
//!
//! # Objects in space (`boxes3d`, `tracking` in space)
//!
//! With a lidar, an object is ignored if fewer points than `min_points` (1) of the exact cloud are its
//! own, by their ids; with a camera, by the rules for images, and also if it is in no image.
//! Beyond `max_distance_m` (default: nuScenes' 50 m for vehicles, 40 m for people and two-wheelers),
//! measured on the ground from the carrier, truths and results are left out alike.
//! Riders are part of their two-wheeler.
//!
//! # Pixels and points
//!
//! | Task | Left out |
//! |---|---|
//! | `semantic` | pixels of class Unlabeled, and of classes that are not asked for |
//! | `depth` | pixels that show nothing (sky), beyond `max_distance_m` (default 80 m) or nearer than 0.5 m |
//! | `stereo` | as `depth`, and pixels whose partner lies outside the other image |
//! | `flow` | the first frame of a sensor, the carrier's own pixels, and those whose truth is not finite |
//! | `event_flow` | the first window, and pixels whose truth is not finite |
//! | `lidar_semantic` | points of class Unlabeled, and of classes that are not asked for |
//!
//! # Poses, lines and drives
//!
//! Every pose of an odometry counts. Painted lines count where they lie between 3 m and
//! `max_distance_m` (default 40 m) ahead in the image and the exact depth shows the road there;
//! where a vehicle or a house hides one, a found point is neither right nor wrong.
//! Of a drive everything counts.

use crate::suite::SuiteFault;
use serde::{Deserialize, Serialize};

/// Limits of what counts; the module says what each means. A value that is absent is the default of
/// the task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Rules {
    /// Fewest visible pixels.
    pub min_pixels: u64,
    /// Lowest visible box, pixels.
    pub min_height_px: f64,
    /// Smallest visible fraction, 0..=1.
    pub min_visible: f64,
    /// Largest truncation, 0..=1.
    pub max_truncation: f64,
    /// Farthest distance, metres; 0: the task's own, or none.
    pub max_distance_m: f64,
    /// Fewest points of the exact cloud.
    pub min_points: u64,
}

impl Default for Rules {
    fn default() -> Self {
        Rules {
            min_pixels: 64,
            min_height_px: 10.0,
            min_visible: 0.25,
            max_truncation: 0.75,
            max_distance_m: 0.0,
            min_points: 1,
        }
    }
}

/// What is known of an object that an image shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Visible pixels.
    pub pixels: u64,
    /// Rows of its visible box.
    pub height_px: f64,
    /// Visible fraction and truncation; `None` if it has no box in space.
    pub of_body: Option<(f64, f64)>,
    /// Distance from the camera, metres; `None` if it is not known.
    pub distance_m: Option<f64>,
}

impl Rules {
    /// Whether an object that an image shows is ignored.
    pub fn ignores(&self, shown: &Shown) -> bool {
        let hardly_seen = shown.of_body.is_some_and(|(visible, truncation)| {
            visible < self.min_visible || truncation > self.max_truncation
        });
        let far = |distance: f64| self.max_distance_m > 0.0 && distance > self.max_distance_m;
        shown.pixels < self.min_pixels
            || shown.height_px < self.min_height_px
            || hardly_seen
            || shown.distance_m.is_some_and(far)
    }

    /// The distance limit, or the task's own.
    pub fn distance_or(&self, usual_m: f64) -> f64 {
        if self.max_distance_m > 0.0 {
            self.max_distance_m
        } else {
            usual_m
        }
    }

    /// Checks the values.
    ///
    /// # Errors
    /// A sentence with the key, its value and what is allowed.
    pub fn check(&self) -> Result<(), SuiteFault> {
        for (key, value) in [
            ("min_visible", self.min_visible),
            ("max_truncation", self.max_truncation),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(format!("ignore.{key} is {value}, but must lie in 0 to 1").into());
            }
        }
        for (key, value) in [
            ("min_height_px", self.min_height_px),
            ("max_distance_m", self.max_distance_m),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(format!("ignore.{key} is {value}, but must be 0 or more").into());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_rule_alone_ignores_an_object() {
        let rules = Rules {
            max_distance_m: 60.0,
            ..Rules::default()
        };
        let plain = Shown {
            pixels: 64,
            height_px: 10.0,
            of_body: Some((0.25, 0.75)),
            distance_m: Some(60.0),
        };
        assert!(!rules.ignores(&plain));
        let none = Shown {
            of_body: None,
            distance_m: None,
            ..plain
        };
        assert!(!rules.ignores(&none));
        for hidden in [
            Shown {
                pixels: 63,
                ..plain
            },
            Shown {
                height_px: 9.0,
                ..plain
            },
            Shown {
                of_body: Some((0.24, 0.0)),
                ..plain
            },
            Shown {
                of_body: Some((1.0, 0.76)),
                ..plain
            },
            Shown {
                distance_m: Some(60.1),
                ..plain
            },
        ] {
            assert!(rules.ignores(&hidden), "{hidden:?}");
        }
        // Without a limit nothing is too far.
        assert!(!Rules::default().ignores(&Shown {
            distance_m: Some(1e6),
            ..plain
        }));
    }

    #[test]
    fn values_outside_of_their_range_are_refused_with_their_key() {
        for (rules, key) in [
            (
                Rules {
                    min_visible: 1.5,
                    ..Rules::default()
                },
                "min_visible",
            ),
            (
                Rules {
                    max_distance_m: f64::NAN,
                    ..Rules::default()
                },
                "max_distance_m",
            ),
        ] {
            assert!(rules.check().unwrap_err().to_string().contains(key));
        }
        assert_eq!(Rules::default().check(), Ok(()));
    }
}
