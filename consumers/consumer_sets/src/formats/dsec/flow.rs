//! Optical flow in DSEC's form: 16-bit images with x, y and a flag.

use consumer_truth::ticks::TickFrame;

/// Steps of a pixel in the images.
const STEPS_PER_PX: f64 = 128.0;
/// Number of no motion.
const ZERO: f64 = 32768.0;

/// Flow of every pixel: x, y in pixels, or `None` where it is unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    width: usize,
    pixels: Vec<Option<[f32; 2]>>,
}

impl Flow {
    /// From each pixel of this frame to where its point was at the frame before: the negative of
    /// what the sensor says.
    pub fn backward(frame: &TickFrame) -> Flow {
        let pixels = frame
            .elements::<[f32; 2]>()
            .iter()
            .map(|[x, y]| Some([-x, -y]))
            .collect();
        Flow {
            width: frame.header.width as usize,
            pixels,
        }
    }

    /// From the pixels of the frame before to this one: each point is followed back to the pixel
    /// that it came from. Where several came from one pixel the nearest counts (by `depth_m`, if it
    /// is there), where none did the flow is unknown.
    pub fn forward(&self, depth_m: Option<&[f32]>) -> Flow {
        let (width, height) = (self.width, self.pixels.len() / self.width.max(1));
        let mut pixels = vec![None; self.pixels.len()];
        let mut nearest_m = vec![f32::INFINITY; self.pixels.len()];
        for (at, flow) in self.pixels.iter().enumerate() {
            let Some([x, y]) = *flow else { continue };
            let (column, row) = ((at % width) as f32, (at / width) as f32);
            let (column, row) = ((column + x).round(), (row + y).round());
            let is_inside =
                (0.0..width as f32).contains(&column) && (0.0..height as f32).contains(&row);
            if !is_inside {
                continue;
            }
            let from = row as usize * width + column as usize;
            let depth = depth_m.and_then(|depth| depth.get(at)).copied();
            let depth = depth.unwrap_or(f32::MAX).min(f32::MAX);
            if depth < nearest_m[from] {
                nearest_m[from] = depth;
                pixels[from] = Some([-x, -y]);
            }
        }
        Flow { width, pixels }
    }

    /// Three 16-bit numbers per pixel: x and y in steps of 1/128 pixel about 32768, and 1 where the
    /// flow is known. Motion of 256 pixels or more does not fit and counts as unknown.
    pub fn rgb16(&self) -> Vec<[u16; 3]> {
        let steps = |px: f32| (f64::from(px) * STEPS_PER_PX + ZERO).round();
        let range = 0.0..=f64::from(u16::MAX);
        self.pixels
            .iter()
            .map(|pixel| match pixel {
                Some([x, y]) if range.contains(&steps(*x)) && range.contains(&steps(*y)) => {
                    [steps(*x) as u16, steps(*y) as u16, 1]
                }
                _ => [0; 3],
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::{FrameHeader, Modality};

    fn frame(width: u32, flow: &[[f32; 2]]) -> TickFrame {
        let mut header = FrameHeader::new(Modality::Flow);
        header.set_image(width, flow.len() as u32 / width);
        TickFrame {
            topic: "ego/front/flow".into(),
            modality: Modality::Flow,
            header,
            payload: bytemuck::cast_slice(flow).to_vec(),
        }
    }

    #[test]
    fn backward_is_the_negative_and_forward_starts_where_the_point_was() {
        // The point at column 3 came from column 1; the others stood still.
        let flow = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [2.0, 0.0]];
        let backward = Flow::backward(&frame(4, &flow));
        assert_eq!(backward.pixels[3], Some([-2.0, -0.0]));
        assert_eq!(backward.rgb16()[3], [32768 - 256, 32768, 1]);
        let near_last = backward.forward(Some(&[9.0, 9.0, 9.0, 1.0]));
        assert_eq!(
            near_last.pixels[1],
            Some([2.0, 0.0]),
            "the nearer hides the other"
        );
        assert_eq!(near_last.pixels[3], None, "nothing came from there");
        let far_last = backward.forward(Some(&[9.0, 9.0, 9.0, 20.0]));
        assert_eq!(far_last.pixels[1], Some([0.0, 0.0]));
        assert_eq!(near_last.rgb16()[3], [0; 3]);
    }

    #[test]
    fn motion_that_does_not_fit_is_unknown() {
        let backward = Flow::backward(&frame(2, &[[300.0, 0.0], [-255.0, 0.0]]));
        assert_eq!(backward.rgb16(), [[0; 3], [32768 + 255 * 128, 32768, 1]]);
    }
}
