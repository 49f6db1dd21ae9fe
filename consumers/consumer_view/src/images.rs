//! Frames as images and coloured points for people: header and payload in, pixels out. Any payload
//! is safe if its header passed the check.

use std::borrow::Cow;
use std::sync::LazyLock;

use bytemuck::pod_read_unaligned;
use consumer_forms::palette::{self, hsv};
use half::f16;
use schema_frames::{DvsEvent, FrameHeader, LidarPoint, LidarReturn, Modality, SemanticLidarPoint};

/// The rows of an image without padding, in one piece; a copy only of rows that have some.
pub fn tight<'a>(header: &FrameHeader, payload: &'a [u8]) -> Cow<'a, [u8]> {
    let row_bytes = header.width as usize * header.element_bytes as usize;
    if header.row_stride as usize == row_bytes || header.height <= 1 {
        return Cow::Borrowed(&payload[..row_bytes * header.height as usize]);
    }
    let mut pixels = Vec::with_capacity(row_bytes * header.height as usize);
    for row in 0..header.height as usize {
        pixels.extend_from_slice(&payload[row * header.row_stride as usize..][..row_bytes]);
    }
    Cow::Owned(pixels)
}

/// Instance ids as RGB.
pub fn instance_rgb(header: &FrameHeader, payload: &[u8]) -> Vec<u8> {
    let ids = tight(header, payload);
    let mut last = (0u32, [0u8; 3]);
    let mut pixels = Vec::with_capacity(ids.len() / 4 * 3);
    for bytes in ids.chunks_exact(4) {
        let id = u32::from_le_bytes(bytes.try_into().expect("chunks of four"));
        if id != last.0 {
            last = (id, palette::object(id));
        }
        pixels.extend_from_slice(&last.1);
    }
    pixels
}

/// Number of colours on the wheel that shows directions as hues.
const WHEEL_STEPS: usize = 1024;

/// A direction as a number from 0 to 4 that grows with the angle: 0 is right, 1 is down. It is
/// cheaper than an arc tangent.
fn diamond_angle(u: f32, v: f32) -> f32 {
    let across = u / (u.abs() + v.abs());
    if v >= 0.0 { 1.0 - across } else { 3.0 + across }
}

/// Saturated colours by diamond angle.
fn wheel() -> Vec<[f32; 3]> {
    let colour = |step: usize| {
        let angle = step as f32 * 4.0 / WHEEL_STEPS as f32;
        let u = if angle < 2.0 {
            1.0 - angle
        } else {
            angle - 3.0
        };
        let v = (1.0 - u.abs()) * if angle < 2.0 { 1.0 } else { -1.0 };
        hsv(
            (v.atan2(u) / std::f32::consts::TAU).rem_euclid(1.0),
            1.0,
            1.0,
        )
        .map(f32::from)
    };
    (0..WHEEL_STEPS).map(colour).collect()
}

/// Colours of flows by their parts, in steps of a 128th of the full length, up to twice that length:
/// `STEPS × STEPS` of them, row after row.
static FLOW_COLOURS: LazyLock<Vec<[u8; 3]>> = LazyLock::new(|| {
    let wheel = wheel();
    let part = |step: usize| (step as f32 - FLOW_MIDDLE) / FLOW_FULL;
    let colour = |at: usize| {
        let (u, v) = (part(at % FLOW_STEPS), part(at / FLOW_STEPS));
        let share = u.hypot(v).min(1.0);
        // A pixel without motion has no direction: NaN becomes index 0, and its share of colour is
        // zero.
        let full = wheel[(diamond_angle(u, v) * (WHEEL_STEPS / 4) as f32) as usize % WHEEL_STEPS];
        full.map(|full| (255.0 + (full - 255.0) * share) as u8)
    };
    (0..FLOW_STEPS * FLOW_STEPS).map(colour).collect()
});
const FLOW_STEPS: usize = 512;
const FLOW_MIDDLE: f32 = 256.0;
const FLOW_FULL: f32 = 128.0;

/// Optical flow as RGB: hue is the direction (red right, then through yellow-green down), white is
/// standing still, full colour is `full_px` or more.
pub fn flow_rgb(header: &FrameHeader, payload: &[u8], full_px: f32) -> Vec<u8> {
    let colours = FLOW_COLOURS.as_slice();
    let flow = tight(header, payload);
    let scale = FLOW_FULL / full_px;
    let limit = FLOW_MIDDLE - 1.0;
    let mut pixels = vec![0; flow.len() / 8 * 3];
    for (pixel, bytes) in pixels.chunks_exact_mut(3).zip(flow.chunks_exact(8)) {
        let [mut u, mut v] = pod_read_unaligned::<[f32; 2]>(bytes).map(|part| part * scale);
        let greatest = u.abs().max(v.abs());
        if !(u + v).is_finite() {
            continue;
        }
        if greatest > limit {
            let shorter = limit / greatest;
            (u, v) = (u * shorter, v * shorter);
        }
        let [column, row] = [u, v].map(|part| (part + FLOW_MIDDLE + 0.5) as usize);
        if let Some(colour) = colours.get(row * FLOW_STEPS + column) {
            pixel.copy_from_slice(colour);
        }
    }
    pixels
}

/// The length that is shown in full colour: the 95th percentile of a sample of lengths, at least
/// one pixel.
pub fn flow_full_px(header: &FrameHeader, payload: &[u8]) -> f32 {
    let n_pixels = header.width as usize * header.height as usize;
    let step = (n_pixels / 2000).max(1);
    let mut lengths: Vec<f32> = payload
        .chunks_exact(8)
        .step_by(step)
        .map(pod_read_unaligned::<[f32; 2]>)
        .map(|[u, v]| u.hypot(v))
        .filter(|length| length.is_finite())
        .collect();
    lengths.sort_by(f32::total_cmp);
    lengths
        .get(lengths.len() * 95 / 100)
        .copied()
        .unwrap_or(1.0)
        .max(1.0)
}

/// Normals as RGB: east, north and up as red, green and blue, each from −1 (dark) to 1 (bright);
/// black where nothing was hit.
pub fn normals_rgb(header: &FrameHeader, payload: &[u8]) -> Vec<u8> {
    let normals = tight(header, payload);
    let mut pixels = Vec::with_capacity(normals.len() / 8 * 3);
    for bytes in normals.chunks_exact(8) {
        let [x, y, z, _]: [u16; 4] = pod_read_unaligned(bytes);
        let normal = [x, y, z].map(|bits| f16::from_bits(bits).to_f32());
        let is_hit =
            normal.iter().any(|part| *part != 0.0) && normal.iter().all(|part| part.is_finite());
        pixels.extend(normal.map(|part| {
            if is_hit {
                (127.5 + 127.5 * part.clamp(-1.0, 1.0)).round() as u8
            } else {
                0
            }
        }));
    }
    pixels
}

/// Size of a camera's image. A list of events carries no size, but the principal point is the
/// middle of its image.
pub fn image_size_px(header: &FrameHeader) -> Option<[u32; 2]> {
    if header.modality().is_some_and(Modality::is_image) {
        return (header.width > 0 && header.height > 0).then_some([header.width, header.height]);
    }
    let size =
        [header.intrinsics_px[2], header.intrinsics_px[3]].map(|middle| (2.0 * middle).round());
    let usable = |px: f64| (1.0..=16_384.0).contains(&px);
    (usable(size[0]) && usable(size[1])).then(|| size.map(|px| px as u32))
}

/// Events of a window as numbers of [`palette::EVENTS`], by the last change of each pixel.
pub fn event_numbers(size_px: [u32; 2], payload: &[u8]) -> Vec<u8> {
    let [width, height] = size_px.map(|px| px as usize);
    let mut pixels = vec![0u8; width * height];
    for bytes in payload.chunks_exact(size_of::<DvsEvent>()) {
        let event: DvsEvent = pod_read_unaligned(bytes);
        let (x, y) = (event.x_px as usize, event.y_px as usize);
        if x < width && y < height {
            pixels[y * width + x] = 1 + (event.polarity == 1) as u8;
        }
    }
    pixels
}

/// Numbers of colours as RGB.
pub fn rgb_of(colours: &[[u8; 3]], numbers: &[u8]) -> Vec<u8> {
    let colour = |number: &u8| colours.get(*number as usize).copied().unwrap_or_default();
    numbers.iter().flat_map(colour).collect()
}

/// A lidar's points, metres in the sensor's axes, and their colours; of more than `max_points`
/// every so manieth.
pub fn cloud(
    header: &FrameHeader,
    payload: &[u8],
    max_points: usize,
) -> (Vec<[f32; 3]>, Vec<[u8; 3]>) {
    let point_bytes = header.element_bytes as usize;
    if point_bytes < 12 {
        return (Vec::new(), Vec::new());
    }
    let step = (payload.len() / point_bytes)
        .div_ceil(max_points.max(1))
        .max(1);
    let modality = header.modality();
    if modality.is_some_and(|modality| modality.element_bytes() != point_bytes) {
        return (Vec::new(), Vec::new());
    }
    let of_class = |class: u8| {
        let info = schema_types::Class(class).info();
        info.map_or([255; 3], |info| info.rgb)
    };
    let coloured = |bytes: &[u8]| match modality {
        Some(Modality::SemanticLidar) => {
            let point: SemanticLidarPoint = pod_read_unaligned(bytes);
            (point.hit_in_sensor_m, of_class(point.class))
        }
        Some(Modality::LidarReturns) => {
            let point: LidarReturn = pod_read_unaligned(bytes);
            (point.hit_in_sensor_m, of_class(point.class))
        }
        _ => {
            let point: LidarPoint = pod_read_unaligned(bytes);
            (
                point.hit_in_sensor_m,
                height_colour(point.hit_in_sensor_m[2]),
            )
        }
    };
    payload
        .chunks_exact(point_bytes)
        .step_by(step)
        .map(coloured)
        .filter(|(hit, _)| hit.iter().all(|x| x.is_finite()))
        .unzip()
}

/// Colour of a height in the sensor's axes: turbo from 2.5 m below the sensor to 5 m above it.
pub fn height_colour(z_m: f32) -> [u8; 3] {
    turbo((z_m + 2.5) / 7.5)
}

/// The turbo colour map (A. Mikhailov, *Turbo, an improved rainbow colormap*, 2019), by its
/// published polynomial fit of degree five.
pub fn turbo(share: f32) -> [u8; 3] {
    let x = share.clamp(0.0, 1.0);
    let powers = [1.0, x, x * x, x.powi(3), x.powi(4), x.powi(5)];
    TURBO.map(|coefficients| {
        let value: f32 = coefficients.iter().zip(powers).map(|(c, p)| c * p).sum();
        (value.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

/// Coefficients of x⁰…x⁵ for red, green, blue.
const TURBO: [[f32; 6]; 3] = [
    [
        0.135_721_4,
        4.615_393,
        -42.660_32,
        132.131_08,
        -152.942_4,
        59.286_38,
    ],
    [
        0.091_402_61,
        2.194_188_4,
        4.842_966_6,
        -14.185_033,
        4.277_298_6,
        2.829_566,
    ],
    [
        0.106_673_3,
        12.641_946,
        -60.582_05,
        110.362_77,
        -89.903_11,
        27.348_25,
    ],
];

#[cfg(test)]
mod tests {
    use super::*;

    fn image(modality: Modality, width_px: u32, height_px: u32) -> FrameHeader {
        let mut header = FrameHeader::new(modality);
        header.set_image(width_px, height_px);
        header
    }

    #[test]
    fn padding_is_cut_from_rows() {
        let mut header = image(Modality::Semantic, 3, 2);
        header.row_stride = 5;
        header.payload_bytes = 8;
        assert_eq!(
            tight(&header, &[1, 2, 3, 9, 9, 4, 5, 6]).as_ref(),
            [1, 2, 3, 4, 5, 6]
        );
    }

    #[test]
    fn standing_still_is_white_and_right_is_red() {
        let header = image(Modality::Flow, 3, 1);
        let flow: Vec<u8> = [0.0f32, 0.0, 5.0, 0.0, f32::NAN, 0.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        assert_eq!(
            flow_rgb(&header, &flow, 5.0),
            [255, 255, 255, 255, 0, 0, 0, 0, 0]
        );
    }

    #[test]
    fn normals_point_where_their_colours_say() {
        let header = image(Modality::Normals, 3, 1);
        // Up, west and nothing, as halves: 1 is 0x3c00, −1 is 0xbc00.
        let normals: [u16; 12] = [0, 0, 0x3c00, 0, 0xbc00, 0, 0, 0, 0, 0, 0, 0];
        assert_eq!(
            normals_rgb(&header, bytemuck::cast_slice(&normals)),
            [128, 128, 255, 0, 128, 128, 0, 0, 0]
        );
    }

    #[test]
    fn the_last_event_of_a_pixel_wins_and_strays_are_ignored() {
        let event = |x_px, polarity| DvsEvent {
            nanos_in_window: 0,
            x_px,
            y_px: 0,
            object_id: 0,
            polarity,
            class: 0,
            reserved: 0,
        };
        let events = [event(1, 1), event(1, 0), event(0, 1), event(7, 1)];
        assert_eq!(
            rgb_of(
                &palette::EVENTS,
                &event_numbers([2, 1], bytemuck::cast_slice(&events))
            ),
            [255, 70, 60, 70, 130, 255]
        );
    }

    #[test]
    fn turbo_runs_from_dark_blue_over_green_to_dark_red() {
        let [low, middle, high] = [0.0, 0.5, 1.0].map(turbo);
        assert!(low[2] > low[1] && low.iter().all(|c| *c < 100), "{low:?}");
        assert!(middle[1] > 220, "{middle:?}");
        assert!(high[0] > 100 && high[1] < 40 && high[2] < 40, "{high:?}");
    }

    #[test]
    fn flow_has_the_hue_of_its_direction() {
        for degrees in 0..360 {
            let angle = (degrees as f32).to_radians();
            let header = image(Modality::Flow, 1, 1);
            let flow: Vec<u8> = [angle.cos() * 9.0, angle.sin() * 9.0]
                .iter()
                .flat_map(|x| x.to_le_bytes())
                .collect();
            let expected = hsv(degrees as f32 / 360.0, 1.0, 1.0);
            let got = flow_rgb(&header, &flow, 9.0);
            // A step of the wheel is at most half a degree: 2.2 of 255.
            assert!(
                got.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 4),
                "{degrees}: {got:?} instead of {expected:?}"
            );
        }
    }

    #[test]
    fn large_clouds_are_thinned_and_points_without_number_left_out() {
        let mut header = FrameHeader::new(Modality::Lidar);
        header.set_list(150_000);
        let mut points = vec![
            LidarPoint {
                hit_in_sensor_m: [1.0, 2.0, 0.0],
                intensity: 0,
                channel: 0
            };
            150_000
        ];
        points[0].hit_in_sensor_m[0] = f32::NAN;
        let (positions, colours) = cloud(&header, bytemuck::cast_slice(&points), 60_000);
        assert_eq!(positions.len(), 49_999);
        assert_eq!(colours.len(), positions.len());
    }
}
