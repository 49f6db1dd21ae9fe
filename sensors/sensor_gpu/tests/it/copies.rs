//! What reaches the reader: imported and staged targets get the same, tightly packed bytes,
//! whatever the size of a row.

#![expect(
    unsafe_code,
    reason = "targets are raw memory; each block carries its proof"
)]

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use sensor_gpu::{CopyBatch, Gpu, GpuError, GpuOptions, ImportError, InFlight, Place, ShmTarget};

fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Page-aligned memory that lives as long as the test process, as a segment does as long as its
/// publisher.
fn segment(n_bytes: usize) -> (*mut u8, usize) {
    let len = n_bytes.next_multiple_of(4096);
    let memory: &'static mut [u8] = vec![0u8; len + 4096].leak();
    let aligned = memory.as_ptr().align_offset(4096);
    (memory[aligned..aligned + len].as_mut_ptr(), len)
}

/// A texture whose texels count upwards.
fn counted(
    gpu: &Gpu,
    size_px: [u32; 2],
    format: wgpu::TextureFormat,
    element_bytes: usize,
) -> (wgpu::Texture, Vec<u8>) {
    let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST;
    let texture = gpu.texture("counted", size_px, 1, format, usage);
    let bytes: Vec<u8> = (0..size_px[0] as usize * size_px[1] as usize * element_bytes)
        .map(|i| (i * 7 + i / 251) as u8)
        .collect();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(size_px[0] * element_bytes as u32),
        rows_per_image: None,
    };
    gpu.queue()
        .write_texture(texture.as_image_copy(), &bytes, layout, texture.size());
    (texture, bytes)
}

/// Copies each texture to its own offset of a segment and checks every byte, also those around.
fn check(gpu: &Gpu, target: Arc<ShmTarget>, base: *const u8, size_px: [u32; 2]) {
    let formats = [
        (wgpu::TextureFormat::R8Uint, 1),
        (wgpu::TextureFormat::R32Float, 4),
        (wgpu::TextureFormat::Bgra8Unorm, 4),
        (wgpu::TextureFormat::Rg32Float, 8),
    ];
    let mut batch = CopyBatch::new();
    let mut expected = Vec::new();
    let mut offset_bytes = 384;
    for (format, element_bytes) in formats {
        let (texture, bytes) = counted(gpu, size_px, format, element_bytes);
        batch.texture(
            &texture,
            element_bytes,
            // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
            unsafe { target.place(offset_bytes, bytes.len()) },
        );
        let next = (offset_bytes + bytes.len() + 64).next_multiple_of(64);
        expected.push((offset_bytes, bytes));
        offset_bytes = next;
    }
    let buffer = gpu.buffer_with("list", &[9; 400], wgpu::BufferUsages::COPY_SRC);
    batch.buffer(
        &buffer,
        16,
        100,
        // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
        unsafe { target.place(offset_bytes, 128) },
    );
    expected.push((offset_bytes, vec![9; 100]));
    let outcomes = batch.submit(gpu, gpu.encoder("test")).wait().unwrap();
    assert!(
        outcomes
            .iter()
            .all(|outcome| outcome.cpu_copies == target.cpu_copies())
    );
    // SAFETY: the memory is leaked, and nothing is in flight any more.
    let memory = unsafe { std::slice::from_raw_parts(base, target.n_bytes()) };
    let mut untouched = 0;
    for (begin, bytes) in &expected {
        assert!(
            memory[untouched..*begin].iter().all(|byte| *byte == 0),
            "wrote before {begin}"
        );
        assert!(
            memory[*begin..begin + bytes.len()] == bytes[..],
            "{size_px:?} at {begin}"
        );
        untouched = begin + bytes.len();
    }
    assert!(
        memory[untouched..].iter().all(|byte| *byte == 0),
        "wrote behind the last copy"
    );
}

#[test]
fn imported_and_staged_targets_get_the_same_bytes() {
    let gpu = gpu();
    assert!(
        gpu.can_import(),
        "{} lacks VK_EXT_external_memory_host",
        gpu.name()
    );
    for size_px in [[801, 599], [64, 64], [33, 7], [255, 16], [800, 600]] {
        let n_bytes = size_px[0] as usize * size_px[1] as usize * 17 + 4096;
        let (base, len) = segment(n_bytes);
        // SAFETY: the segment is leaked and used by nobody else until the copies were waited for.
        let imported = Arc::new(unsafe { ShmTarget::import(&gpu, base, len, ()) });
        assert_eq!((imported.cpu_copies(), imported.staged_reason()), (0, None));
        check(&gpu, imported, base, size_px);
        let (base, len) = segment(n_bytes);
        // SAFETY: as above.
        let staged = Arc::new(unsafe { ShmTarget::staged(base, len, ()) });
        check(&gpu, staged, base, size_px);
    }
}

#[test]
fn import_that_cannot_be_is_staged_and_says_why() {
    let gpu = gpu();
    let (base, len) = segment(8192);
    // SAFETY: the segment is leaked and used by nobody else.
    let odd = unsafe { ShmTarget::import(&gpu, base.add(64), len - 64, ()) };
    assert_eq!(odd.cpu_copies(), 1);
    assert!(
        matches!(odd.staged_reason(), Some(ImportError::Misaligned { .. })),
        "{:?}",
        odd.staged_reason()
    );
    let refused = Gpu::open(&GpuOptions {
        allow_import: false,
        ..Default::default()
    })
    .unwrap();
    assert!(!refused.can_import());
    // SAFETY: as above.
    let staged = unsafe { ShmTarget::import(&refused, base, len, ()) };
    assert_eq!(staged.staged_reason(), Some(&ImportError::Unsupported));
}

#[test]
fn unknown_adapter_is_refused_with_the_names_of_all() {
    let error = Gpu::open(&GpuOptions {
        adapter: Some("voodoo".into()),
        ..Default::default()
    })
    .unwrap_err();
    let GpuError::UnknownAdapter { found, .. } = &error else {
        panic!("{error}")
    };
    assert!(
        !found.is_empty() && error.to_string().contains(&found[0]),
        "{error}"
    );
}

#[test]
fn ordinary_memory_and_mapped_rows_carry_the_same_bytes() {
    let gpu = gpu();
    let (texture, expected) = counted(&gpu, [37, 11], wgpu::TextureFormat::R32Uint, 4);
    let mut memory = vec![0; expected.len()];
    let before = gpu.counters().counts();
    let mut batch = CopyBatch::new();
    batch.texture(&texture, 4, Place::Memory(&mut memory));
    let mapped = batch.map_texture(&texture, 0, 4);
    let mut outcomes = batch.submit(&gpu, gpu.encoder("test")).wait().unwrap();
    assert_eq!(
        (outcomes[0].n_bytes, outcomes[0].cpu_copies),
        (expected.len(), 1)
    );
    let rows = outcomes[mapped].mapped.take().unwrap();
    assert!((0..11).all(|y| rows.row(y) == &expected[y * 37 * 4..(y + 1) * 37 * 4]));
    assert_eq!(memory, expected);
    let counts = gpu.counters().counts().since(before);
    assert_eq!((counts.copies, counts.submissions), (2, 1));
}

/// Looks at memory when it is dropped: whether the device has written `expected` there by then.
struct Looks {
    address: usize,
    expected: u8,
    seen: Arc<AtomicU8>,
}

impl Drop for Looks {
    fn drop(&mut self) {
        // SAFETY: the memory is leaked, and whoever drops this promises that the device is done.
        let bytes = unsafe { std::slice::from_raw_parts(self.address as *const u8, 4096) };
        let is_written = bytes.iter().all(|byte| *byte == self.expected);
        let seen = if is_written { WRITTEN } else { DROPPED };
        self.seen.store(seen, Ordering::SeqCst);
    }
}

const HELD: u8 = 0;
const DROPPED: u8 = 1;
const WRITTEN: u8 = 2;

/// A target over leaked memory with a keeper that looks at it, and where the keeper notes its end.
fn kept_target(gpu: &Gpu) -> (Arc<ShmTarget>, Arc<AtomicU8>) {
    let (base, len) = segment(1 << 16);
    let seen = Arc::new(AtomicU8::new(HELD));
    let keeper = Looks {
        address: base as usize,
        expected: 9,
        seen: seen.clone(),
    };
    // SAFETY: the memory is leaked.
    (
        Arc::new(unsafe { ShmTarget::import(gpu, base, len, keeper) }),
        seen,
    )
}

/// Writes nines to the first page of a target.
fn write_nines(gpu: &Gpu, target: &Arc<ShmTarget>) -> InFlight<'static> {
    let buffer = gpu.buffer_with("nines", &[9; 4096], wgpu::BufferUsages::COPY_SRC);
    let mut batch = CopyBatch::new();
    // SAFETY: the only place in the target, which is looked at after the submission.
    batch.buffer(&buffer, 0, 4096, unsafe { target.place(0, 4096) });
    batch.submit(gpu, gpu.encoder("nines"))
}

#[test]
fn memory_is_kept_until_the_device_is_done_whatever_is_dropped_first() {
    let gpu = gpu();
    let (target, seen) = kept_target(&gpu);
    let flight = write_nines(&gpu, &target);
    drop(target);
    assert_eq!(seen.load(Ordering::SeqCst), HELD, "the submission keeps it");
    drop(flight);
    assert_eq!(seen.load(Ordering::SeqCst), WRITTEN);
    // The same while a panic unwinds, in the worse order.
    let (target, seen) = kept_target(&gpu);
    let unwound = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let _flight = write_nines(&gpu, &target);
        drop(target);
        panic!("while a submission is in flight");
    }));
    assert!(unwound.is_err());
    assert_eq!(seen.load(Ordering::SeqCst), WRITTEN);
}

#[test]
fn a_clone_of_a_targets_buffer_does_not_reach_memory_that_was_given_back() {
    let gpu = gpu();
    let (target, seen) = kept_target(&gpu);
    write_nines(&gpu, &target).wait().unwrap();
    let clone = target.storage().expect("64 KiB can be bound").clone();
    drop(target);
    assert_eq!(
        seen.load(Ordering::SeqCst),
        WRITTEN,
        "the clone keeps nothing"
    );
    let refused = gpu.try_to("a copy", || {
        let other = gpu.buffer("other", 4096, wgpu::BufferUsages::COPY_DST);
        let mut encoder = gpu.encoder("too late");
        encoder.copy_buffer_to_buffer(&clone, 0, &other, 0, 4096);
        gpu.submit([encoder.finish()]);
    });
    assert!(matches!(refused, Err(GpuError::Lost { .. })), "{refused:?}");
    // The device goes on.
    let (target, _) = kept_target(&gpu);
    write_nines(&gpu, &target).wait().unwrap();
}

#[test]
fn memory_that_the_device_lacks_is_an_error_and_the_device_goes_on() {
    let gpu = gpu();
    let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::TEXTURE_BINDING;
    let side_px = gpu.device().limits().max_texture_dimension_2d.min(16_384);
    let format = wgpu::TextureFormat::Rgba32Float;
    let mut held = Vec::new();
    let refused = (0..256).find_map(|_| {
        let made = gpu.try_to("a huge texture", || {
            gpu.texture("huge", [side_px; 2], 1, format, usage)
        });
        made.map(|texture| held.push(texture)).err()
    });
    let error = refused.expect("no device has a terabyte");
    assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
    assert!(error.to_string().contains("a huge texture"), "{error}");
    drop(held);
    gpu.wait_idle();
    let (target, _) = kept_target(&gpu);
    write_nines(&gpu, &target).wait().unwrap();
    gpu.check().unwrap();
}

#[test]
fn a_lost_device_is_an_error_of_every_wait() {
    let gpu = gpu();
    let (target, seen) = kept_target(&gpu);
    let flight = write_nines(&gpu, &target);
    gpu.lose();
    let of = |result: Result<_, GpuError>| match result {
        Err(GpuError::Lost { reason, .. }) => reason,
        other => panic!("{other:?}"),
    };
    of(flight.wait().map(drop));
    of(write_nines(&gpu, &target).wait().map(drop));
    of(gpu
        .try_to("a buffer", || {
            gpu.buffer("b", 4, wgpu::BufferUsages::COPY_DST)
        })
        .map(drop));
    of(gpu.check());
    drop((target, gpu));
    assert_ne!(seen.load(Ordering::SeqCst), HELD);
}
