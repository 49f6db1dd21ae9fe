//! Coded payloads come back byte for byte, and bytes that are none are refused: never a panic, never
//! more memory than the payload accounts for.

use bytemuck::bytes_of;
use schema_frames::{DvsEvent, FrameHeader, LidarPoint, Modality};
use schema_recording::codec::{
    CODECS, EVENTS, Encoder, FLOW, PLANES16, PLANES32, PNG, RECORDS, ZSTD, decode,
};

fn image(modality: Modality, width: u32, height: u32) -> FrameHeader {
    let mut header = FrameHeader::new(modality);
    header.set_image(width, height);
    header
}

fn list(modality: Modality, n: u32) -> FrameHeader {
    let mut header = FrameHeader::new(modality);
    header.set_list(n);
    header
}

/// One payload of every kind that has a codec of its own, and the codec that it must get.
fn samples() -> Vec<(FrameHeader, Vec<u8>, &'static str)> {
    let mut rng = fastrand::Rng::with_seed(11);
    let (w, h) = (50u32, 31u32);
    let pixels = || (0..h).flat_map(move |y| (0..w).map(move |x| (x, y)));
    let words = |of: &dyn Fn(u32, u32) -> f32| -> Vec<u8> {
        pixels().flat_map(|(x, y)| of(x, y).to_le_bytes()).collect()
    };
    let mut out = Vec::new();
    let depth = words(&|x, y| {
        if y < 4 {
            f32::INFINITY
        } else {
            2.0 + 900.0 / (y as f32 + 0.3 * x as f32)
        }
    });
    out.push((image(Modality::Depth, w, h), depth, PLANES32));
    let flow: Vec<u8> = pixels()
        .flat_map(|(x, y)| {
            let now = [x as f32 + 0.5, y as f32 + 0.5];
            let before = [25.3 + (now[0] - 25.3) / 1.01, 12.7 + (now[1] - 12.7) / 1.01];
            [0, 1].map(|k| now[k] - before[k])
        })
        .flat_map(f32::to_le_bytes)
        .collect();
    out.push((image(Modality::Flow, w, h), flow.clone(), FLOW));
    // Numbers that are no difference of a pixel centre and something else.
    let mut odd = flow;
    odd[..4].copy_from_slice(&(-0.0f32).to_le_bytes());
    odd[8..12].copy_from_slice(&f32::NAN.to_le_bytes());
    out.push((image(Modality::Flow, w, h), odd, PLANES32));
    let normals: Vec<u8> = pixels()
        .flat_map(|(x, y)| [x as u16, (y * 300) as u16, 0x3c00, u16::MAX].map(u16::to_le_bytes))
        .flatten()
        .collect();
    out.push((image(Modality::Normals, w, h), normals, PLANES16));
    let mut colour = || -> Vec<u8> {
        let noise = &mut rng;
        pixels()
            .flat_map(|(x, y)| [x as u8, y as u8 * 3, noise.u8(..8), 255])
            .collect()
    };
    out.push((image(Modality::Rgb, w, h), colour(), PNG));
    let mut translucent = colour();
    translucent[7] = 9;
    out.push((image(Modality::Rgb, w, h), translucent, PNG));
    let classes = pixels().map(|(x, y)| if x < 20 { 14 } else { (y / 10 * 80) as u8 });
    out.push((image(Modality::Semantic, w, h), classes.collect(), PNG));
    let ids = pixels().flat_map(|(x, _)| (x / 9 * 70_000).to_le_bytes());
    out.push((image(Modality::Instance, w, h), ids.collect(), ZSTD));
    // A row with a gap is no image of the planes' kind.
    let mut gap = image(Modality::Depth, w, h);
    gap.row_stride += 12;
    gap.payload_bytes = gap.row_stride as u64 * h as u64;
    out.push((gap, vec![3; gap.payload_bytes as usize], ZSTD));
    let points: Vec<u8> = (0..500u16)
        .flat_map(|i| {
            let angle = i as f32 * 0.01;
            let point = LidarPoint {
                hit_in_sensor_m: [angle.cos() * 20.0, angle.sin() * 20.0, -1.5],
                intensity: i * 3,
                channel: i / 100,
            };
            bytes_of(&point).to_vec()
        })
        .collect();
    out.push((list(Modality::Lidar, 500), points, RECORDS));
    let events = events(&mut rng, 900);
    let n = events.len() as u32;
    let as_bytes = |events: &[DvsEvent]| -> Vec<u8> {
        events
            .iter()
            .flat_map(|event| bytes_of(event).to_vec())
            .collect()
    };
    out.push((list(Modality::Dvs, n), as_bytes(&events), EVENTS));
    // Neither two classes of one pixel nor another order fit the events' codec.
    let mut two_classes = events.clone();
    let again = (two_classes[0].x_px, two_classes[0].y_px);
    let later = DvsEvent {
        nanos_in_window: u32::MAX,
        class: 77,
        ..two_classes[0]
    };
    two_classes.push(later);
    assert_eq!((later.x_px, later.y_px), again);
    out.push((list(Modality::Dvs, n + 1), as_bytes(&two_classes), RECORDS));
    let mut nothing_first = events.clone();
    nothing_first[0].object_id = 0;
    nothing_first[0].class = 0;
    nothing_first.push(later);
    out.push((
        list(Modality::Dvs, n + 1),
        as_bytes(&nothing_first),
        RECORDS,
    ));
    let mut swapped = events;
    swapped.swap(3, 400);
    out.push((list(Modality::Dvs, n), as_bytes(&swapped), RECORDS));
    out
}

/// Events of ramps: evenly in time at each pixel, sorted by time, y, x.
fn events(rng: &mut fastrand::Rng, n_pixels: u16) -> Vec<DvsEvent> {
    let mut events = Vec::new();
    for pixel in 0..n_pixels {
        let wait = rng.u32(1_000..400_000);
        let polarity = rng.u8(..2);
        for k in 0..rng.u32(1..6) {
            events.push(DvsEvent {
                nanos_in_window: 77 + k * wait + pixel as u32 % 3,
                x_px: pixel * 7 % 640,
                y_px: pixel / 90,
                object_id: pixel as u32 / 50,
                polarity,
                class: (pixel / 300) as u8,
                reserved: 0,
            });
        }
    }
    events.sort_by_key(|event| (event.nanos_in_window, event.y_px, event.x_px));
    events.dedup_by_key(|event| (event.nanos_in_window, event.y_px, event.x_px));
    events
}

fn coded(header: &FrameHeader, payload: &[u8]) -> (&'static str, Vec<u8>) {
    let mut encoder = Encoder::new().unwrap();
    let (codec, bytes) = encoder.encode(header, payload).expect("it becomes smaller");
    (codec, bytes.to_vec())
}

#[test]
fn every_payload_comes_back_byte_for_byte() {
    let mut encoder = Encoder::new().unwrap();
    // One encoder for all, twice, so that nothing of a frame is left in the next.
    for (header, payload, expected) in samples().into_iter().chain(samples()) {
        let (codec, bytes) = encoder
            .encode(&header, &payload)
            .expect("it becomes smaller");
        assert_eq!(codec, expected, "{:?}", header.modality());
        assert!(CODECS.contains(&codec));
        let mut out = vec![0xaa; payload.len()];
        decode(codec, &header, bytes, &mut out).unwrap();
        assert!(out == payload, "{codec} of {:?}", header.modality());
    }
}

#[test]
fn noise_stays_as_it_is() {
    let mut rng = fastrand::Rng::with_seed(3);
    let header = image(Modality::Instance, 64, 64);
    let noise: Vec<u8> = (0..header.payload_bytes).map(|_| rng.u8(..)).collect();
    assert!(Encoder::new().unwrap().encode(&header, &noise).is_none());
    let mut out = vec![0; noise.len()];
    decode("", &header, &noise, &mut out).unwrap();
    assert_eq!(out, noise);
    assert!(decode("", &header, &noise[1..], &mut out).is_err());
}

#[test]
fn a_flipped_bit_is_an_error_or_harmless() {
    let mut rng = fastrand::Rng::with_seed(5);
    for (header, payload, codec) in samples() {
        let (_, whole) = coded(&header, &payload);
        for _ in 0..400 {
            let mut broken = whole.clone();
            let at = rng.usize(..broken.len());
            broken[at] ^= 1 << rng.u8(..8);
            let mut out = vec![0; payload.len()];
            match decode(codec, &header, &broken, &mut out) {
                Err(_) => {}
                Ok(()) => assert!(
                    out == payload,
                    "{codec}: byte {at} decoded to something else"
                ),
            }
        }
        for _ in 0..50 {
            let end = rng.usize(..whole.len());
            let mut out = vec![0; payload.len()];
            assert!(
                decode(codec, &header, &whole[..end], &mut out).is_err(),
                "{codec} cut at {end}"
            );
        }
    }
}

#[test]
fn another_codec_or_header_never_panics() {
    let mut rng = fastrand::Rng::with_seed(6);
    let samples = samples();
    for (header, payload, _) in &samples {
        let (_, bytes) = coded(header, payload);
        for codec in CODECS {
            for (other, other_payload, _) in &samples {
                let mut out = vec![0; other_payload.len()];
                let _ = decode(codec, other, &bytes, &mut out);
            }
            let mut odd = *header;
            odd.width = rng.u32(..);
            odd.height = rng.u32(..);
            odd.element_bytes = rng.u32(..40);
            odd.row_stride = rng.u32(..);
            let mut out = vec![0; rng.usize(..4096)];
            let _ = decode(codec, &odd, &bytes, &mut out);
        }
    }
    let error = decode("x265", &samples[0].0, &[], &mut []).unwrap_err();
    assert!(
        error.to_string().contains("\"x265\" is not known"),
        "{error}"
    );
}

/// A frame of zstd that unpacks to a gigabyte fits into 100 KB; only as many bytes as the payload
/// has may be made of it.
#[test]
fn coded_bytes_that_unpack_to_a_gigabyte_are_refused() {
    let mut stream = zstd::stream::Encoder::new(Vec::new(), 1).unwrap();
    stream.set_pledged_src_size(Some(1 << 30)).unwrap();
    stream.include_contentsize(true).unwrap();
    let zeros = vec![0; 1 << 20];
    for _ in 0..1 << 10 {
        std::io::Write::write_all(&mut stream, &zeros).unwrap();
    }
    let frame = stream.finish().unwrap();
    assert!(frame.len() < 1 << 20);
    let bomb = [&crc32fast::hash(&frame).to_le_bytes()[..], &frame].concat();
    for (header, payload, codec) in samples() {
        if codec == PNG {
            continue;
        }
        let mut out = vec![0; payload.len()];
        let error = decode(codec, &header, &bomb, &mut out).unwrap_err();
        assert!(!error.to_string().is_empty());
    }
}
