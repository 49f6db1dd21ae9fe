//! The list of cameras and batches of a worker: all that it needs to open them.

use anyhow::{Context as _, bail};
use launch_spec::{TopicBudget, TopicLimits};
use schema_frames::Modality;
use schema_types::{ActorId, Tick};
use sensor_spec::SensorSpec;

use super::bytes::{Reader, Writer};
use super::exact;
use crate::batch::BatchPlan;
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
    /// The batches of cameras that are on the list.
    pub batches: Vec<BatchPlan>,
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
                put_limits(limits, &mut to);
            }
            to.put_all(&camera.hidden);
        }
        to.put_len(self.batches.len());
        for batch in &self.batches {
            to.put(batch.number);
            to.put_text(&batch.name);
            to.put_len(batch.cameras.len());
            batch.cameras.iter().for_each(|name| to.put_text(name));
            to.put_len(batch.topics.len());
            for topic in &batch.topics {
                to.put_text(&topic.topic);
                to.put(topic.modality as u16);
                to.put_len(topic.max_payload_bytes);
                put_limits(&topic.limits, &mut to);
            }
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
        batches: Vec::new(),
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
                    limits.push(limits_of(&mut from)?);
                }
                limits
            },
            hidden: from.get_all()?,
        });
    }
    for _ in 0..from.get_len()? {
        list.batches.push(batch_of(&mut from)?);
    }
    from.end()?;
    Ok(list)
}

fn batch_of(from: &mut Reader<'_>) -> anyhow::Result<BatchPlan> {
    let mut batch = BatchPlan {
        number: from.get()?,
        name: from.get_text()?,
        cameras: Vec::new(),
        topics: Vec::new(),
    };
    for _ in 0..from.get_len()? {
        batch.cameras.push(from.get_text()?);
    }
    for _ in 0..from.get_len()? {
        let topic = from.get_text()?;
        let code = from.get()?;
        batch.topics.push(TopicBudget {
            topic,
            modality: Modality::from_code(code)
                .with_context(|| format!("modality {code} is not known"))?,
            max_payload_bytes: from.get_len()?,
            limits: limits_of(from)?,
        });
    }
    Ok(batch)
}

fn put_limits(limits: &TopicLimits, to: &mut Writer) {
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

fn limits_of(from: &mut Reader<'_>) -> anyhow::Result<TopicLimits> {
    let [readers, buffer, borrowed, gpu_readers] = from
        .get::<[u32; 4]>()?
        .map(|limit| (limit != u32::MAX).then_some(limit));
    Ok(TopicLimits {
        readers,
        buffer,
        borrowed,
        gpu: from.get::<u8>()? != 0,
        gpu_readers,
    })
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
        let batch = BatchPlan {
            number: 3,
            name: "fleet".into(),
            cameras: vec!["ego/front".into(), "chaser/front".into()],
            topics: vec![TopicBudget {
                topic: "batch/fleet/flow".into(),
                modality: Modality::Flow,
                max_payload_bytes: 1 << 33,
                limits: TopicLimits {
                    gpu_readers: Some(1),
                    ..TopicLimits::default()
                },
            }],
        };
        let list = CameraList {
            version: 8,
            cameras: vec![camera],
            batches: vec![batch],
        };
        let bytes = list.to_bytes().unwrap();
        assert_eq!(CameraList::from_bytes(&bytes).unwrap(), list);
        for n_bytes in 0..bytes.len() {
            assert!(CameraList::from_bytes(&bytes[..n_bytes]).is_err());
        }
    }
}
