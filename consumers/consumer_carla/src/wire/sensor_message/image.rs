//! Images: Gantry's modalities as CARLA's four bytes B, G, R, A per pixel, and optical flow as two
//! floats.

use std::sync::OnceLock;

use half::f16;
use schema_bus::Frame;
use schema_frames::FrameHeader;
use schema_types::Class;

/// Depth at full scale.
const FULL_DEPTH_M: f64 = 1000.0;
/// Largest 24-bit number.
const FULL_CODE: f64 = 16_777_215.0;
/// Flow is clipped to this share of the image.
const MOST_FLOW: f32 = 2.0;
const OPAQUE: u32 = 0xff00_0000;
/// Bit of scenery's 16-bit ids, which keeps them apart from actors' ids.
const SCENERY: u32 = 0x8000;
const SCENERY_ID: u32 = 1 << 31;

/// Width, height and field of view. An event camera's are those of its image, not of its list of
/// events.
pub fn push_header(out: &mut Vec<u8>, header: &FrameHeader, number: u64) {
    const EVENT_CAMERA: u64 = 3;
    let [fx, _, cx, cy] = header.intrinsics_px;
    let (width, height) = if number == EVENT_CAMERA {
        ((2.0 * cx).round() as u32, (2.0 * cy).round() as u32)
    } else {
        (header.width, header.height)
    };
    let fov_deg = if fx > 0.0 {
        2.0 * (0.5 * f64::from(width) / fx).atan().to_degrees()
    } else {
        0.0
    };
    out.extend(width.to_le_bytes());
    out.extend(height.to_le_bytes());
    out.extend((fov_deg as f32).to_le_bytes());
}

fn rows(frame: &Frame) -> impl Iterator<Item = &[u8]> {
    (0..frame.header().height).filter_map(|y| frame.row(y))
}

fn push_pixels<const N: usize>(out: &mut Vec<u8>, frame: &Frame, pixel: impl Fn([u8; N]) -> u32) {
    out.reserve(frame.header().width as usize * frame.header().height as usize * 4);
    for row in rows(frame) {
        out.extend(
            row.as_chunks::<N>()
                .0
                .iter()
                .flat_map(|bytes| pixel(*bytes).to_le_bytes()),
        );
    }
}

/// Copies rows without the gaps between them.
pub fn rgb(out: &mut Vec<u8>, frame: &Frame) {
    rows(frame).for_each(|row| out.extend(row));
}

/// A depth as a 24-bit code with red as the lowest byte; beyond 1000 m and where nothing was hit it
/// is white.
pub fn depth_pixel(metres: f32) -> u32 {
    let share = (f64::from(metres) / FULL_DEPTH_M).clamp(0.0, 1.0);
    let code = (share * FULL_CODE) as u32;
    code >> 16 | (code & 0xff00) | (code & 0xff) << 16 | OPAQUE
}

/// Depth along the optical axis.
pub fn depth(out: &mut Vec<u8>, frame: &Frame) {
    push_pixels(out, frame, |bytes| depth_pixel(f32::from_le_bytes(bytes)));
}

/// The class in red.
pub fn semantic(out: &mut Vec<u8>, frame: &Frame) {
    push_pixels(out, frame, |[class]| u32::from(class) << 16 | OPAQUE);
}

/// The class in its display colour.
pub fn palette(out: &mut Vec<u8>, frame: &Frame) {
    push_pixels(out, frame, |[class]| {
        let [red, green, blue] = Class(class)
            .info()
            .map_or([0; 3], |info| info.rgb)
            .map(u32::from);
        blue | green << 8 | red << 16 | OPAQUE
    });
}

/// Class in red, 16 bits of the object's id in green and blue, green lowest. Ids of actors that need
/// more than 15 bits begin again at 1, so that no actor looks like scenery or like nothing.
pub fn instance_pixel(id: u32, class: u8) -> u32 {
    let short = match id {
        0 => 0,
        scenery if scenery & SCENERY_ID != 0 => scenery & 0x7fff | SCENERY,
        actor => (actor - 1) % (SCENERY - 1) + 1,
    };
    short >> 8 | (short & 0xff) << 8 | u32::from(class) << 16 | OPAQUE
}

/// Combines an image of ids with one of classes.
pub fn instance(out: &mut Vec<u8>, ids: &Frame, classes: &Frame) {
    out.reserve(ids.header().width as usize * ids.header().height as usize * 4);
    for (ids, classes) in rows(ids).zip(rows(classes)) {
        let pixels = ids.as_chunks::<4>().0.iter().zip(classes);
        out.extend(
            pixels.flat_map(|(id, class)| {
                instance_pixel(u32::from_le_bytes(*id), *class).to_le_bytes()
            }),
        );
    }
}

/// Byte of every half-precision component of a unit vector.
fn normal_bytes() -> &'static [u8; 1 << 16] {
    static BYTES: OnceLock<Box<[u8; 1 << 16]>> = OnceLock::new();
    BYTES.get_or_init(|| {
        Box::new(std::array::from_fn(|bits| {
            // What is no number counts as 0.
            let part = f16::from_bits(bits as u16);
            let part = if part.is_finite() { part.to_f32() } else { 0.0 };
            ((part.clamp(-1.0, 1.0) + 1.0) * 127.5).round() as u8
        }))
    })
}

/// A normal's components as bytes: x in red, mirrored y in green, z in blue; black where there is
/// no normal.
pub fn normal_pixel(halves: [u16; 3]) -> u32 {
    let [x, y, z] = halves;
    if (x | y | z) & 0x7fff == 0 {
        return OPAQUE;
    }
    let byte = |bits: u16| u32::from(normal_bytes()[usize::from(bits)]);
    byte(z) | byte(y ^ 0x8000) << 8 | byte(x) << 16 | OPAQUE
}

/// Unit normals in the world.
pub fn normals(out: &mut Vec<u8>, frame: &Frame) {
    push_pixels(out, frame, |bytes: [u8; 8]| {
        let half_at = |i: usize| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
        normal_pixel([half_at(0), half_at(1), half_at(2)])
    });
}

/// Converts flow from pixels with y down to shares of the image with y up.
pub fn flow(out: &mut Vec<u8>, frame: &Frame) {
    let (width, height) = (frame.header().width, frame.header().height);
    out.reserve(width as usize * height as usize * 8);
    let share = |pixels: &[u8], side: f32| {
        let pixels = f32::from_le_bytes([pixels[0], pixels[1], pixels[2], pixels[3]]);
        (pixels / side).clamp(-MOST_FLOW, MOST_FLOW).to_le_bytes()
    };
    for row in rows(frame) {
        for pixel in row.as_chunks::<8>().0 {
            out.extend(share(&pixel[..4], width as f32));
            out.extend(share(&pixel[4..], -(height as f32)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The decoding that CARLA's manual gives.
    #[test]
    fn depth_decodes_within_the_codes_resolution() {
        for metres in [0.1f32, 1.0, 7.25, 123.456, 999.9] {
            let [blue, green, red, alpha] = depth_pixel(metres).to_le_bytes().map(f64::from);
            let decoded =
                1000.0 * (red + 256.0 * green + 65536.0 * blue) / (256.0 * 256.0 * 256.0 - 1.0);
            assert!(
                (decoded - f64::from(metres)).abs() < 1000.0 / FULL_CODE + 1e-5 && alpha == 255.0,
                "{metres} {decoded}"
            );
        }
        assert_eq!(depth_pixel(f32::INFINITY), 0xffff_ffff);
        assert_eq!(depth_pixel(5000.0), 0xffff_ffff);
    }

    #[test]
    fn actors_keep_their_ids_and_scenery_never_takes_one() {
        let read = |pixel: u32| {
            let [blue, green, red, _] = pixel.to_le_bytes().map(u32::from);
            (256 * blue + green, red)
        };
        assert_eq!(read(instance_pixel(0x1234, 14)), (0x1234, 14));
        assert_eq!(read(instance_pixel(0, 11)), (0, 11));
        assert!(read(instance_pixel(SCENERY_ID | 0x1234, 3)).0 >= 0x8000);
        // The last id of 15 bits, the next two, and the first of 16 bits that are all 0.
        let many = [0x7fff, 0x8000, 0x8001, 0x1_0000].map(|id| read(instance_pixel(id, 14)).0);
        assert_eq!(many, [0x7fff, 1, 2, 2]);
    }

    #[test]
    fn normals_are_mirrored_and_the_sky_is_black() {
        const ONE: u16 = 0x3c00;
        let rgb = |pixel: u32| [pixel >> 16 & 255, pixel >> 8 & 255, pixel & 255];
        assert_eq!(rgb(normal_pixel([0, 0, ONE])), [128, 128, 255]);
        assert_eq!(rgb(normal_pixel([ONE, 0, 0]))[0], 255);
        assert_eq!(
            rgb(normal_pixel([0, ONE, 0]))[1],
            0,
            "our left is CARLA's −y"
        );
        assert_eq!(rgb(normal_pixel([0, ONE | 0x8000, 0]))[1], 255);
        assert_eq!(rgb(normal_pixel([0, 0x8000, 0])), [0, 0, 0]);
    }
}
