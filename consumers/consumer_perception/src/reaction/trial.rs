//! One trial: back to the checkpoint, a wait, the command, and what came of it.

use schema_frames::{ActorRecord, Command, CommandReply, LightState, WalkerControl};
use schema_types::Pose;

use super::observer::{Log, Tick};
use super::scene::{Plan, props};
use super::session::{Refused, Session};
use super::stage::{holds, matched_mps};
use super::steering::Course;
use super::suite::{Drive, Kind, Stage, Suite};
use super::summary::{BRAKES, Outcome, Reaction, Stimulus, Trial};

/// Bit of the brake lamps.
const BRAKE_LAMPS: u32 = 8;
/// How much the ego's brake must act to count.
const ACTS: f32 = 0.05;

/// How a trial ended.
#[derive(Debug)]
pub enum Ended {
    /// It is over; it may have failed for a reason that does not touch the next one.
    Over(Box<Trial>),
    /// The processes have to be started again.
    Lost(Box<Trial>),
}

/// Runs a trial.
pub fn run(session: &mut Session, suite: &Suite, plan: &Plan, stop: &dyn Fn() -> bool) -> Ended {
    let failed = |reason: String| {
        Box::new(Trial {
            plan: plan.clone(),
            failed: Some(reason),
            stimulus: None,
            stages: Vec::new(),
        })
    };
    // What ended before this trial is no reason for its failure.
    if let Err(error) = session
        .deaths()
        .and_then(|_| session.await_programs(suite, stop))
    {
        return Ended::Lost(failed(format!("{error:#}")));
    }
    match attempt(session, suite, plan, stop) {
        Ok(trial) => Ended::Over(Box::new(trial)),
        Err(error) if error.is::<Refused>() => Ended::Over(failed(format!("{error:#}"))),
        Err(error) => Ended::Lost(failed(format!("{error:#}"))),
    }
}

fn attempt(
    session: &mut Session,
    suite: &Suite,
    plan: &Plan,
    stop: &dyn Fn() -> bool,
) -> anyhow::Result<Trial> {
    let until_go_secs = suite.settle_s + plan.wait_s;
    let mut log = begin(session, suite, plan, until_go_secs)?;
    let kind = plan.kind;
    let mut trial = Trial {
        plan: plan.clone(),
        failed: None,
        stimulus: None,
        stages: Vec::new(),
    };

    // The wait, in which nothing happens that a chain could react to.
    let begin_nanos = wait_for_first(session, suite, &mut log, stop)?;
    let since = move |log: &Log| {
        let now = log.newest().map_or(begin_nanos, |(_, tick)| tick.sim_nanos);
        now.saturating_sub(begin_nanos) as f64 * 1e-9
    };
    let mut armed_tick = 0;
    session.until(suite, &mut log, stop, &mut |session, log| {
        drive(session, suite, plan, log, false);
        if armed_tick == 0 && since(log) >= suite.settle_s {
            armed_tick = log.newest().map_or(0, |(tick, _)| tick);
        }
        since(log) >= until_go_secs
    })?;
    if armed_tick == 0 {
        armed_tick = log.newest().map_or(0, |(tick, _)| tick);
    }

    // The command, and what follows.
    let go = command(session, plan, &log)?;
    let go_nanos = log.newest().map_or(begin_nanos, |(_, tick)| tick.sim_nanos);
    let mut deaths = Vec::new();
    session.until(suite, &mut log, stop, &mut |session, log| {
        drive(session, suite, plan, log, true);
        // A log that cannot be read is found by the next look at the processes.
        deaths.extend(session.deaths().unwrap_or_default());
        if !deaths.is_empty() || log.is_other_epoch {
            return true;
        }
        let now = log.newest().map_or(0, |(_, tick)| tick.sim_nanos);
        let after = |nanos: u64| now.saturating_sub(nanos) as f64 * 1e-9;
        match stimulus(log, suite, kind, go, go_nanos) {
            None => after(go_nanos) > suite.appear_s,
            Some(stimulus) => {
                after(stimulus.sim_nanos) > suite.window_s
                    || outcomes(log, suite, kind, armed_tick, &stimulus)
                        .iter()
                        .all(|it| it.reaction.is_some())
            }
        }
    })?;
    deaths.extend(session.deaths()?);
    trial.stimulus = stimulus(&log, suite, kind, go, go_nanos);
    trial.failed = match &trial.stimulus {
        _ if log.is_other_epoch => Some("the simulator was restarted".into()),
        _ if !deaths.is_empty() => Some(deaths.join("; ")),
        _ if was_seen_before(&log, suite, kind, armed_tick, go) => {
            Some("it could be seen before the command".into())
        }
        None => Some(format!(
            "nothing came into sight within {} s",
            suite.appear_s
        )),
        Some(_) if log.n_left_out > 0 => {
            Some("more was published than can be kept of one trial".into())
        }
        Some(stimulus) => {
            trial.stages = outcomes(&log, suite, kind, armed_tick, stimulus);
            None
        }
    };
    Ok(trial)
}

/// Goes back to the checkpoint and puts everything in its place.
fn begin(
    session: &mut Session,
    suite: &Suite,
    plan: &Plan,
    until_go_secs: f64,
) -> anyhow::Result<Log> {
    let props = props(
        plan,
        suite,
        &session.road,
        &session.catalogue,
        until_go_secs,
    )
    .map_err(|error| anyhow::Error::new(Refused(error.to_string())))?;
    let mut commands = vec![session.back()];
    commands.extend(props.iter().map(|prop| Command::Spawn {
        type_id: prop.type_id.clone(),
        pose: Pose::from(prop.pose).into(),
        parent_id: None,
        role: "reaction".into(),
        attributes: Default::default(),
    }));
    let mut log = Log::default();
    log.cast.ego = session.ego;
    if let (Kind::LightTurnsRed, Some(light)) = (plan.kind, session.light) {
        let x = light.stop_x_m - plan.distance_m - suite.speed_mps * until_go_secs;
        if x < 0.0 {
            anyhow::bail!(Refused(format!(
                "the light is {:.0} m ahead of the ego's start, and {:.0} m are needed",
                light.stop_x_m,
                light.stop_x_m - x
            )));
        }
        log.cast.subject = light.id;
        commands.extend([
            Command::SetPose {
                actor_id: session.ego,
                pose: Pose::from(session.road.at(x, 0.0, 0.0, 0.0)).into(),
            },
            Command::FreezeTrafficLights { frozen: true },
            light_state(light.id, LightState::Green),
        ]);
    }
    session.observer.skip(&session.bus, suite)?;
    let (_, replies) = session.ask(commands)?;
    let spawned: Vec<u32> = replies
        .iter()
        .filter_map(|reply| match reply {
            CommandReply::Spawned { actor_id, .. } => Some(*actor_id),
            _ => None,
        })
        .collect();
    let mut moves = Vec::new();
    for (prop, id) in props.iter().zip(&spawned) {
        if prop.is_obstacle {
            log.cast.subject = *id;
            let entry = session
                .catalogue
                .entries
                .iter()
                .find(|it| it.type_id == prop.type_id);
            log.cast.centre_m = entry.map_or([0.0; 3], |it| it.body_box.centre_m);
        }
        if prop.speed_mps > 0.0 {
            moves.push(Command::SetVelocity {
                actor_id: *id,
                velocity_in_world_mps: session.road.velocity(prop.speed_mps),
            });
        }
    }
    if !moves.is_empty() {
        session.ask(moves)?;
    }
    // What was sent before the world went back belongs to no trial.
    session.observer.skip(&session.bus, suite)?;
    Ok(log)
}

/// Waits for the first tick of a trial; returns its simulated time.
fn wait_for_first(
    session: &mut Session,
    suite: &Suite,
    log: &mut Log,
    stop: &dyn Fn() -> bool,
) -> anyhow::Result<u64> {
    session.until(suite, log, stop, &mut |_, log| log.newest().is_some())?;
    Ok(log.newest().map_or(0, |(_, tick)| tick.sim_nanos))
}

/// Drives the ego, unless a program does, and the other car.
fn drive(session: &mut Session, suite: &Suite, plan: &Plan, log: &Log, is_go: bool) {
    let mut courses = Vec::new();
    // Once the chain brakes the car is its own.
    let is_free = || {
        let newest = log.newest().and_then(|(_, tick)| tick.ego);
        !is_go || newest.is_some_and(|ego| !acts(&ego))
    };
    if suite.drive == Drive::Cruise && is_free() {
        let course = Course {
            y_m: 0.0,
            speed_mps: suite.speed_mps,
            brake_ratio: None,
        };
        courses.push((session.ego, course));
    }
    match plan.kind {
        Kind::PedestrianStepsOut | Kind::LightTurnsRed => {}
        Kind::CutIn => {
            let settings = suite.kind.get(&plan.kind);
            let lane_m = settings.and_then(|it| it.lane_m).unwrap_or(3.6);
            let course = Course {
                y_m: if is_go { 0.0 } else { plan.side * lane_m },
                speed_mps: plan.speed_mps,
                brake_ratio: None,
            };
            courses.push((log.cast.subject, course));
        }
        Kind::LeadBrakes => {
            let course = Course {
                y_m: 0.0,
                speed_mps: suite.speed_mps,
                brake_ratio: is_go.then_some(plan.brake_ratio),
            };
            courses.push((log.cast.subject, course));
        }
    }
    session.steer(log, &courses);
}

/// Gives the command; returns the first tick that it can act on.
fn command(session: &mut Session, plan: &Plan, log: &Log) -> anyhow::Result<u64> {
    let newest = log.newest().map_or(0, |(tick, _)| tick);
    match plan.kind {
        Kind::PedestrianStepsOut => {
            let across = session.road.world_from_road.rotation
                * nalgebra::Vector3::new(0.0, -plan.side, 0.0);
            let control = WalkerControl {
                direction: [across.x as f32, across.y as f32, 0.0],
                speed_mps: plan.speed_mps as f32,
                jump: false,
            };
            let (tick, _) = session.ask(vec![Command::ControlWalker {
                actor_id: log.cast.subject,
                control,
            }])?;
            Ok(tick + 1)
        }
        Kind::LightTurnsRed => {
            let (tick, _) = session.ask(vec![light_state(log.cast.subject, LightState::Red)])?;
            Ok(tick + 1)
        }
        // Their controls change with the next tick.
        Kind::CutIn | Kind::LeadBrakes => Ok(newest + 1),
    }
}

fn light_state(actor_id: u32, state: LightState) -> Command {
    Command::SetTrafficLight {
        actor_id,
        state: state.name().into(),
    }
}

/// The first tick from `go` on of which the truth camera shows what has changed.
fn stimulus(log: &Log, suite: &Suite, kind: Kind, go: u64, go_nanos: u64) -> Option<Stimulus> {
    let before = log
        .ticks
        .range(..go)
        .next_back()
        .and_then(|(_, tick)| tick.subject);
    let mut unseen_ticks = 0;
    let (tick, at) = log.ticks.range(go..).find(|(_, at)| {
        let Some(view) = at.view else {
            unseen_ticks += 1;
            return false;
        };
        let shows =
            view.shown.visible >= suite.truth.min_pixels && shows_change(kind, at, before.as_ref());
        if !shows {
            unseen_ticks = 0;
        }
        shows
    })?;
    let (view, ego) = (at.view?, at.ego?);
    let offset = at.subject.map_or(0.0, |subject| {
        let ego = nalgebra::Vector3::from(ego.world_from_actor.translation_m);
        (nalgebra::Vector3::from(subject.world_from_actor.translation_m) - ego).norm()
    });
    Some(Stimulus {
        tick: *tick,
        sim_nanos: at.sim_nanos,
        mono_nanos: at.mono_nanos,
        visible_pixels: view.shown.visible,
        unseen_ticks,
        after_command_ms: at.sim_nanos.saturating_sub(go_nanos) as f64 * 1e-6,
        distance_m: offset,
        ego_mps: ego.speed_mps(),
        pace: log.clock.pace().unwrap_or(0.0),
    })
}

/// Whether an obstacle that should be hidden was visible before the command.
fn was_seen_before(log: &Log, suite: &Suite, kind: Kind, armed_tick: u64, go: u64) -> bool {
    let shows = |tick: &Tick| {
        tick.view
            .is_some_and(|view| view.shown.visible >= suite.truth.min_pixels)
    };
    kind == Kind::PedestrianStepsOut
        && log
            .ticks
            .range(armed_tick..go.max(armed_tick))
            .any(|(_, tick)| shows(tick))
}

/// Whether a tick shows what happens: the change itself, beside the pixels of who changes.
fn shows_change(kind: Kind, at: &Tick, before: Option<&ActorRecord>) -> bool {
    let Some(subject) = at.subject else {
        return false;
    };
    match kind {
        Kind::PedestrianStepsOut => true,
        Kind::LeadBrakes => subject
            .vehicle()
            .is_some_and(|it| it.lamps & BRAKE_LAMPS != 0),
        Kind::LightTurnsRed => subject
            .traffic_light()
            .is_some_and(|it| LightState::from_code(it.state) == LightState::Red),
        Kind::CutIn => before.zip(at.view).is_some_and(|(before, view)| {
            // It has moved aside by a pixel from the line that it drove on.
            let aside =
                before.world_from_actor.isometry().inverse() * subject.world_from_actor.isometry();
            let in_camera = view.world_from_sensor.inverse() * subject.world_from_actor.isometry();
            let ahead_m = in_camera.translation.x.max(1.0);
            aside.translation.y.abs() / ahead_m * view.focal_px >= 1.0
        }),
    }
}

/// Whether a vehicle brakes.
fn acts(ego: &ActorRecord) -> bool {
    ego.vehicle()
        .is_some_and(|it| it.brake_ratio > ACTS || it.control_flags & 1 != 0)
}

/// What came of each stage: those of the suite, and when the car braked.
fn outcomes(
    log: &Log,
    suite: &Suite,
    kind: Kind,
    armed_tick: u64,
    stimulus: &Stimulus,
) -> Vec<Outcome> {
    let mut outcomes: Vec<Outcome> = suite
        .stages_of(kind)
        .map(|(index, stage)| outcome(log, suite, index, stage, armed_tick, stimulus))
        .collect();
    if suite
        .stages_of(kind)
        .any(|(_, stage)| stage.control.is_some())
    {
        outcomes.push(braking(log, suite, armed_tick, stimulus));
    }
    outcomes
}

fn outcome(
    log: &Log,
    suite: &Suite,
    index: usize,
    stage: &Stage,
    armed_tick: u64,
    stimulus: &Stimulus,
) -> Outcome {
    let mut found = Outcome {
        stage: stage.name.clone(),
        reaction: None,
        n_alarms: 0,
        n_results: 0,
    };
    let is_control = stage.control.is_some();
    let armed_nanos = log.ticks.get(&armed_tick).map_or(0, |tick| tick.mono_nanos);
    // The speed that a drop is measured from: the first one for alarms, the last one for reactions.
    let (mut first_mps, mut last_mps) = (None, None);
    for said in log.said.iter().filter(|said| said.stage == index) {
        let is_after = if is_control {
            if said.mono_nanos < armed_nanos {
                continue;
            }
            // A writer that names no tick is judged by the clock alone.
            said.mono_nanos >= stimulus.mono_nanos && (said.tick == 0 || said.tick >= stimulus.tick)
        } else {
            if said.tick < armed_tick {
                continue;
            }
            said.tick >= stimulus.tick
        };
        found.n_results += 1;
        // A control is correct whatever is true about the obstacle.
        let at = if is_control { stimulus.tick } else { said.tick };
        let Some(truth) = log.truth(at) else {
            continue;
        };
        if !is_after {
            if let Some(mps) = matched_mps(stage, &said.claim, &truth) {
                first_mps.get_or_insert(mps);
                last_mps = Some(mps);
            }
            found.n_alarms += u64::from(holds(stage, &said.claim, &truth, first_mps));
        } else if found.reaction.is_none()
            && said.mono_nanos >= stimulus.mono_nanos
            && holds(stage, &said.claim, &truth, last_mps)
        {
            found.reaction =
                reaction(log, suite, stimulus, said.tick, said.mono_nanos).map(|it| Reaction {
                    within_nanos: said.within_nanos,
                    sensor_nanos: (said.origin_mono_nanos > 0)
                        .then(|| said.origin_mono_nanos.saturating_sub(stimulus.mono_nanos)),
                    ..it
                });
        }
    }
    found
}

/// A reaction at a moment, if it lies within the window.
fn reaction(
    log: &Log,
    suite: &Suite,
    stimulus: &Stimulus,
    tick: u64,
    mono_nanos: u64,
) -> Option<Reaction> {
    let sim_nanos = log.clock.sim_at(mono_nanos)? - stimulus.sim_nanos as f64;
    (sim_nanos <= suite.window_s * 1e9).then(|| Reaction {
        tick,
        wall_nanos: mono_nanos.saturating_sub(stimulus.mono_nanos),
        sim_nanos: sim_nanos.max(0.0) as u64,
        within_nanos: 0,
        sensor_nanos: None,
    })
}

/// When the car itself braked, from the world's snapshots.
fn braking(log: &Log, suite: &Suite, armed_tick: u64, stimulus: &Stimulus) -> Outcome {
    let brakes = |tick: &Tick| tick.ego.is_some_and(|ego| acts(&ego));
    let (mut n_alarms, mut n_results) = (0, 0);
    let mut reacted = None;
    for (number, tick) in log.ticks.range(armed_tick..) {
        n_results += 1;
        if !brakes(tick) {
            continue;
        }
        // A brake that acts in the stimulus's own tick was pressed before it.
        if *number <= stimulus.tick {
            n_alarms += 1;
        } else if reacted.is_none() {
            reacted = reaction(log, suite, stimulus, *number, tick.mono_nanos);
        }
    }
    Outcome {
        stage: BRAKES.to_owned(),
        reaction: reacted,
        n_alarms,
        n_results,
    }
}
