//! Rendered input of event cameras, for the examples that feed them.

use schema_frames::Modality;
use sensor_camera::dvs::{EventImages, Rows};
use sensor_camera::{CameraRenderer, Quality};

use crate::common;

/// Images of one firing in memory.
pub struct Shot {
    pub luminance: Vec<u8>,
    pub flow: Vec<u8>,
    pub depth: Vec<u8>,
    pub instance: Vec<u8>,
    pub class: Vec<u8>,
}

impl Shot {
    pub fn images(&self, width: usize) -> EventImages<'_> {
        EventImages {
            luminance: Rows::tight(&self.luminance, 4 * width),
            flow: Rows::tight(&self.flow, 8 * width),
            depth: Rows::tight(&self.depth, 4 * width),
            instance: Rows::tight(&self.instance, 4 * width),
            class: Rows::tight(&self.class, width),
        }
    }
}

/// Firings along the test street at these places and times; luminance is taken from the green
/// channel.
pub fn drive(size_px: [u32; 2], moments: impl Iterator<Item = (f64, u64)>) -> Vec<Shot> {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let (assets, car) = common::street();
    let mut view = common::view(&gpu, size_px[0], size_px[1]);
    let asked = [
        Modality::Rgb,
        Modality::Flow,
        Modality::Depth,
        Modality::Instance,
        Modality::Semantic,
    ];
    let shot = |(x_m, sim_nanos): (f64, u64)| {
        let cars = (0..8)
            .map(|i| {
                common::moving(
                    20 + i,
                    car,
                    common::pose(x_m * 1.1 + 9.0 * i as f64, -2.0, 0.0, [0.0; 3]),
                )
            })
            .collect();
        let scene = common::scene(&assets, cars, sim_nanos);
        let mut frames = common::render(
            &mut renderer,
            &scene,
            &mut view,
            common::pose(x_m - 60.0, -2.0, 1.6, [0.0, 0.035, 0.0]),
            &asked,
        );
        let mut take = |modality| frames.remove(&modality).expect("asked for").0;
        let rgb = take(Modality::Rgb);
        let linear = |value: u8| ((value as f32 / 255.0 + 0.055) / 1.055).powf(2.4);
        Shot {
            luminance: rgb
                .chunks_exact(4)
                .flat_map(|pixel| linear(pixel[1]).to_le_bytes())
                .collect(),
            flow: take(Modality::Flow),
            depth: take(Modality::Depth),
            instance: take(Modality::Instance),
            class: take(Modality::Semantic),
        }
    };
    moments.map(shot).collect()
}
