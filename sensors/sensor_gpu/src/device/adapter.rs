//! Finding the adapter to open: by its number, its UUID or its name.

use ash::vk;
use wgpu::hal::api::Vulkan;

use super::open::has_import;
use crate::error::GpuError;

/// Shortest beginning of a UUID that is taken for one, hexadecimal digits.
const LEAST_UUID_DIGITS: usize = 8;

/// A GPU that could be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// Number in the driver's order, from 0.
    pub index: usize,
    /// The device's UUID in five groups, the same from boot to boot; `nvidia-smi -L` shows it with
    /// `GPU-` in front. Zeros if the driver has none.
    pub uuid: String,
    /// Name, e.g. `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// Whether the CPU does the work.
    pub is_software: bool,
    /// Whether the driver has the import extension, without which every frame costs a CPU copy.
    pub can_import: bool,
    /// What to open if nothing is asked for: the smallest.
    rank: u8,
}

impl AdapterInfo {
    pub(super) fn of(index: usize, adapter: &wgpu::Adapter) -> AdapterInfo {
        let info = adapter.get_info();
        AdapterInfo {
            index,
            uuid: uuid_of(adapter),
            is_software: info.device_type == wgpu::DeviceType::Cpu,
            can_import: has_import(adapter),
            driver: format!("{} {}", info.driver, info.driver_info)
                .trim()
                .to_owned(),
            rank: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => 0,
                wgpu::DeviceType::IntegratedGpu => 1,
                wgpu::DeviceType::VirtualGpu => 2,
                wgpu::DeviceType::Other => 3,
                wgpu::DeviceType::Cpu => 4,
            },
            name: info.name,
        }
    }
}

/// The device's UUID in five groups.
fn uuid_of(adapter: &wgpu::Adapter) -> String {
    let digits = ids_of(adapter)
        .device
        .map(|byte| format!("{byte:02x}"))
        .concat();
    [0..8, 8..12, 12..16, 16..20, 20..32]
        .map(|part| &digits[part])
        .join("-")
}

/// What tells a GPU and its driver from others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceIds {
    /// The device's UUID as the driver says it; zeros if it has none.
    pub device: [u8; 16],
    /// The driver's UUID.
    pub driver: [u8; 16],
}

/// The UUIDs as the driver says them.
pub(super) fn ids_of(adapter: &wgpu::Adapter) -> DeviceIds {
    let mut ids = vk::PhysicalDeviceIDProperties::default();
    // SAFETY: the hal adapter is only read, and lives as long as this guard.
    if let Some(hal) = unsafe { adapter.as_hal::<Vulkan>() } {
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut ids);
        // SAFETY: instance and physical device belong together and live; wgpu requires Vulkan 1.1
        // where this call and the chained struct are core.
        unsafe {
            hal.shared_instance()
                .raw_instance()
                .get_physical_device_properties2(hal.raw_physical_device(), &mut properties);
        }
    }
    DeviceIds {
        device: ids.device_uuid,
        driver: ids.driver_uuid,
    }
}

pub fn enumerate() -> Vec<wgpu::Adapter> {
    let descriptor = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        // Validating indirect draw calls costs a pass on the GPU, and only trusted code writes
        // them.
        flags: wgpu::InstanceFlags::default() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(wgpu::Backends::VULKAN))
}

/// The adapter that is asked for, or the best one.
///
/// # Errors
/// No adapter, or none that is called so.
pub fn choose(
    adapters: Vec<wgpu::Adapter>,
    asked: Option<&str>,
) -> Result<wgpu::Adapter, GpuError> {
    let infos: Vec<AdapterInfo> = adapters
        .iter()
        .enumerate()
        .map(|(index, adapter)| AdapterInfo::of(index, adapter))
        .collect();
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let found = find(&infos, asked).and_then(|index| adapters.into_iter().nth(index));
    found.ok_or_else(|| GpuError::UnknownAdapter {
        asked: asked.unwrap_or_default().to_owned(),
        found: infos
            .into_iter()
            .map(|info| format!("{}: {} ({})", info.index, info.name, info.uuid))
            .collect(),
    })
}

/// Number of the adapter that is asked for: one of that number; else the one whose UUID begins so,
/// with or without `GPU-`; else the best one whose name contains the text. `None` if there is none,
/// or if two have the beginning of a UUID. One or two digits are a number and no part of a name: the
/// third of two "NVIDIA H200" is none of them.
fn find(infos: &[AdapterInfo], asked: Option<&str>) -> Option<usize> {
    let best = |infos: &mut dyn Iterator<Item = &AdapterInfo>| {
        infos
            .min_by_key(|info| (info.rank, info.index))
            .map(|info| info.index)
    };
    let Some(asked) = asked else {
        return best(&mut infos.iter());
    };
    let asked = asked.trim().to_lowercase();
    if let Some(info) = asked.parse().ok().and_then(|index: usize| infos.get(index)) {
        return Some(info.index);
    }
    if matches!(asked.len(), 1..=2) && asked.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let digits = |text: &str| text.replace('-', "");
    let uuid = digits(asked.strip_prefix("gpu-").unwrap_or(&asked));
    if uuid.len() >= LEAST_UUID_DIGITS && uuid.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        let mut of_uuid = infos
            .iter()
            .filter(|info| digits(&info.uuid).starts_with(&uuid));
        match (of_uuid.next(), of_uuid.next()) {
            (Some(only), None) => return Some(only.index),
            (Some(_), Some(_)) => return None,
            (None, _) => {}
        }
    }
    let is_named = |info: &&AdapterInfo| info.name.to_lowercase().contains(&asked);
    best(&mut infos.iter().filter(is_named))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine() -> Vec<AdapterInfo> {
        let adapter = |(index, (name, rank, uuid)): (usize, (&str, u8, &str))| AdapterInfo {
            index,
            uuid: uuid.to_owned(),
            name: name.to_owned(),
            driver: String::new(),
            is_software: rank == 4,
            can_import: true,
            rank,
        };
        let uuid = "-1111-2222-3333-444455556666";
        [
            (
                "llvmpipe (LLVM 15, 256 bits)",
                4,
                "6d657361-3231-0000-0000-000000000000".to_owned(),
            ),
            ("NVIDIA GeForce RTX 4090", 0, format!("8a3f1c02{uuid}")),
            ("NVIDIA GeForce RTX 4090", 0, format!("8a3f1c77{uuid}")),
        ]
        .iter()
        .map(|(name, rank, uuid)| (*name, *rank, uuid.as_str()))
        .enumerate()
        .map(adapter)
        .collect()
    }

    #[test]
    fn each_of_two_equal_gpus_has_a_number_and_a_uuid() {
        let machine = machine();
        let found = |asked| find(&machine, Some(asked));
        assert_eq!(
            (found("0"), found("1"), found("2")),
            (Some(0), Some(1), Some(2))
        );
        for (asked, wanted) in [
            ("8a3f1c77-1111-2222-3333-444455556666", Some(2)),
            ("GPU-8a3f1c77-1111-2222-3333-444455556666", Some(2)),
            ("8A3F1C02", Some(1)),
            ("8a3f1c021111", Some(1)),
            ("8a3f1c03", None),
            // A name, too, may consist of digits.
            ("4090", Some(1)),
            ("llvmpipe", Some(0)),
            ("nvidia", Some(1)),
            ("3", None),
            ("9", None),
            ("40", None),
            ("voodoo", None),
            ("", Some(1)),
        ] {
            assert_eq!(found(asked), wanted, "{asked}");
        }
        assert_eq!(find(&machine, None), Some(1));
        assert_eq!(find(&machine[..1], None), Some(0));
    }

    #[test]
    fn the_beginning_of_two_uuids_is_no_choice() {
        let mut machine = machine();
        machine[2].uuid = machine[1].uuid.clone();
        assert_eq!(find(&machine, Some("8a3f1c02")), None);
        assert_eq!(find(&machine, Some("2")), Some(2));
    }
}
