//! Lights and signs on the way: which stop line holds a driver.

use schema_frames::LightState;
use schema_roads::SignalKind;
use schema_types::noise::Noise;

use super::entry::{Entry, LINE_BEFORE_M};
use super::view::View;
use crate::crossing::Passage;
use crate::lanes::path::{Foot, Path};
use crate::speed;
use crate::traffic::{Mover, STANDING_MPS};

/// How far before a junction a driver waits for its turn, metres; long vehicles that leave the
/// junction swing out there.
pub(super) const WAITING_M: f64 = 2.5;
/// How long a driver stands at a stop sign, seconds.
const STOP_SECS: f64 = 1.0;
/// Hardest braking for a light that has just turned yellow, m/s².
const YELLOW_BRAKE_MPS2: f64 = 3.0;
/// Time until that braking is reached: comfort builds it up.
const YELLOW_REACTION_SECS: f64 = 0.6;
/// A vehicle that reaches the line sooner passes in the yellow, seconds.
const YELLOW_SECS: f64 = 2.4;

/// A vehicle on its path, and the junctions before it.
#[derive(Clone, Copy)]
pub(super) struct Ahead<'d> {
    pub me: &'d Mover,
    pub path: &'d Path,
    pub foot: Foot,
    pub entries: &'d [Entry],
}

/// What a driver has decided about the lights and signs ahead.
#[derive(Clone, Debug)]
pub(super) struct Signals {
    /// Path length of the first stop line whose light says stop.
    line_m: Option<f64>,
    /// Lights ahead that say stop, and whether it passes them nevertheless.
    lights: Vec<(u32, bool)>,
    /// Junction at whose sign it stands or has stood, and for how long.
    stopped: (u32, f64),
}

impl Default for Signals {
    fn default() -> Signals {
        Signals {
            line_m: None,
            lights: Vec::new(),
            stopped: (u32::MAX, 0.0),
        }
    }
}

impl Ahead<'_> {
    fn ignores(&self, percent: f64, signal: u32, view: View) -> bool {
        // Drawn once per passage: the number of choices tells one from the next.
        percent > 0.0
            && 100.0
                * Noise::new(view.seed, u64::from(self.me.number), u64::from(signal))
                    .uniform(self.path.n_choices())
                < percent
    }
}

impl Signals {
    /// Path length of the stop line of a light that holds it, metres.
    pub fn light_line_m(&self) -> Option<f64> {
        self.line_m
    }

    /// Finds the first stop line whose light says stop. Whether it passes in the yellow is decided
    /// once, when it sees it.
    pub fn see_lights(&mut self, ahead: &Ahead, passages: &[Passage], view: View) {
        let Ahead {
            me,
            path,
            foot,
            entries,
        } = *ahead;
        let v = me.speed_mps;
        let front = foot.arc_m + me.front_m();
        let legs = path.legs();
        // A vehicle inside a junction clears that one whatever its light.
        let mut here = path.leg_at(front);
        let zone = legs[path.leg_at(foot.arc_m)].zone();
        while zone.is_some() && here < legs.len() && legs[here].zone() == zone {
            here += 1;
        }
        let mut line: Option<f64> = None;
        let mut lights = Vec::new();
        for idx in here..legs.len() {
            let leg = &legs[idx];
            if leg.arc_m[0] > front + 20.0 + v * v / 3.0 + 2.0 * v {
                break;
            }
            for guard in &leg.way.guards {
                let state = view.lights[guard.signal as usize];
                if guard.kind != SignalKind::TrafficLight
                    || !matches!(state, LightState::Red | LightState::Yellow)
                    || ahead.ignores(view.rules.own.ignore_lights_percent, guard.signal, view)
                {
                    continue;
                }
                let on = [Some(leg), idx.checked_sub(1).map(|i| &legs[i])]
                    .into_iter()
                    .flatten()
                    .find(|l| l.lane == guard.lane);
                let Some(arc) = on.map(|l| l.arc_at_m(guard.s_m)) else {
                    continue;
                };
                let left_m = arc - front;
                if left_m < -3.0 {
                    continue;
                }
                let needed = speed::to_stop(v, left_m.max(0.0));
                let known = self
                    .lights
                    .iter()
                    .find(|(signal, _)| *signal == guard.signal);
                // Whoever has to wait for its turn before the line does not pass it.
                let waits = entries.iter().zip(passages).any(|(entry, passage)| {
                    (arc - 1.0..arc + LINE_BEFORE_M).contains(&entry.arc_m[0]) && !passage.may_enter
                });
                // Whose front was beyond the line before the light changed clears the junction.
                let is_beyond = left_m < 0.0;
                let passes = match (known, state) {
                    _ if waits && needed > -9.0 => false,
                    (None, _) if is_beyond => true,
                    (Some((_, passes)), LightState::Yellow) => *passes,
                    (Some((_, passes)), _) => *passes && (is_beyond || needed < -6.0),
                    (None, LightState::Yellow) => {
                        let braking_m = (left_m - YELLOW_REACTION_SECS * v).max(0.0);
                        speed::to_stop(v, braking_m) < -YELLOW_BRAKE_MPS2
                            && left_m < YELLOW_SECS * v
                    }
                    (None, _) => needed < -9.0,
                };
                lights.push((guard.signal, passes));
                if !passes {
                    line = Some(line.map_or(arc, |l| l.min(arc)));
                }
            }
        }
        self.lights = lights;
        self.line_m = line;
    }

    /// Path length of the line of a stop sign at which it has not stood yet.
    pub fn sign_line(&mut self, ahead: &Ahead, view: View) -> Option<f64> {
        let me = ahead.me;
        let front = ahead.foot.arc_m + me.front_m();
        let entry = ahead
            .entries
            .iter()
            .find(|entry| front < entry.arc_m[0] + 1.0)?;
        if !must_stop(ahead.path, entry, view) || self.has_stopped(entry.zone) {
            return None;
        }
        let (zone, line) = (entry.zone, entry.line_m);
        let signal = u32::MAX - zone;
        if ahead.ignores(view.rules.own.ignore_signs_percent, signal, view) {
            return None;
        }
        if self.stopped.0 != zone {
            self.stopped = (zone, 0.0);
        }
        if me.speed_mps.abs() < STANDING_MPS && line - front < WAITING_M + 3.0 {
            self.stopped.1 += view.traffic.period_secs;
        }
        Some(line)
    }

    fn has_stopped(&self, zone: u32) -> bool {
        self.stopped.0 == zone && self.stopped.1 > STOP_SECS
    }

    /// Whether a light or sign holds it before a junction.
    pub fn holds(&self, ahead: &Ahead, entry: &Entry, view: View) -> bool {
        let must_stop = must_stop(ahead.path, entry, view)
            && !self.has_stopped(entry.zone)
            && !ahead.ignores(
                view.rules.own.ignore_signs_percent,
                u32::MAX - entry.zone,
                view,
            );
        must_stop || self.line_m.is_some_and(|line| line < entry.arc_m[0] + 3.0)
    }
}

/// Whether everybody stops there: at a stop sign without a light that works, and where lights are
/// dark and no sign tells the order.
fn must_stop(path: &Path, entry: &Entry, view: View) -> bool {
    if !entry.has_light {
        return entry.sign == Some(SignalKind::Stop);
    }
    let first = entry.legs[0];
    let legs = &path.legs()[first.saturating_sub(1)..=first];
    let guards = legs.iter().flat_map(|leg| &leg.way.guards);
    let is_dark = guards
        .filter(|guard| guard.kind == SignalKind::TrafficLight)
        .all(|guard| view.lights[guard.signal as usize] == LightState::Off);
    is_dark && entry.sign != Some(SignalKind::Yield)
}
