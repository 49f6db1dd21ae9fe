//! MOBIL (Kesting, Treiber, Helbing 2007): whether a change of lanes is worth what it costs others,
//! and whether it is safe. All accelerations are those of the Intelligent Driver Model.
//! `docs/explanation/traffic.md` has its formulas and parameters.

use crate::plane::Side;

/// Gain that a change without need must bring, Δa_th, m/s².
pub const THRESHOLD_MPS2: f64 = 0.5;
/// What is added to the threshold for a change to the left and taken from it for one to the right by
/// whoever keeps to the right, Δa_bias, m/s².
pub const RIGHT_BIAS_MPS2: f64 = 0.7;
/// How much the gain of both followers counts beside ours, p.
pub const POLITENESS: f64 = 0.4;
/// Hardest braking that a change may ask of the new follower, b_safe, m/s².
pub const SAFE_BRAKE_MPS2: f64 = 2.0;

/// Accelerations of one vehicle without a change and with it, m/s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outlook {
    /// Without it.
    pub before_mps2: f64,
    /// With it.
    pub after_mps2: f64,
}

impl Outlook {
    fn gain_mps2(&self) -> f64 {
        self.after_mps2 - self.before_mps2
    }
}

/// A change of lanes that is thought about; a follower that is not there loses nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prospect {
    /// Side to which it goes.
    pub side: Side,
    /// Whether the rule to keep to the right is followed.
    pub keeps_right: bool,
    /// The vehicle that changes, c.
    pub own: Outlook,
    /// The vehicle behind it now, o.
    pub old_follower: Outlook,
    /// The vehicle behind it then, n.
    pub new_follower: Outlook,
}

impl Prospect {
    /// Whether the new follower need not brake harder than [`SAFE_BRAKE_MPS2`].
    pub fn is_safe(&self) -> bool {
        self.new_follower.after_mps2 >= -SAFE_BRAKE_MPS2
    }

    /// What the change brings beyond the threshold, m/s²; it is worth it above zero.
    pub fn incentive_mps2(&self) -> f64 {
        let (old, new) = (self.old_follower.gain_mps2(), self.new_follower.gain_mps2());
        let (others, threshold) = match (self.keeps_right, self.side) {
            (false, _) => (old + new, THRESHOLD_MPS2),
            (true, Side::Left) => (new, THRESHOLD_MPS2 + RIGHT_BIAS_MPS2),
            (true, Side::Right) => (old, THRESHOLD_MPS2 - RIGHT_BIAS_MPS2),
        };
        self.own.gain_mps2() + POLITENESS * others - threshold
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outlook(before_mps2: f64, after_mps2: f64) -> Outlook {
        Outlook {
            before_mps2,
            after_mps2,
        }
    }

    /// Ours gains 1.5; the new follower loses 1.75, the old one gains 0.5:
    /// 1.5 + 0.4·(0.5 − 1.75) − 0.5 = 0.5.
    const CHANGE: Prospect = Prospect {
        side: Side::Left,
        keeps_right: false,
        own: Outlook {
            before_mps2: -0.5,
            after_mps2: 1.0,
        },
        old_follower: Outlook {
            before_mps2: 0.0,
            after_mps2: 0.5,
        },
        new_follower: Outlook {
            before_mps2: 0.25,
            after_mps2: -1.5,
        },
    };

    #[test]
    fn both_followers_count_and_the_new_one_decides_about_safety() {
        assert!((CHANGE.incentive_mps2() - 0.5).abs() < 1e-12);
        assert!(CHANGE.is_safe());
        // Without the old follower's gain, 0.2 less.
        let alone = Prospect {
            old_follower: Outlook::default(),
            ..CHANGE
        };
        assert!((alone.incentive_mps2() - 0.3).abs() < 1e-12);
        let hard = Prospect {
            own: outlook(-2.0, 2.7),
            new_follower: outlook(0.0, -2.01),
            ..CHANGE
        };
        assert!(!hard.is_safe() && hard.incentive_mps2() > 0.0);
    }

    /// To the left only the new follower counts and 1.2 must be gained; to the right only the old
    /// one, and −0.2 is enough: on an empty road the right lane is taken.
    #[test]
    fn whoever_keeps_right_needs_more_for_the_left_and_nothing_for_the_right() {
        let left = Prospect {
            keeps_right: true,
            ..CHANGE
        };
        assert!((left.incentive_mps2() - (1.5 - 0.4 * 1.75 - 1.2)).abs() < 1e-12);
        let empty = Prospect {
            side: Side::Right,
            own: Outlook::default(),
            old_follower: Outlook::default(),
            new_follower: Outlook::default(),
            ..left
        };
        assert!((empty.incentive_mps2() - 0.2).abs() < 1e-12);
        let symmetric = Prospect {
            keeps_right: false,
            ..empty
        };
        assert!((symmetric.incentive_mps2() + 0.5).abs() < 1e-12);
    }
}
