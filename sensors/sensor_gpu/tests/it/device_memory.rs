//! Memory of the device that other processes import: what is copied and uploaded there is what the
//! descriptor shows, to another device that imports it; that of a software adapter is also a file.

#![expect(
    unsafe_code,
    reason = "places are raw memory; each block carries its proof"
)]

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

use crate::other_device::bytes_by_descriptor;
use sensor_gpu::{CopyBatch, CopyPath, Gpu, GpuOptions, Place, ShmTarget};

/// Where Mesa's software adapter begins exported memory in its file: behind a header of its own.
const MESA_BEGIN: u64 = 4096;

fn gpu(copies: CopyPath) -> Gpu {
    let options = GpuOptions {
        copies,
        ..Default::default()
    };
    Gpu::open(&options).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn what_is_copied_and_uploaded_is_what_the_descriptor_shows() {
    for copies in [CopyPath::Behind, CopyPath::Apart, CopyPath::Beside] {
        let gpu = gpu(copies);
        assert!(gpu.can_export(), "the drivers of CI and of the lab export");
        let exported = ShmTarget::export(&gpu, 100_000).unwrap();
        assert!(exported.memory_bytes >= 131_072 && exported.target.n_bytes() == 131_072);
        let target = Arc::new(exported.target);
        let size_px = [13, 7];
        let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST;
        let texture = gpu.texture("seven", size_px, 1, wgpu::TextureFormat::R32Uint, usage);
        let texels: Vec<u32> = (0..13 * 7)
            .map(|i: u32| i.wrapping_mul(2_654_435_761))
            .collect();
        let extent = texture.size();
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(13 * 4),
            rows_per_image: None,
        };
        let bytes: &[u8] = bytemuck::cast_slice(&texels);
        gpu.queue()
            .write_texture(texture.as_image_copy(), bytes, layout, extent);
        // SAFETY: three places that do not overlap, and nobody else has the memory.
        let [image, list, host_made] =
            [4096, 8192, 65_536].map(|offset| unsafe { target.place(offset, 4096) });
        let buffer = gpu.buffer_with("list", &[7; 64], wgpu::BufferUsages::COPY_SRC);
        let mut batch = CopyBatch::new();
        batch.texture(&texture, 4, image);
        batch.buffer(&buffer, 16, 32, list);
        let outcomes = batch.submit(&gpu, gpu.encoder("copies")).wait().unwrap();
        assert!(outcomes.iter().all(|outcome| outcome.cpu_copies == 0));
        gpu.upload(&[(host_made, &[9; 24])]).unwrap();
        let descriptor = || exported.descriptor.try_clone().unwrap();
        let n_bytes = target.n_bytes();
        let shown = bytes_by_descriptor(descriptor(), exported.memory_bytes, n_bytes as u64);
        assert_eq!(&shown[4096..][..bytes.len()], bytes, "{copies:?}");
        assert_eq!(shown[8192..8224], [7; 32]);
        assert_eq!(shown[65_536..65_560], [9; 24]);
        assert_eq!(shown[65_560..65_564], [0; 4], "cleared");
        assert_eq!(shown[..4096], [0; 4096], "nothing else was written");
        // What is left of it keeps its bytes when the writer lets go.
        drop(target);
        gpu.wait_idle();
        let kept = bytes_by_descriptor(descriptor(), exported.memory_bytes, n_bytes as u64);
        assert!(kept == shown, "{copies:?}");
        if gpu.is_software() {
            let mut in_file = vec![0xff; n_bytes];
            let file = File::from(descriptor());
            file.read_exact_at(&mut in_file, MESA_BEGIN).unwrap();
            assert!(in_file == shown, "{copies:?}");
        }
    }
}

#[test]
fn memory_that_cannot_be_made_is_refused_with_a_sentence() {
    let gpu = gpu(CopyPath::Behind);
    let error = ShmTarget::export(&gpu, u64::MAX / 2).unwrap_err();
    assert!(error.to_string().contains("largest buffer"), "{error}");
}

#[test]
#[should_panic(expected = "cannot be reached by the processor")]
fn the_processor_does_not_reach_memory_of_the_device() {
    let gpu = gpu(CopyPath::Behind);
    let target = Arc::new(ShmTarget::export(&gpu, 4096).unwrap().target);
    // SAFETY: nobody else has the memory.
    let mut place: Place<'_> = unsafe { target.place(0, 4096) };
    place.bytes_mut();
}

#[test]
fn many_exports_leave_no_descriptor_open() {
    let gpu = gpu(CopyPath::Behind);
    let n_open = || std::fs::read_dir("/proc/self/fd").unwrap().count();
    drop(ShmTarget::export(&gpu, 1 << 20).unwrap());
    gpu.wait_idle();
    let before = n_open();
    for _ in 0..200 {
        drop(ShmTarget::export(&gpu, 1 << 20).unwrap());
        gpu.wait_idle();
    }
    // Other tests of this process open and close up to a hundred descriptors meanwhile.
    assert!(n_open() < before + 150, "{} then {}", before, n_open());
}
