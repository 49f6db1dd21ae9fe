//! On which device samples are wanted, and whether their writer is on it.

use std::sync::Arc;

use schema_bus::{BusError, GpuOffer};

use crate::cuda::{Cuda, Found, devices};
use crate::error::GpuError;

/// Where frames are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// On the GPU of CUDA that the simulator draws on; elsewhere on CUDA's first.
    Cuda,
    /// On the device of CUDA with this number.
    CudaNumber(i32),
    /// In the exported memory of a software adapter, mapped: for tests without a GPU.
    Mapped,
}

/// How frames get there.
#[derive(Debug)]
pub enum Way {
    /// They are on this device already.
    Imported(Arc<Cuda>),
    /// They are mapped.
    Mapped,
    /// They are uploaded to this device, for this reason.
    Uploaded(Arc<Cuda>, String),
}

/// The device on which a process publishes.
///
/// # Errors
/// [`GpuError::NoCuda`], [`GpuError::Cuda`], [`GpuError::Memory`].
pub fn writers_device(topic: &str, device: Device) -> Result<(Arc<Cuda>, Found), GpuError> {
    let asked = match device {
        Device::Cuda => None,
        Device::CudaNumber(number) => Some(number),
        Device::Mapped => {
            return Err(GpuError::memory(
                topic,
                "memory of a software adapter is the simulator's alone; publish on \"cuda\"",
            ));
        }
    };
    let found = devices()?;
    let first = named(topic, &found, asked)?;
    Ok((Cuda::open(first.ordinal)?, first.clone()))
}

/// The device with this number, or the first.
fn named<'a>(topic: &str, found: &'a [Found], asked: Option<i32>) -> Result<&'a Found, GpuError> {
    let first = match asked {
        None => found.first(),
        Some(number) => found.iter().find(|device| device.ordinal == number),
    };
    first.ok_or_else(|| match asked {
        Some(number) => GpuError::memory(
            topic,
            format!(
                "CUDA has no device {number}; it has {} (CUDA_VISIBLE_DEVICES hides others)",
                found.len()
            ),
        ),
        None => GpuError::memory(
            topic,
            "CUDA has no device; CUDA_VISIBLE_DEVICES may hide them",
        ),
    })
}

/// Finds the way to `device` from what the simulator offers, or why it offers nothing.
///
/// # Errors
/// [`GpuError::NoCuda`], [`GpuError::Cuda`], [`GpuError::Memory`].
pub fn find_way(
    topic: &str,
    device: Device,
    offer: &Result<GpuOffer, BusError>,
) -> Result<Way, GpuError> {
    if device == Device::Mapped {
        return match offer {
            Ok(offer) if offer.is_mappable => Ok(Way::Mapped),
            Ok(_) => Err(GpuError::memory(
                topic,
                "it is on a GPU, whose memory cannot be mapped; ask for \"cuda\"",
            )),
            Err(why) => Err(GpuError::memory(topic, why)),
        };
    }
    let found = devices()?;
    let asked = match device {
        Device::CudaNumber(number) => Some(number),
        _ => None,
    };
    let first = named(topic, &found, asked)?;
    let (ordinal, why) = choose(&found, first, asked, offer);
    let cuda = Cuda::open(ordinal)?;
    Ok(match why {
        None => Way::Imported(cuda),
        Some(why) => Way::Uploaded(cuda, why),
    })
}

/// The device to use, `first` or another one, and why frames have to be uploaded to it, if they
/// have.
fn choose(
    found: &[Found],
    first: &Found,
    asked: Option<i32>,
    offer: &Result<GpuOffer, BusError>,
) -> (i32, Option<String>) {
    let offer = match offer {
        Ok(offer) => offer,
        Err(why) => return (first.ordinal, Some(why.to_string())),
    };
    let same = |device: &&Found| device.uuid == offer.device_uuid;
    let is_known = offer.device_uuid != [0; 16];
    let candidates = found
        .iter()
        .filter(|device| asked.is_none_or(|number| device.ordinal == number));
    if let Some(device) = candidates.clone().find(same).filter(|_| is_known) {
        return (device.ordinal, None);
    }
    (first.ordinal, Some(why_not_same(found, first, offer)))
}

fn why_not_same(found: &[Found], used: &Found, offer: &GpuOffer) -> String {
    let theirs = hex(&offer.device_uuid);
    if offer.is_mappable {
        return format!(
            "the simulator draws on a software adapter, and CUDA computes on {}",
            used.name
        );
    }
    if offer.device_uuid == [0; 16] {
        return "the writer's driver says no UUID of its GPU, as in containers that hide it, so it cannot be seen whether that is the same".into();
    }
    if used.name.contains("MIG") {
        return format!(
            "CUDA computes on {}, a slice of a GPU, which Vulkan cannot draw on (the simulator draws on {theirs})",
            used.name
        );
    }
    let known: Vec<String> = found
        .iter()
        .map(|device| format!("{} {}", device.name, hex(&device.uuid)))
        .collect();
    format!(
        "its writer is on GPU {theirs}, and CUDA has {}; let CUDA see that GPU (CUDA_VISIBLE_DEVICES), or start the simulator with `simd --adapter` and the UUID of one of these",
        known.join(", ")
    )
}

fn hex(uuid: &[u8; 16]) -> String {
    uuid.map(|byte| format!("{byte:02x}")).concat()
}
