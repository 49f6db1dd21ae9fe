//! The list of cameras of a worker: all that it needs to open them.

use anyhow::{Context as _, bail};
use launch_spec::TopicLimits;
use schema_types::{ActorId, Tick};
use sensor_spec::SensorSpec;

use super::bytes::{Reader, Writer};
use super::exact;
use crate::sensor::{Role, Sensor};
use crate::topic::MemoryLife;

/// A camera that a worker renders.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Its actor.
    pub actor: ActorId,
    /// Its rig.
    pub rig: String,
    /// Name on the rig; empty for the spectator.
    pub name: String,
    /// What it is to the run.
    pub role: Role,
    /// What was asked for.
    pub spec: SensorSpec,
    /// Number of its stream of noise.
    pub stream: u64,
    /// The last tick before it was made.
    pub made_at: Tick,
    /// How often it began anew.
    pub n_beginnings: u32,
    /// How long its topics have memory.
    pub life: MemoryLife,
    /// Limits of its topics, in their order.
    pub limits: Vec<TopicLimits>,
    /// Actors that its images leave out.
    pub hidden: Vec<u32>,
}

impl Camera {
    /// A sensor as its worker needs it.
    pub fn of(sensor: &Sensor) -> Camera {
        let plans: Vec<_> = sensor.topics.iter().map(|topic| topic.plan()).collect();
        Camera {
            actor: sensor.actor,
            rig: sensor.rig.name.clone(),
            name: sensor.name.clone(),
            role: sensor.role,
            spec: sensor.spec.clone(),
            stream: sensor.stream.number(),
            made_at: sensor.made_at,
            n_beginnings: sensor.n_beginnings,
            life: plans
                .first()
                .map_or(MemoryLife::OnDemand, |(_, life)| *life),
            limits: plans.into_iter().map(|(limits, _)| limits).collect(),
            hidden: sensor.hidden.iter().map(|actor| actor.0).collect(),
        }
    }
}

/// A version of the list of a worker.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraList {
    /// Its number.
    pub version: u64,
    /// The cameras.
    pub cameras: Vec<Camera>,
}

impl CameraList {
    /// The list in bytes.
    ///
    /// # Errors
    /// If a specification cannot be written.
    pub fn to_bytes(&self) -> anyhow::Result<Vec<u8>> {
        let mut to = Writer::default();
        to.put(self.version);
        to.put_len(self.cameras.len());
        for camera in &self.cameras {
            to.put(camera.actor.0);
            to.put_text(&camera.rig);
            to.put_text(&camera.name);
            to.put(match camera.role {
                Role::Sensor => 0u8,
                Role::Spectator => 1,
            });
            let spec = serde_json::to_value(&camera.spec);
            exact::put(
                &spec.context("a camera's specification cannot be written")?,
                &mut to,
            );
            to.put(camera.stream);
            to.put(camera.made_at.0);
            to.put(camera.n_beginnings);
            to.put(match camera.life {
                MemoryLife::Lasting => 0u8,
                MemoryLife::OnDemand => 1,
                MemoryLife::WhileRoom => 2,
            });
            to.put_len(camera.limits.len());
            for limits in &camera.limits {
                let TopicLimits {
                    readers,
                    buffer,
                    borrowed,
                    gpu,
                    gpu_readers,
                } = *limits;
                for limit in [readers, buffer, borrowed, gpu_readers] {
                    to.put(limit.unwrap_or(u32::MAX));
                }
                to.put(u8::from(gpu));
            }
            to.put_all(&camera.hidden);
        }
        Ok(to.0)
    }

    /// The list from its bytes.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn from_bytes(bytes: &[u8]) -> anyhow::Result<CameraList> {
        read(bytes).context("the list of cameras cannot be read")
    }
}

fn read(bytes: &[u8]) -> anyhow::Result<CameraList> {
    let mut from = Reader(bytes);
    let mut list = CameraList {
        version: from.get()?,
        cameras: Vec::new(),
    };
    for _ in 0..from.get_len()? {
        list.cameras.push(Camera {
            actor: ActorId(from.get()?),
            rig: from.get_text()?,
            name: from.get_text()?,
            role: match from.get::<u8>()? {
                0 => Role::Sensor,
                1 => Role::Spectator,
                other => bail!("role {other} is not known"),
            },
            spec: serde_json::from_value(exact::get(&mut from)?)?,
            stream: from.get()?,
            made_at: Tick(from.get()?),
            n_beginnings: from.get()?,
            life: match from.get::<u8>()? {
                0 => MemoryLife::Lasting,
                1 => MemoryLife::OnDemand,
                2 => MemoryLife::WhileRoom,
                other => bail!("life {other} is not known"),
            },
            limits: {
                let mut limits = Vec::new();
                for _ in 0..from.get_len()? {
                    let [readers, buffer, borrowed, gpu_readers] = from
                        .get::<[u32; 4]>()?
                        .map(|limit| (limit != u32::MAX).then_some(limit));
                    limits.push(TopicLimits {
                        readers,
                        buffer,
                        borrowed,
                        gpu: from.get::<u8>()? != 0,
                        gpu_readers,
                    });
                }
                limits
            },
            hidden: from.get_all()?,
        });
    }
    from.end()?;
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_arrives_as_it_was() {
        let Some(SensorSpec::Camera(mut spec)) = SensorSpec::default_of("camera") else {
            panic!("there are cameras");
        };
        spec.fov_deg = f64::from_bits(90.0f64.to_bits() + 1);
        let camera = Camera {
            actor: ActorId(31),
            rig: "ego".into(),
            name: "front".into(),
            role: Role::Sensor,
            spec: SensorSpec::Camera(spec),
            stream: u64::MAX,
            made_at: Tick(4),
            n_beginnings: 2,
            life: MemoryLife::OnDemand,
            limits: vec![TopicLimits {
                readers: Some(3),
                gpu: true,
                ..TopicLimits::default()
            }],
            hidden: vec![7],
        };
        let list = CameraList {
            version: 8,
            cameras: vec![camera],
        };
        let bytes = list.to_bytes().unwrap();
        assert_eq!(CameraList::from_bytes(&bytes).unwrap(), list);
        for n_bytes in 0..bytes.len() {
            assert!(CameraList::from_bytes(&bytes[..n_bytes]).is_err());
        }
    }
}
