//! Copies on the copy queue: drawing into a texture again waits for the copies that read it, and
//! copies in flight keep what they need when their caller drops it.
//!
//! `Apart` does on one queue what `Beside` does on two, so lifetimes and bookkeeping are tested on
//! every adapter. Where an adapter has two queues, both ways are tested.

#![expect(
    unsafe_code,
    reason = "targets are raw memory; each block carries its proof"
)]

use std::sync::Arc;

use sensor_gpu::{
    CopyBatch, CopyPath, Gpu, GpuOptions, InFlight, LayeredTexture, Reads, ShmTarget,
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

/// Devices that copy while they draw.
fn gpus() -> Vec<Gpu> {
    let open = |copies| {
        Gpu::open(&GpuOptions {
            copies,
            ..Default::default()
        })
        .unwrap_or_else(|error| panic!("{error}"))
    };
    let gpus: Vec<Gpu> = [CopyPath::Apart, CopyPath::Beside]
        .map(open)
        .into_iter()
        .filter(Gpu::copies_beside)
        .collect();
    assert!(!gpus.is_empty(), "`Apart` asks for timelines only");
    gpus
}

/// Page-aligned memory that lives as long as the test process, as a segment does as long as its
/// publisher.
fn segment(n_bytes: usize) -> (*mut u8, usize) {
    const PAGE: usize = 1 << 16;
    let len = n_bytes.next_multiple_of(PAGE);
    let memory: &'static mut [u8] = vec![0u8; len + PAGE].leak();
    let aligned = memory.as_ptr().align_offset(PAGE);
    (memory[aligned..aligned + len].as_mut_ptr(), len)
}

struct Painter {
    gpu: Gpu,
    texture: wgpu::Texture,
    reads: Arc<Reads>,
    n_layers: u32,
}

impl Painter {
    fn new(gpu: &Gpu, size_px: [u32; 2], n_layers: u32) -> Painter {
        let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::RENDER_ATTACHMENT;
        let LayeredTexture { texture, is_shared } =
            gpu.shared_texture_layers("painted", size_px, n_layers, FORMAT, usage);
        assert!(is_shared);
        Painter {
            gpu: gpu.clone(),
            texture,
            reads: Arc::default(),
            n_layers,
        }
    }

    fn frame_bytes(&self) -> usize {
        (4 * self.texture.width() * self.texture.height() * self.n_layers) as usize
    }

    /// Fills the layers with `number`, `number + 1` and so on, and copies them to the target; every
    /// third time with a submission of its own.
    fn paint(
        &self,
        number: u32,
        target: &Arc<ShmTarget>,
        offset_bytes: usize,
    ) -> InFlight<'static> {
        let mut encoder = self.gpu.encoder("paint");
        let mut batch = CopyBatch::new();
        let is_apart = number.is_multiple_of(3);
        if !is_apart {
            batch.overwrites(&self.reads);
        }
        let layer_bytes = self.frame_bytes() / self.n_layers as usize;
        for layer in 0..self.n_layers {
            let view = self.texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer: layer,
                array_layer_count: Some(1),
                ..Default::default()
            });
            let colour = wgpu::Color {
                r: (number + layer) as f64,
                g: 0.0,
                b: 0.0,
                a: 0.0,
            };
            let ops = wgpu::Operations {
                load: wgpu::LoadOp::Clear(colour),
                store: wgpu::StoreOp::Store,
            };
            let attachment = wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops,
            };
            encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(attachment)],
                ..Default::default()
            });
            let offset_bytes = offset_bytes + layer as usize * layer_bytes;
            // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
            let place = unsafe { target.place(offset_bytes, layer_bytes) };
            batch.shared_layer(&self.texture, layer, 4, place, &self.reads);
        }
        if is_apart {
            self.gpu
                .submit_overwriting(vec![encoder.finish()], std::slice::from_ref(&self.reads));
            encoder = self.gpu.encoder("copy");
        }
        batch.submit(&self.gpu, encoder)
    }
}

/// Eight submissions in a row draw into one texture, and each reader gets its own number in every
/// pixel.
#[test]
fn a_texture_is_drawn_into_again_only_when_it_was_copied() {
    const N_IN_FLIGHT: u32 = 8;
    for gpu in gpus() {
        let (size_px, n_frames) = if gpu.is_software() {
            ([300, 200], 40)
        } else {
            ([4096, 4096], 160)
        };
        let painter = Painter::new(&gpu, size_px, 2);
        let (base, len) = segment(painter.frame_bytes() * N_IN_FLIGHT as usize);
        // SAFETY: the segment is leaked, and each range is looked at only when its submission was
        // waited for.
        let target = Arc::new(unsafe { ShmTarget::import(&gpu, base, len, ()) });
        assert_eq!(target.cpu_copies(), 0);
        let offset = |frame: u32| (frame % N_IN_FLIGHT) as usize * painter.frame_bytes();
        let check = |(frame, flight): (u32, InFlight<'static>)| {
            let outcomes = if frame.is_multiple_of(2) {
                flight.wait()
            } else {
                flight.wait_awake()
            }
            .unwrap();
            assert!(
                outcomes
                    .iter()
                    .all(|outcome| (outcome.cpu_copies, outcome.n_bytes)
                        == (0, painter.frame_bytes() / 2))
            );
            // SAFETY: leaked, and the submission that writes to this range is done.
            let bytes = unsafe {
                std::slice::from_raw_parts_mut(base.add(offset(frame)), painter.frame_bytes())
            };
            for (layer, bytes) in (0..).zip(bytes.chunks_exact(painter.frame_bytes() / 2)) {
                let wrong = bytes
                    .chunks_exact(4)
                    .filter(|pixel| **pixel != (frame + layer).to_le_bytes())
                    .count();
                assert_eq!(
                    wrong, 0,
                    "pixels of frame {frame} that another frame painted"
                );
            }
            bytes.fill(0xa5);
        };
        // In bursts, because looking at a frame takes longer than painting it.
        for first in (1..=n_frames).step_by(N_IN_FLIGHT as usize) {
            let burst: Vec<_> = (first..first + N_IN_FLIGHT)
                .map(|frame| (frame, painter.paint(frame, &target, offset(frame))))
                .collect();
            burst.into_iter().for_each(check);
        }
    }
}

/// Textures and targets are dropped while their copies are in flight, waited for or not; nothing
/// leaks.
#[test]
fn what_is_dropped_under_way_is_freed_when_its_copy_is_done() {
    for gpu in gpus() {
        let n_rounds = if gpu.is_software() { 30 } else { 1000 };
        let (base, len) = segment(2 * 3 * 4 * 240 * 69);
        for round in 0..n_rounds {
            let painter =
                Painter::new(&gpu, [64 + 8 * (round % 23), 8 + round % 61], 1 + round % 3);
            let n_bytes = painter.frame_bytes();
            // SAFETY: the segment is leaked, and looked at only when everything was waited for.
            let target = Arc::new(unsafe { ShmTarget::import(&gpu, base, len, ()) });
            let dropped = painter.paint(round, &target, 0);
            let kept = painter.paint(round + 1, &target, n_bytes);
            drop((painter, target));
            drop(dropped);
            kept.wait().unwrap();
            // SAFETY: leaked, and both submissions are done.
            let bytes = unsafe { std::slice::from_raw_parts(base, 2 * n_bytes) };
            assert!(
                bytes[..4] == round.to_le_bytes()
                    && bytes[n_bytes..n_bytes + 4] == (round + 1).to_le_bytes(),
                "round {round}"
            );
        }
        gpu.submit([]);
        gpu.wait_idle();
        assert_eq!(gpu.n_shared_textures(), 0);
    }
}

/// Time on the copy queue has the same label as copies after the drawing.
#[test]
fn copies_are_timed_wherever_they_are_made() {
    for copies in [CopyPath::Behind, CopyPath::Apart, CopyPath::Beside] {
        let gpu = Gpu::open(&GpuOptions {
            copies,
            ..Default::default()
        })
        .unwrap_or_else(|error| panic!("{error}"));
        if !gpu.set_timing(true) {
            continue;
        }
        let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::RENDER_ATTACHMENT;
        let LayeredTexture { texture, is_shared } =
            gpu.shared_texture_layers("timed", [256, 256], 1, FORMAT, usage);
        assert_eq!(is_shared, gpu.copies_beside());
        let (base, len) = segment(1 << 18);
        // SAFETY: the segment is leaked and not looked at.
        let target = Arc::new(unsafe { ShmTarget::import(&gpu, base, len, ()) });
        let mut encoder = gpu.encoder("timed");
        gpu.mark(&mut encoder, "begin");
        let mut batch = CopyBatch::new();
        // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
        let place = unsafe { target.place(0, 1 << 18) };
        batch.shared_layer(&texture, 0, 4, place, &Arc::default());
        batch.submit(&gpu, encoder).wait().unwrap();
        let spans = gpu.take_spans();
        assert!(
            spans
                .iter()
                .any(|span| (span.place, span.label) == ("GPU", "copies") && span.millis > 0.0),
            "{copies:?}: {spans:?}"
        );
    }
}
