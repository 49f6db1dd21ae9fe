//! Bind groups that are made again only when they bind something else: making one costs the
//! processor microseconds, and a tick has a dozen, most of them those of the tick before.

use std::num::NonZeroU64;

use parking_lot::Mutex;
use sensor_gpu::Gpu;

/// Bind groups, the newest last. They keep what they bind.
#[derive(Debug)]
pub(crate) struct KeptGroups {
    known: Mutex<Vec<Known>>,
    most: usize,
}

#[derive(Debug)]
struct Known {
    label: &'static str,
    bound: Vec<Bound>,
    group: wgpu::BindGroup,
}

/// What an entry binds.
#[derive(Debug)]
enum Bound {
    Buffer(wgpu::Buffer, u64, Option<NonZeroU64>),
    View(wgpu::TextureView),
    Sampler(wgpu::Sampler),
}

impl Bound {
    /// `None` for arrays, which no group here has.
    fn of(entry: &wgpu::BindGroupEntry<'_>) -> Option<Bound> {
        Some(match &entry.resource {
            wgpu::BindingResource::Buffer(it) => {
                Bound::Buffer(it.buffer.clone(), it.offset, it.size)
            }
            wgpu::BindingResource::TextureView(view) => Bound::View((*view).clone()),
            wgpu::BindingResource::Sampler(sampler) => Bound::Sampler((*sampler).clone()),
            _ => return None,
        })
    }

    fn is_of(&self, entry: &wgpu::BindGroupEntry<'_>) -> bool {
        match (self, &entry.resource) {
            (Bound::Buffer(buffer, offset, size), wgpu::BindingResource::Buffer(it)) => {
                (buffer, *offset, *size) == (it.buffer, it.offset, it.size)
            }
            (Bound::View(known), wgpu::BindingResource::TextureView(view)) => known == *view,
            (Bound::Sampler(known), wgpu::BindingResource::Sampler(sampler)) => known == *sampler,
            _ => false,
        }
    }
}

/// Bind groups of the targets that views share: three passes, and the last of them by the first view.
const MOST_OF_TARGETS: usize = 16;

impl Default for KeptGroups {
    fn default() -> Self {
        KeptGroups::up_to(MOST_OF_TARGETS)
    }
}

impl KeptGroups {
    /// No more than `most` at a time: what the others bound can go.
    pub fn up_to(most: usize) -> KeptGroups {
        KeptGroups {
            known: Mutex::default(),
            most,
        }
    }

    /// A bind group of these entries, which have rising bindings. A label goes with one layout.
    pub fn bind(
        &self,
        gpu: &Gpu,
        label: &'static str,
        layout: &wgpu::BindGroupLayout,
        entries: &[wgpu::BindGroupEntry<'_>],
    ) -> wgpu::BindGroup {
        let mut known = self.known.lock();
        let is_same = |known: &&Known| {
            known.label == label
                && known.bound.len() == entries.len()
                && known
                    .bound
                    .iter()
                    .zip(entries)
                    .all(|(bound, entry)| bound.is_of(entry))
        };
        if let Some(known) = known.iter().find(is_same) {
            return known.group.clone();
        }
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout,
            entries,
        });
        if let Some(bound) = entries.iter().map(Bound::of).collect() {
            if known.len() >= self.most {
                known.remove(0);
            }
            known.push(Known {
                label,
                bound,
                group: group.clone(),
            });
        }
        group
    }

    /// The same of whole buffers, from binding 0 on.
    pub fn bind_whole(
        &self,
        gpu: &Gpu,
        label: &'static str,
        layout: &wgpu::BindGroupLayout,
        buffers: &[&wgpu::Buffer],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        self.bind(gpu, label, layout, &entries)
    }

    /// Forgets all, so that what they bound can go.
    pub fn clear(&self) {
        self.known.lock().clear();
    }
}

#[cfg(test)]
mod tests {
    use sensor_gpu::GpuOptions;

    use super::*;
    use crate::binding_layout::storage;

    /// A group is the same one as long as it binds the same, the oldest goes where there are too
    /// many, and what a forgotten one bound is not kept.
    #[test]
    fn groups_are_made_again_only_for_something_else() {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let descriptor = wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[storage(0)],
        };
        let layout = gpu.device().create_bind_group_layout(&descriptor);
        let buffers = [(); 3].map(|()| gpu.buffer("list", 64, wgpu::BufferUsages::STORAGE));
        let kept = KeptGroups::up_to(2);
        let bind = |i: usize| kept.bind_whole(&gpu, "list", &layout, &[&buffers[i]]);
        let [first, second] = [bind(0), bind(1)];
        assert!(first == bind(0) && second == bind(1) && first != second);
        let third = bind(2);
        assert!(third == bind(2) && second == bind(1), "two are kept");
        assert!(first != bind(0), "the oldest went");
        kept.clear();
        assert!(third != bind(2));
    }
}
