//! Size and time of ways to store payloads losslessly, on frames of a recording.
//!
//! `codecs FOLDER [--json FILE]`

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::PathBuf;

use schema_frames::{FrameHeader, Modality};
use schema_recording::codec::{Encoder, decode};

/// Processor time of this thread, seconds.
fn cpu_secs() -> f64 {
    let time = nix::time::clock_gettime(nix::time::ClockId::CLOCK_THREAD_CPUTIME_ID)
        .expect("the clock of a thread can be read");
    time.tv_sec() as f64 + time.tv_nsec() as f64 * 1e-9
}

type Frame = (FrameHeader, Vec<u8>);

fn main() {
    let folder = PathBuf::from(std::env::args().nth(1).expect("a folder"));
    let mut by: BTreeMap<String, Vec<Frame>> = BTreeMap::new();
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "bin")).collect();
    names.sort();
    for path in names {
        let payload = std::fs::read(&path).unwrap();
        let Ok(header) = std::fs::read(path.with_extension("hdr")) else { continue };
        let header: FrameHeader = bytemuck::pod_read_unaligned(&header);
        let name = header.modality().unwrap().name();
        by.entry(name.to_string()).or_default().push((header, payload));
    }
    for (name, frames) in &by {
        let mut row = |way: &str, work: &mut dyn FnMut(&Frame) -> usize| {
            let raw: usize = frames.iter().map(|f| f.1.len()).sum();
            frames.iter().for_each(|f| { black_box(work(f)); });
            let began = cpu_secs();
            let mut n = 0;
            for _ in 0..3 { n = frames.iter().map(|f| black_box(work(f))).sum::<usize>(); }
            let secs = (cpu_secs() - began) / 3.0;
            let k = frames.len() as f64;
            println!("{name:10} {way:24} {:8.1} kB of {:8.1} ({:5.1} %)  {:7.2} ms {:7.0} MB/s", n as f64 / k / 1e3, raw as f64 / k / 1e3, 100.0 * n as f64 / raw as f64, secs / k * 1e3, raw as f64 / secs / 1e6);
        };
        row("copy", &mut |f| { black_box(f.1.clone()).len() });
        row("lz4", &mut |f| lz4::block::compress(&f.1, None, false).unwrap().len());
        for level in [-1, 1, 3] {
            let mut z = zstd::bulk::Compressor::new(level).unwrap();
            row(&format!("zstd {level}"), &mut |f| z.compress(&f.1).unwrap().len());
        }
        for level in [-7, -3, -1, 1, 3] {
            let mut e = Encoder::with_level(level).unwrap();
            let mut codec = "";
            row(&format!("codec {level}"), &mut |f| { let Some((c, b)) = e.encode(&f.0, &f.1) else { return f.1.len() }; codec = c; b.len() });
            let coded: Vec<_> = frames.iter().map(|f| e.encode(&f.0, &f.1).map(|(c, b)| (c, b.to_vec())).unwrap_or(("", f.1.clone()))).collect();
            if level == 1 {
                let mut i = 0;
                row(&format!("decode {codec}"), &mut |f| { let (c, b) = &coded[i % coded.len()]; i += 1; let mut out = vec![0; f.1.len()]; decode(c, &f.0, b, &mut out).unwrap(); assert!(out == f.1); b.len() });
            }
        }
        if matches!(frames[0].0.modality(), Some(Modality::Rgb)) {
            for (way, c, filter) in [("fastest", png::Compression::Fastest, None), ("fast", png::Compression::Fast, None), ("balanced", png::Compression::Balanced, None), ("fastest sub", png::Compression::Fastest, Some(png::Filter::Sub)), ("fastest paeth", png::Compression::Fastest, Some(png::Filter::Paeth))] {
                row(&format!("png {way}"), &mut |f| {
                    let px: Vec<u8> = f.1.chunks_exact(4).flat_map(|p| [p[2], p[1], p[0]]).collect();
                    let mut out = Vec::new();
                    let mut e = png::Encoder::new(&mut out, f.0.width, f.0.height);
                    e.set_color(png::ColorType::Rgb);
                    e.set_compression(c);
                    if let Some(filter) = filter { e.set_filter(filter); }
                    e.write_header().unwrap().write_image_data(&px).unwrap();
                    out.len()
                });
            }
            row("jpeg 90 half", &mut |f| {
                let (w, h) = (f.0.width as usize / 2, f.0.height as usize / 2);
                let mut px = vec![0u8; w * h * 3];
                for y in 0..h { for x in 0..w { let p = &f.1[(y * 2 * w * 2 + x * 2) * 4..]; px[(y * w + x) * 3..][..3].copy_from_slice(&[p[2], p[1], p[0]]); } }
                let mut out = Vec::new();
                image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 90).encode(&px, w as u32, h as u32, image::ExtendedColorType::Rgb8).unwrap();
                out.len()
            });
        }
    }
}
