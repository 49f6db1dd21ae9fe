//! Views drawn both by the renderer on the adapter, at low quality, and in tiles on the processor.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_camera::{
    CameraRenderer, Output, Place, Quality, Rasteriser, TileCamera, TileImages, TileRenderer, View,
    ViewJob, ViewSpec,
};
use sensor_core::Scene;
use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

/// Both renderers, with a camera each.
pub struct Both {
    renderer: CameraRenderer,
    view: View,
    tiles: TileRenderer,
    camera: TileCamera,
}

/// How far two colour images differ, over their bytes for red, green and blue.
#[derive(Clone, Copy, Debug, Default)]
pub struct ColorDifference {
    /// Mean difference.
    pub mean: f64,
    /// Share of pixels of which a byte differs by more than 8.
    pub far_ratio: f64,
}

impl Both {
    /// Both with a camera that has this lens; the adapter draws by this rasteriser.
    pub fn new(gpu: &Gpu, rasteriser: Rasteriser, lens: Intrinsics) -> Both {
        Both {
            renderer: CameraRenderer::with_rasteriser(gpu, Quality::Low, rasteriser),
            view: View::new(gpu, ViewSpec::pinhole(lens)),
            tiles: TileRenderer::default(),
            camera: TileCamera::new(lens),
        }
    }

    /// The images of a firing, the adapter's first.
    pub fn draw(
        &mut self,
        scene: &Scene,
        world_from_sensor: Isometry3<f64>,
        modalities: &[Modality],
    ) -> (BTreeMap<Modality, Vec<u8>>, TileImages) {
        let mut bytes: Vec<Vec<u8>> = modalities
            .iter()
            .map(|modality| vec![0; self.view.payload_bytes(*modality)])
            .collect();
        let outputs = modalities.iter().zip(&mut bytes);
        let outputs = outputs.map(|(modality, bytes)| Output {
            modality: *modality,
            place: Place::Memory(bytes),
        });
        let job = ViewJob {
            view: &mut self.view,
            world_from_sensor,
            outputs: outputs.collect(),
        };
        let submission = self.renderer.render(scene, vec![job]);
        submission
            .expect("cameras make these modalities")
            .wait()
            .expect("the adapter works");
        let mut images = TileImages::default();
        self.tiles.render(
            scene,
            &mut self.camera,
            &world_from_sensor,
            modalities,
            &mut images,
        );
        (modalities.iter().copied().zip(bytes).collect(), images)
    }
}

impl ColorDifference {
    /// Between images with bytes B, G, R, A.
    pub fn of(bytes: &[u8], color: &[u32]) -> ColorDifference {
        assert_eq!(bytes.len(), 4 * color.len(), "images of one size");
        let (mut sum, mut n_far) = (0u64, 0);
        for (expected, found) in bytes.as_chunks::<4>().0.iter().zip(color) {
            let found = found.to_le_bytes();
            let apart: [u8; 3] = std::array::from_fn(|i| expected[i].abs_diff(found[i]));
            sum += apart.iter().map(|x| *x as u64).sum::<u64>();
            n_far += usize::from(apart.iter().any(|x| *x > 8));
        }
        ColorDifference {
            mean: sum as f64 / (3 * color.len()) as f64,
            far_ratio: n_far as f64 / color.len() as f64,
        }
    }
}
