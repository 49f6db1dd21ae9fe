//! What reaches the reader: imported and staged targets get the same, tightly packed bytes,
//! whatever the size of a row.

#![expect(
    unsafe_code,
    reason = "targets are raw memory; each block carries its proof"
)]

use std::sync::Arc;

use sensor_gpu::{CopyBatch, Gpu, GpuError, GpuOptions, ImportError, Place, ShmTarget};

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
            Place::Shm {
                target: target.clone(),
                offset_bytes,
                capacity_bytes: bytes.len(),
            },
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
        Place::Shm {
            target: target.clone(),
            offset_bytes,
            capacity_bytes: 128,
        },
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
        let imported = Arc::new(unsafe { ShmTarget::import(&gpu, base, len) });
        assert_eq!((imported.cpu_copies(), imported.staged_reason()), (0, None));
        check(&gpu, imported, base, size_px);
        let (base, len) = segment(n_bytes);
        // SAFETY: as above.
        check(
            &gpu,
            Arc::new(unsafe { ShmTarget::staged(base, len) }),
            base,
            size_px,
        );
    }
}

#[test]
fn import_that_cannot_be_is_staged_and_says_why() {
    let gpu = gpu();
    let (base, len) = segment(8192);
    // SAFETY: the segment is leaked and used by nobody else.
    let odd = unsafe { ShmTarget::import(&gpu, base.add(64), len - 64) };
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
    let staged = unsafe { ShmTarget::import(&refused, base, len) };
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
