//! Lidar frames: all of a tick in one submission where the GPU casts them, else on the CPU. Either
//! way they are sent in their own tick.

use std::rc::Rc;

use anyhow::Context as _;
use schema_bus::{FrameLoan, mono_now};
use schema_frames::FrameHeader;
use sensor_core::scene::Scene;
use sensor_core::schedule::Firing;
use sensor_gpu::Place;
use sensor_ray::{ScanJob, Scans, SensorPath};
use sensor_spec::LidarScan;

use super::cpu::{Shot, TickRays};
use super::{Carrier, Sensors, Stamp, remember};
use crate::rig::{Model, Rig, Sensor};

/// Lidars of a tick on their way.
pub(super) struct PendingLidars {
    scans: Scans<'static>,
    frames: Vec<PendingLidar>,
}

struct PendingLidar {
    sensor_idx: usize,
    loan: FrameLoan,
    header: FrameHeader,
}

impl Sensors {
    /// Casts the due lidars on the GPU; `None` if there is nothing to do or the CPU has to do it.
    pub(super) fn submit_lidars(
        &mut self,
        scene: &Scene,
        stamp: &Stamp,
        due: &[(usize, Firing, Carrier)],
    ) -> Option<PendingLidars> {
        let read_everything = self.read_everything;
        let is_read = |(idx, ..): &(usize, Firing, Carrier)| {
            let sensor = &self.sensors[*idx];
            matches!(sensor.model, Model::Lidar { .. })
                && (read_everything || sensor.topics[0].n_readers() > 0)
        };
        if self.lidar_gpu.is_none() || !due.iter().any(is_read) {
            return None;
        }
        let (Some(gpu), Some(rays)) = (&mut self.lidar_gpu, &mut self.rays) else {
            return None;
        };
        rays.update_for_gpu(&scene.dynamics);
        if let Err(why) = gpu.update(rays) {
            if !std::mem::replace(&mut self.lidars_were_refused, true) {
                tracing::warn!(
                    tick = scene.tick.0,
                    why,
                    "lidars are cast on the CPU as long as they are too much for the GPU; said once"
                );
            }
            return None;
        }
        let (mut jobs, mut frames) = (Vec::new(), Vec::new());
        let mut due = due.iter().peekable();
        for (sensor_idx, sensor) in self.sensors.iter_mut().enumerate() {
            let Some((_, firing, carrier)) = due.next_if(|(idx, ..)| *idx == sensor_idx) else {
                continue;
            };
            if !matches!(sensor.model, Model::Lidar { .. }) {
                continue;
            }
            let shot = Shot::new(scene, stamp, firing, carrier, sensor);
            let Some((loan, header, path)) = shot.aim_lidar(sensor, read_everything) else {
                continue;
            };
            let topic = &sensor.topics[0];
            let place = Place::Shm {
                target: topic
                    .target()
                    .cloned()
                    .expect("lidars that the GPU casts have a target while they have memory"),
                offset_bytes: loan
                    .offset_in_segment()
                    .expect("the segment was asked for when the topic was opened"),
                capacity_bytes: topic.max_payload_bytes,
            };
            let Model::Lidar { lidar, .. } = &mut sensor.model else {
                continue;
            };
            frames.push(PendingLidar {
                sensor_idx,
                loan,
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
            scans: gpu.scan(jobs),
            frames,
        })
    }

    /// Waits for the lidars of this tick and sends them.
    pub(super) fn finish_lidars(
        &mut self,
        pending: PendingLidars,
        waking: &mut Vec<Rc<Rig>>,
    ) -> anyhow::Result<()> {
        let outcomes = pending
            .scans
            .wait()
            .context("the GPU did not finish its lidars")?;
        for (frame, outcome) in pending.frames.into_iter().zip(outcomes) {
            let sensor = &mut self.sensors[frame.sensor_idx];
            let mut header = frame.header;
            header.set_list(outcome.n_points);
            header.cpu_copies = outcome.cpu_copies;
            header.rendered_mono_nanos = mono_now().0;
            sensor.topics[0].send(frame.loan, header, self.read_everything);
            self.n_lidar_turns += 1;
            remember(waking, &sensor.rig);
        }
        Ok(())
    }
}

impl Shot<'_> {
    /// Turns a lidar's head, read or not, and gets ready for what it sees if somebody reads; the
    /// number of points is not in the header yet.
    fn aim_lidar(
        &self,
        sensor: &mut Sensor,
        read_everything: bool,
    ) -> Option<(FrameLoan, FrameHeader, SensorPath)> {
        let mut header = self.header(sensor, 0);
        let (
            topic,
            Model::Lidar {
                lidar,
                previous,
                ticks,
            },
        ) = (&mut sensor.topics[0], &mut sensor.model)
        else {
            return None;
        };
        lidar.turn_head(
            self.scene.period_nanos,
            (topic.max_payload_bytes / topic.modality.element_bytes()) as u32,
        );
        let start = match lidar.spec().scan {
            LidarScan::Turn => previous.replace(self.world_from_sensor),
            LidarScan::Sweep => ticks[0],
        };
        let loan = topic.loan_if_read(read_everything)?;
        let path = SensorPath {
            world_from_sensor_start: start.unwrap_or(self.world_from_sensor),
            world_from_sensor: self.world_from_sensor,
        };
        lidar.set_extinction(self.scene.lidar_extinction_per_m);
        header.range_limit_m = lidar.spec().range_m as f32;
        header.n_channels = lidar.spec().channels;
        header.azimuth_rad = lidar.head_rad() as f32;
        Some((loan, header, path))
    }

    /// Casts a lidar on the CPU.
    pub(super) fn lidar(
        &self,
        sensor: &mut Sensor,
        rays: &mut TickRays<'_>,
        read_everything: bool,
    ) -> bool {
        let Some((mut loan, mut header, path)) = self.aim_lidar(sensor, read_everything) else {
            return false;
        };
        let Model::Lidar { lidar, .. } = &mut sensor.model else {
            return false;
        };
        header.set_list(lidar.scan(rays.current(), &path, self.noise, None));
        lidar.write(loan.payload_mut());
        self.send(sensor, loan, header, read_everything);
        true
    }
}
