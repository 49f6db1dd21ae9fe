//! What the world's records say beside poses: traffic lights, trails, and what the rigs' vehicles are
//! doing.

use std::collections::BTreeMap;

use rerun::{RecordingStream, Rgba32};
use schema_frames::{ActorRecord, LightState};

use crate::layout;
use crate::rerun;

/// Points of a trail, and the distance between them, metres.
const TRAIL_POINTS: usize = 600;
const TRAIL_STEP_M: f64 = 1.0;
/// A farther step is a jump, which begins the trail anew, metres.
const JUMP_M: f64 = 30.0;
/// Lamps of a vehicle, as in its record.
const RIGHT: u32 = 16;
const LEFT: u32 = 32;

/// What of it the recording holds.
#[derive(Default)]
pub(crate) struct Traffic {
    lights: Vec<(u32, u32)>,
    trails: BTreeMap<String, Vec<[f64; 3]>>,
    states: BTreeMap<String, &'static str>,
}

impl Traffic {
    /// Shows the traffic lights if one has changed; `at` is where a record's lamps are.
    pub(crate) fn show_lights(
        &mut self,
        rec: &RecordingStream,
        records: &[ActorRecord],
        at: impl Fn(&ActorRecord) -> [f32; 3],
    ) -> anyhow::Result<()> {
        let light = |record: &ActorRecord| Some((record.id, record.traffic_light()?.state));
        let now: Vec<(u32, u32)> = records.iter().filter_map(light).collect();
        if now == self.lights {
            return Ok(());
        }
        let lit = records.iter().filter(|record| light(record).is_some());
        let colours = now
            .iter()
            .map(|(_, state)| light_colour(LightState::from_code(*state)));
        let names = now
            .iter()
            .map(|(id, state)| format!("{id} {}", LightState::from_code(*state).name()));
        let points = rerun::Points3D::new(lit.map(at))
            .with_colors(colours)
            .with_labels(names)
            .with_show_labels(false)
            .with_radii([0.45]);
        rec.log(format!("{}/lights", layout::WORLD), &points)?;
        self.lights = now;
        Ok(())
    }

    /// Goes on with a rig's trail.
    pub(crate) fn follow(
        &mut self,
        rec: &RecordingStream,
        rig: &str,
        place_m: [f64; 3],
    ) -> anyhow::Result<()> {
        let trail = self.trails.entry(rig.to_owned()).or_default();
        let step_m = trail.last().map_or(f64::INFINITY, |last| {
            (0..3)
                .map(|i| (place_m[i] - last[i]).powi(2))
                .sum::<f64>()
                .sqrt()
        });
        if step_m < TRAIL_STEP_M {
            return Ok(());
        }
        if step_m > JUMP_M {
            trail.clear();
        }
        trail.push(place_m);
        if trail.len() > TRAIL_POINTS {
            trail.remove(0);
        }
        let strip = rerun::LineStrip3D::from_iter(trail.iter().map(|at| at.map(|x| x as f32)));
        let line = rerun::LineStrips3D::new([strip])
            .with_colors([Rgba32::from_rgb(255, 170, 40)])
            .with_radii([0.12]);
        Ok(rec.log(format!("{}/trails/{rig}", layout::WORLD), &line)?)
    }

    /// Shows what a rig's vehicle is doing, as far as it has changed.
    pub(crate) fn show_states(
        &mut self,
        rec: &RecordingStream,
        rig: &str,
        record: &ActorRecord,
    ) -> anyhow::Result<()> {
        let Some(vehicle) = record.vehicle() else {
            return Ok(());
        };
        let light = match vehicle.light_actor_id {
            0 => "",
            _ => LightState::from_code(vehicle.light_state).name(),
        };
        let indicator = match (vehicle.lamps & LEFT != 0, vehicle.lamps & RIGHT != 0) {
            (true, true) => "both",
            (true, false) => "left",
            (false, true) => "right",
            (false, false) => "",
        };
        let gear = match vehicle.gear {
            i32::MIN..=-1 => "R",
            0 => "N",
            1 => "1",
            2 => "2",
            3 => "3",
            4 => "4",
            5 => "5",
            6 => "6",
            _ => "7 and up",
        };
        let contact = match record.flags & ActorRecord::TOUCHED != 0 {
            true => "contact",
            false => "",
        };
        for (name, state) in [
            ("light", light),
            ("indicator", indicator),
            ("gear", gear),
            ("contact", contact),
        ] {
            let path = format!("{}/{rig}/{name}", layout::STATES);
            // Nothing before and nothing now needs no lane.
            if self.states.get(&path).copied().unwrap_or("") != state {
                rec.log(path.as_str(), &rerun::StateChange::single(state))?;
                self.states.insert(path, state);
            }
        }
        Ok(())
    }
}

fn light_colour(state: LightState) -> Rgba32 {
    let [r, g, b] = match state {
        LightState::Red => [240, 50, 40],
        LightState::Yellow => [250, 200, 40],
        LightState::Green => [40, 210, 90],
        LightState::Off | LightState::Unknown => [90, 90, 95],
    };
    Rgba32::from_rgb(r, g, b)
}

/// Colours of the states on their lanes, for the whole recording.
pub(crate) fn colour_states(rec: &RecordingStream, rig: &str) -> anyhow::Result<()> {
    let lights = [LightState::Red, LightState::Yellow, LightState::Green];
    let light = rerun::StateConfiguration::new()
        .with_values(lights.map(|state| state.name()))
        .with_colors(lights.map(light_colour));
    rec.log_static(format!("{}/{rig}/light", layout::STATES), &light)?;
    let contact = rerun::StateConfiguration::new()
        .with_values(["contact"])
        .with_colors([Rgba32::from_rgb(240, 80, 70)]);
    Ok(rec.log_static(format!("{}/{rig}/contact", layout::STATES), &contact)?)
}
