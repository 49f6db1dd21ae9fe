//! Lidar frames. If the GPU casts them, all lidars of a tick are one submission. In either case
//! their frames are sent in their own tick.
//!
//! A head turns at every firing, read or not, and wherever its frame is made: the process that owns
//! the world tells the one that casts where the turn begins.

use anyhow::Context as _;
use nalgebra::Isometry3;
use schema_bus::mono_now;
use schema_frames::{FrameHeader, SceneFiring};
use sensor_gpu::Gpu;
use sensor_ray::{ScanJob, Scans, SensorPath};
use sensor_spec::LidarScan;

use super::rays::{Rays, TickRays};
use super::shot::{Due, Shot, TickView};
use crate::rig::Waking;
use crate::sensor::{Model, Sensor};
use crate::stages;
use crate::topic::{Audience, GpuLoan, Lent, Loans, Writer};

/// Lidars of a tick that the GPU has not finished.
pub(super) struct PendingLidars {
    scans: Lent<Scans<'static>>,
    frames: Vec<PendingLidar>,
}

struct PendingLidar {
    sensor_idx: usize,
    /// Its slot on the GPU, if it is made there alone; dropped after the submission.
    on_gpu: Option<GpuLoan>,
    header: FrameHeader,
}

/// Casts the due lidars on the GPU; `None` if there is nothing to do or the CPU has to do it.
/// `due` is in the order of `sensors`.
pub(super) fn submit(
    sensors: &mut [Sensor],
    rays: &mut Rays,
    tick: &TickView<'_>,
    due: &[Due],
    audience: Audience,
) -> Option<PendingLidars> {
    let _span = stages::LIDAR.span();
    if !rays.casts_lidars_on_gpu() {
        return None;
    }
    let is_read = |due: &Due| {
        let sensor = &sensors[due.sensor_idx];
        fits_gpu(&sensor.model) && sensor.topics[0].is_read(audience)
    };
    let is_left_to_cpu = |due: &Due| {
        let sensor = &sensors[due.sensor_idx];
        matches!(sensor.model, Model::Lidar { .. }) && !fits_gpu(&sensor.model)
    };
    if let Some(due) = due.iter().find(|due| is_left_to_cpu(due)) {
        rays.note_as_sold(&sensors[due.sensor_idx].topics[0].name);
    }
    if !due.iter().any(is_read) {
        return None;
    }
    let gpu = rays.on_gpu(tick.scene)?;
    let (mut jobs, mut frames, mut loans) = (Vec::new(), Vec::new(), Vec::new());
    let mut due = due.iter().peekable();
    for (sensor_idx, sensor) in sensors.iter_mut().enumerate() {
        let Some(due) = due.next_if(|due| due.sensor_idx == sensor_idx) else {
            continue;
        };
        if !fits_gpu(&sensor.model) {
            continue;
        }
        let shot = Shot::new(tick, due, sensor, audience);
        let Some(Aimed {
            slots: Loans { host, gpu },
            header,
            path,
        }) = aim(&shot, sensor, Writer::Gpu)
        else {
            continue;
        };
        let (on_gpu, place_on_gpu) = gpu.unzip();
        let place = match (host, place_on_gpu) {
            (Some(loan), _) => {
                let (loan, place) = sensor.topics[0].lend(loan);
                loans.push(loan);
                place
            }
            (None, Some(place)) => place,
            (None, None) => continue,
        };
        let Model::Lidar { lidar, .. } = &mut sensor.model else {
            continue;
        };
        frames.push(PendingLidar {
            sensor_idx,
            on_gpu,
            header,
        });
        jobs.push(ScanJob {
            lidar,
            path,
            noise: shot.noise,
            ignored: None,
            place,
        });
    }
    Some(PendingLidars {
        scans: Lent::new(gpu.scan(jobs), loans),
        frames,
    })
}

/// Whether it is a lidar that the GPU casts, if it casts any: its shader knows an even fan of beams
/// from one origin, and no returns.
pub(super) fn fits_gpu(model: &Model) -> bool {
    matches!(model, Model::Lidar { lidar, .. } if !lidar.spec().is_as_sold())
}

/// Waits for the lidars of this tick and sends them; returns how many were cast.
pub(super) fn finish(
    sensors: &mut [Sensor],
    gpu: Option<&Gpu>,
    pending: PendingLidars,
    waking: &mut Waking,
    audience: Audience,
) -> anyhow::Result<u64> {
    let _span = stages::LIDAR.span();
    let (outcomes, mut loans) = pending
        .scans
        .wait(Scans::wait)
        .context("the GPU did not finish its lidars")?;
    let mut n_turns = 0;
    for (frame, outcome) in pending.frames.into_iter().zip(outcomes) {
        let sensor = &mut sensors[frame.sensor_idx];
        let mut header = frame.header;
        header.set_list(outcome.n_points);
        header.cpu_copies = outcome.cpu_copies;
        header.rendered_mono_nanos = mono_now().0;
        let topic = &mut sensor.topics[0];
        match frame.on_gpu {
            Some(on_gpu) => topic.send_on_gpu(on_gpu, &header, true),
            None => {
                let loan = loans.next().context("a lidar lost its loan")?;
                topic.send_list(gpu, loan, header, audience)?;
            }
        }
        n_turns += 1;
        waking.add(&sensor.rig);
    }
    Ok(n_turns)
}

/// Casts a lidar on the CPU and sends its frame, unless `may_send` says that it is not this process's
/// to send any more; returns whether it was sent.
pub(super) fn cast_on_cpu(
    shot: &Shot<'_>,
    sensor: &mut Sensor,
    rays: &mut TickRays<'_>,
    gpu: Option<&Gpu>,
    may_send: &mut dyn FnMut() -> bool,
) -> anyhow::Result<bool> {
    let _span = stages::LIDAR.span();
    let Some(Aimed {
        slots: Loans {
            host: Some(mut loan),
            ..
        },
        mut header,
        path,
    }) = aim(shot, sensor, Writer::Cpu)
    else {
        return Ok(false);
    };
    let Model::Lidar { lidar, .. } = &mut sensor.model else {
        return Ok(false);
    };
    header.set_list(lidar.scan(rays.current(), &path, shot.noise, None));
    lidar.write(loan.payload_mut());
    header.rendered_mono_nanos = mono_now().0;
    if !may_send() {
        return Ok(false);
    }
    sensor.topics[0].send_list(gpu, loan, header, shot.audience)?;
    Ok(true)
}

/// Turns a lidar's head by one tick; returns its pose when the turn began, and for how long the head
/// had turned before. `None` for other sensors.
pub(super) fn turn_head(
    sensor: &mut Sensor,
    world_from_sensor: Isometry3<f64>,
    period_nanos: u64,
) -> Option<(Isometry3<f64>, u64)> {
    let Model::Lidar {
        lidar,
        previous,
        ticks,
    } = &mut sensor.model
    else {
        return None;
    };
    let turned_nanos = lidar.turned_nanos();
    lidar.turn_head(period_nanos, sensor.topics[0].max_elements());
    let start = match lidar.spec().scan {
        LidarScan::Turn => previous.replace(world_from_sensor),
        LidarScan::Sweep => ticks[0],
    };
    Some((start.unwrap_or(world_from_sensor), turned_nanos))
}

/// Takes over where a lidar's turn begins from the process that owns the world.
pub(super) fn begin_turn(model: &mut Model, given: &SceneFiring) {
    if let Model::Lidar {
        lidar,
        previous,
        ticks,
    } = model
    {
        let start = given.world_from_sensor_start.isometry();
        lidar.set_turned(given.turned_nanos);
        *previous = Some(start);
        *ticks = [Some(start), Some(given.world_from_sensor.isometry())];
    }
}

/// A lidar that is ready to cast. The number of points is not in the header yet.
struct Aimed {
    slots: Loans,
    header: FrameHeader,
    path: SensorPath,
}

/// Turns a lidar's head, read or not, and prepares its frame if somebody reads.
fn aim(shot: &Shot<'_>, sensor: &mut Sensor, caster: Writer) -> Option<Aimed> {
    let mut header = shot.only_header(sensor);
    let scene = shot.tick.scene;
    let (start, _) = turn_head(sensor, shot.world_from_sensor, scene.period_nanos)?;
    let (topic, Model::Lidar { lidar, .. }) = (&mut sensor.topics[0], &mut sensor.model) else {
        return None;
    };
    // A frame for both kinds of readers is made in shared memory, and uploaded from there.
    let slots = match caster {
        Writer::Gpu if topic.is_read_on_gpu_alone(shot.audience) => {
            topic.loans_if_read(shot.audience)
        }
        _ => Loans {
            host: topic.loan_if_read(shot.audience),
            gpu: None,
        },
    };
    if slots.host.is_none() && slots.gpu.is_none() {
        return None;
    }
    let path = SensorPath {
        world_from_sensor_start: start,
        world_from_sensor: shot.world_from_sensor,
    };
    lidar.set_extinction(scene.lidar_extinction_per_m);
    let firing = shot.due.firing;
    lidar.set_window(firing.window_nanos);
    // Before its first firing a lidar saw nothing, whatever others have seen.
    lidar.set_past(match (firing.previous, lidar.spec().scan) {
        (None, _) => 0,
        (Some(_), LidarScan::Turn) => firing.window_nanos,
        (Some(_), LidarScan::Sweep) => scene.period_nanos,
    });
    header.range_limit_m = lidar.spec().range_m as f32;
    header.n_channels = lidar.spec().channels;
    header.azimuth_rad = lidar.head_rad() as f32;
    Some(Aimed {
        slots,
        header,
        path,
    })
}
