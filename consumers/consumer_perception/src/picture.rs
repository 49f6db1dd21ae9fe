//! Pictures of frames with truth or results drawn on them.

pub mod pixels;

use consumer_metrics::average_precision::RunMask;
use consumer_truth::Camera;
use consumer_truth::camera::NEAR_M;
use consumer_truth::ticks::TickFrame;
use image::{Rgb, RgbImage};
use nalgebra::{Isometry3, Point3, Vector3};
use schema_types::class::CLASSES;

use pixels::Pixels;

/// Colours of what counts, one after the other, and of what is ignored.
const COLOURS: [[u8; 3]; 8] = [
    [255, 214, 10],
    [90, 200, 250],
    [255, 99, 132],
    [120, 230, 120],
    [255, 149, 60],
    [190, 140, 255],
    [60, 220, 200],
    [240, 130, 220],
];
const IGNORED: [u8; 3] = [150, 150, 150];

/// How values become colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Metres: near is bright.
    Depth,
    /// Pixels: much is bright.
    Disparity,
}

/// An image with a camera.
#[derive(Clone, Debug)]
pub struct Picture {
    image: RgbImage,
    camera: Camera,
    /// Size of an image pixel, and of lines, in pixels of the picture.
    zoom: u32,
}

impl Picture {
    /// A frame of colour; small images are enlarged.
    pub fn of(frame: &TickFrame) -> Picture {
        let (width, height) = (frame.header.width, frame.header.height);
        let zoom = (480 / width.max(1)).clamp(1, 6);
        let pixels: Vec<[u8; 4]> = frame.elements();
        let image = RgbImage::from_fn(width * zoom, height * zoom, |x, y| {
            let [b, g, r, _] = pixels[((y / zoom) * width + x / zoom) as usize];
            Rgb([r, g, b])
        });
        Picture {
            image,
            camera: Camera::of(&frame.header),
            zoom,
        }
    }

    /// The picture as JPEG.
    ///
    /// # Errors
    /// If it cannot be coded, which no picture of a frame does.
    pub fn jpeg(&self) -> anyhow::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 85);
        self.image.write_with_encoder(encoder)?;
        Ok(bytes)
    }

    fn put(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        let inside = (0..i64::from(self.image.width())).contains(&x)
            && (0..i64::from(self.image.height())).contains(&y);
        if inside {
            self.image.put_pixel(x as u32, y as u32, Rgb(colour));
        }
    }

    /// A straight line between two places of the frame, pixels.
    fn stroke(&mut self, from: [f64; 2], to: [f64; 2], colour: [u8; 3]) {
        let zoom = f64::from(self.zoom);
        let [x0, y0, x1, y1] = [from[0], from[1], to[0], to[1]].map(|part| part * zoom);
        let limit = 4.0 * f64::from(self.image.width() + self.image.height());
        let is_drawable = [x0, y0, x1, y1].iter().all(|part| part.abs() < limit);
        if !is_drawable {
            return;
        }
        let n = (x1 - x0).abs().max((y1 - y0).abs()).ceil().max(1.0);
        for step in 0..=n as u32 {
            let share = f64::from(step) / n;
            let (x, y) = (x0 + (x1 - x0) * share, y0 + (y1 - y0) * share);
            let (x, y) = (x.floor() as i64, y.floor() as i64);
            self.put(x, y, colour);
            self.put(x + 1, y, colour);
            self.put(x, y + 1, colour);
        }
    }

    /// A few letters with their lower left corner at a place of the frame.
    fn text(&mut self, at: [f64; 2], text: &str, colour: [u8; 3]) {
        let zoom = f64::from(self.zoom);
        let width = 8 * text.chars().count() as i64;
        let (right, below) = (self.image.width(), self.image.height());
        let x0 = ((at[0] * zoom) as i64).clamp(0, (i64::from(right) - width).max(0));
        let y0 = ((at[1] * zoom) as i64 - 9).clamp(0, (i64::from(below) - 9).max(0));
        for y in y0 - 1..y0 + 9 {
            for x in x0 - 1..x0 + width {
                self.put(x, y, [20, 20, 24]);
            }
        }
        for (n, letter) in text.chars().enumerate() {
            let glyph = font8x8::legacy::BASIC_LEGACY
                .get(letter as usize)
                .copied()
                .unwrap_or_default();
            for (row, bits) in glyph.into_iter().enumerate() {
                for column in 0..8 {
                    if bits >> column & 1 == 1 {
                        self.put(x0 + 8 * n as i64 + column, y0 + row as i64, colour);
                    }
                }
            }
        }
    }

    /// A colour that belongs to the first word of a label.
    fn colour_of(label: &str, counts: bool) -> [u8; 3] {
        let word = label.split(' ').next().unwrap_or_default();
        let sum: usize = word.bytes().map(usize::from).sum();
        if counts {
            COLOURS[sum % COLOURS.len()]
        } else {
            IGNORED
        }
    }

    /// A rectangle, in pixels of the frame, with a label.
    pub fn rectangle(&mut self, min_px: [f64; 2], max_px: [f64; 2], counts: bool, label: &str) {
        let colour = Picture::colour_of(label, counts);
        let [x0, y0, x1, y1] = [min_px[0], min_px[1], max_px[0], max_px[1]];
        for (from, to) in [
            ([x0, y0], [x1, y0]),
            ([x1, y0], [x1, y1]),
            ([x1, y1], [x0, y1]),
            ([x0, y1], [x0, y0]),
        ] {
            self.stroke(from, to, colour);
        }
        if !label.is_empty() {
            self.text([x0, y0], label, colour);
        }
    }

    /// A box in space, with a label at its nearest corner.
    pub fn cuboid(
        &mut self,
        world_from_box: &Isometry3<f64>,
        half_m: Vector3<f64>,
        counts: bool,
        label: &str,
    ) {
        let colour = Picture::colour_of(label, counts);
        let corner = |i: usize| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let corner = half_m.component_mul(&Vector3::new(sign(0), sign(1), sign(2)));
            world_from_box * Point3::from(corner)
        };
        for i in 0..8usize {
            for bit in [1usize, 2, 4] {
                if i & bit == 0 {
                    self.segment(&corner(i), &corner(i | bit), colour);
                }
            }
        }
        let middle = self.camera.world_from_camera.inverse()
            * Point3::from(world_from_box.translation.vector);
        if middle.z > NEAR_M && !label.is_empty() {
            let [x, y] = self.camera.project(&middle);
            let (width, height) = (f64::from(self.camera.width), f64::from(self.camera.height));
            if (0.0..width).contains(&x) && (0.0..height).contains(&y) {
                self.text([x, y], label, colour);
            }
        }
    }

    /// A straight line in the world.
    fn segment(&mut self, from: &Point3<f64>, to: &Point3<f64>, colour: [u8; 3]) {
        let camera_from_world = self.camera.world_from_camera.inverse();
        let (mut a, mut b) = (camera_from_world * from, camera_from_world * to);
        if a.z < NEAR_M && b.z < NEAR_M {
            return;
        }
        let cut = |behind: Point3<f64>, before: Point3<f64>| {
            behind + (before - behind) * ((NEAR_M - behind.z) / (before.z - behind.z))
        };
        if a.z < NEAR_M {
            a = cut(a, b);
        } else if b.z < NEAR_M {
            b = cut(b, a);
        }
        self.stroke(self.camera.project(&a), self.camera.project(&b), colour);
    }

    /// A line of several points in the world.
    pub fn line_in_world(&mut self, points: &[Point3<f64>], counts: bool) {
        let colour = if counts { COLOURS[0] } else { IGNORED };
        for pair in points.windows(2) {
            self.segment(&pair[0], &pair[1], colour);
        }
    }

    /// A mask in the colour of its number.
    pub fn mask(&mut self, mask: &RunMask, number: usize, counts: bool) {
        let colour = if counts {
            COLOURS[number % COLOURS.len()]
        } else {
            IGNORED
        };
        let [width, height] = mask.size();
        let mut at = 0u64;
        for (i, run) in mask.runs().into_iter().enumerate() {
            let behind = at + u64::from(run);
            if i % 2 == 1 {
                for pixel in at..behind {
                    let (column, row) = (pixel / u64::from(height), pixel % u64::from(height));
                    if column < u64::from(width) {
                        self.tint(column as u32, row as u32, colour, 0.55);
                    }
                }
            }
            at = behind;
        }
    }

    /// Mixes a colour into a pixel of the frame.
    fn tint(&mut self, column: u32, row: u32, colour: [u8; 3], share: f32) {
        for y in row * self.zoom..(row + 1) * self.zoom {
            for x in column * self.zoom..(column + 1) * self.zoom {
                if let Some(Rgb(own)) = self.image.get_pixel_mut_checked(x, y) {
                    for (own, other) in own.iter_mut().zip(colour) {
                        let mixed = f32::from(*own) * (1.0 - share) + f32::from(other) * share;
                        *own = mixed as u8;
                    }
                }
            }
        }
    }

    /// Colours every pixel of the frame by a value of an image that may have another size.
    fn paint<T: Copy>(&mut self, of: &Pixels<T>, colour: impl Fn(T) -> [u8; 3]) {
        if of.width == 0 || of.height == 0 {
            return;
        }
        let (width, height) = (self.camera.width, self.camera.height);
        for row in 0..height {
            for column in 0..width {
                let x = u64::from(column) * u64::from(of.width) / u64::from(width);
                let y = u64::from(row) * u64::from(of.height) / u64::from(height);
                if let Some(value) = of.values.get((y * u64::from(of.width) + x) as usize) {
                    self.tint(column, row, colour(*value), 0.9);
                }
            }
        }
    }

    /// Depths or disparities.
    pub fn values(&mut self, of: &Pixels<f32>, scale: Scale) {
        self.paint(of, |value| {
            if !value.is_finite() || value <= 0.0 {
                return [0, 0, 0];
            }
            let share = match scale {
                Scale::Depth => 1.0 - ((value + 1.0).ln() / 81f32.ln()).clamp(0.0, 1.0),
                Scale::Disparity => (value / 64.0).clamp(0.0, 1.0).sqrt(),
            };
            heat(share)
        });
    }

    /// Classes by CARLA's colours.
    pub fn classes(&mut self, of: &Pixels<u8>) {
        self.paint(of, |class| {
            CLASSES
                .get(usize::from(class))
                .map_or([0, 0, 0], |info| info.rgb)
        });
    }

    /// Flow: direction as hue, length as strength (full at 20 pixels).
    pub fn flow(&mut self, of: &Pixels<[f32; 2]>) {
        self.paint(of, |[x, y]| {
            if !x.is_finite() || !y.is_finite() {
                return [0, 0, 0];
            }
            let hue = (y.atan2(x) / std::f32::consts::TAU).rem_euclid(1.0) * 6.0;
            let strength = (x.hypot(y) / 20.0).clamp(0.0, 1.0).sqrt();
            let part = |offset: f32| {
                let at = (hue + offset).rem_euclid(6.0);
                let full = (2.0 - (at - 2.0).abs()).clamp(0.0, 1.0);
                ((1.0 - strength * (1.0 - full)) * 255.0) as u8
            };
            [part(2.0), part(0.0), part(4.0)]
        });
    }
}

/// A share of 0..=1 from dark violet over red to bright yellow.
fn heat(share: f32) -> [u8; 3] {
    let stops = [
        [20.0, 10.0, 50.0],
        [120.0, 30.0, 110.0],
        [230.0, 80.0, 60.0],
        [250.0, 240.0, 120.0],
    ];
    let at = share * 3.0;
    let low = (at as usize).min(2);
    let rest = at - low as f32;
    std::array::from_fn(|i| (stops[low][i] * (1.0 - rest) + stops[low + 1][i] * rest) as u8)
}

#[cfg(test)]
mod tests {
    use schema_frames::{FrameHeader, Modality};

    use super::*;

    fn grey() -> Picture {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(60, 40);
        header.intrinsics_px = [30.0, 30.0, 30.0, 20.0];
        Picture::of(&TickFrame {
            topic: "ego/front/rgb".into(),
            modality: Modality::Rgb,
            payload: vec![99; header.payload_bytes as usize],
            header,
        })
    }

    #[test]
    fn a_rectangle_changes_its_edges_and_not_its_inside() {
        let mut picture = grey();
        picture.rectangle([10.0, 20.0], [30.0, 35.0], true, "");
        let at = |picture: &Picture, x: u32, y: u32| *picture.image.get_pixel(x * 6, y * 6);
        assert_ne!(at(&picture, 10, 25), Rgb([99; 3]));
        assert_ne!(at(&picture, 20, 20), Rgb([99; 3]));
        assert_eq!(at(&picture, 20, 28), Rgb([99; 3]));
        let jpeg = picture.jpeg().expect("a picture of a frame");
        assert_eq!(jpeg[..2], [0xff, 0xd8]);
    }

    #[test]
    fn nothing_that_lies_outside_or_is_not_finite_draws_or_panics() {
        let mut picture = grey();
        let before = picture.image.clone();
        picture.rectangle([f64::NAN; 2], [1e300; 2], true, "");
        picture.rectangle([-500.0, -500.0], [-400.0, -300.0], true, "");
        let behind = Isometry3::translation(-50.0, 0.0, 0.0);
        picture.cuboid(&behind, Vector3::repeat(1.0), true, "car 0.5");
        assert_eq!(picture.image, before);
        // A box that reaches from behind the camera to the front is cut.
        let through = Isometry3::translation(1.0, 0.0, 0.0);
        picture.cuboid(&through, Vector3::new(5.0, 0.4, 0.4), true, "");
        assert_ne!(picture.image, before);
        let odd = Pixels {
            width: 7,
            height: 3,
            values: vec![f32::NAN; 4],
        };
        picture.values(&odd, Scale::Depth);
    }
}
