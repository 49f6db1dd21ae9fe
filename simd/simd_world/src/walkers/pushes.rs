//! What commands push a walker with. Its feet hold against it, as against a vehicle's blow.

use nalgebra::Vector3;
use schema_frames::PhysicsAction;

use super::impact::KNOCK_MPS;
use super::walker::{Fall, Walker};
use crate::pushes::Push;

impl Walker {
    /// Carries out a switch.
    pub fn switch(&mut self, action: &PhysicsAction) {
        match action {
            PhysicsAction::SetSimulated { enabled } => self.simulated = *enabled,
            PhysicsAction::SetCollisions { enabled } => self.collides = *enabled,
            PhysicsAction::SetGravity { enabled } => self.gravity = *enabled,
            _ => {}
        }
    }

    /// Takes a push; nothing pushes a walker that does not move by itself. Points do not count,
    /// because a body stays upright until it falls.
    pub fn take(&mut self, push: Push) {
        if !self.simulated {
            return;
        }
        let mass_kg = self.model().mass_kg;
        match push {
            Push::Velocity(velocity) => {
                // Its own steps go on beside what it is pushed with.
                let own = match self.fall {
                    None => self.wish_mps(),
                    Some(_) => Vector3::zeros(),
                };
                self.pushed_mps = [velocity.x - own.x, velocity.y - own.y];
                self.rise(velocity.z - self.rise_mps);
            }
            Push::Impulse(impulse, _) => self.blow(impulse / mass_kg),
            Push::Force(force, _) => {
                self.pushed.force_n = (Vector3::from(self.pushed.force_n) + force).into();
            }
            Push::Spin(spin) => self.pushed.radps = spin.z,
            Push::AngularImpulse(impulse) => self.pushed.radps += impulse.z / self.inertia_kgm2(),
            Push::Torque(torque) => self.pushed.torque_nm += torque.z,
        }
    }

    /// Changes its velocity at once; a strong blow knocks over who is not invincible.
    fn blow(&mut self, kick_mps: Vector3<f64>) {
        self.pushed_mps[0] += kick_mps.x;
        self.pushed_mps[1] += kick_mps.y;
        self.rise(kick_mps.z);
        let along = kick_mps.xy();
        if !self.invincible && self.fall.is_none() && along.norm() > KNOCK_MPS {
            self.fall = Some(Fall {
                towards: along.normalize().into(),
                angle_rad: 0.0,
            });
        }
    }

    /// Adds to its upward speed; who stands on the ground cannot be pushed into it.
    fn rise(&mut self, by_mps: f64) {
        if by_mps > 0.0 || !self.on_ground {
            self.rise_mps += by_mps;
            self.on_ground = false;
        }
    }

    /// Lets forces and torques act for a part of a tick, before the body moves.
    pub(super) fn heed_forces(&mut self, weight_n: f64, dt_secs: f64) {
        let [x, y, z] = self.pushed.force_n;
        let mass_kg = self.model().mass_kg;
        self.pushed_mps[0] += x / mass_kg * dt_secs;
        self.pushed_mps[1] += y / mass_kg * dt_secs;
        // The ground takes what presses down, and what lifts less than the weight.
        if !self.on_ground || z > weight_n {
            let lifted_n = if self.on_ground { z - weight_n } else { z };
            self.rise(lifted_n / mass_kg * dt_secs);
        }
        self.pushed.radps += self.pushed.torque_nm / self.inertia_kgm2() * dt_secs;
    }

    /// Turns the body as far as pushes do in a part of a tick; `slow_radps2` is how fast its feet
    /// stop that.
    pub(super) fn spin(&mut self, slow_radps2: f64, dt_secs: f64) {
        use std::f64::consts::{PI, TAU};
        let radps = self.pushed.radps;
        self.yaw_rad = (self.yaw_rad + radps * dt_secs + PI).rem_euclid(TAU) - PI;
        let left = (radps.abs() - slow_radps2 * dt_secs).max(0.0);
        self.pushed.radps = left.copysign(radps);
    }

    /// Forces are for one tick.
    pub(super) fn end_forces(&mut self) {
        (self.pushed.force_n, self.pushed.torque_nm) = ([0.0; 3], 0.0);
    }

    /// Moment of inertia about the upright axis: that of a cylinder.
    fn inertia_kgm2(&self) -> f64 {
        0.5 * self.model().mass_kg * self.model().radius_m().powi(2)
    }
}
