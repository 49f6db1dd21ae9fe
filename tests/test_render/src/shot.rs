//! One view of a scene into plain memory.

use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Output, Place, View, ViewJob};
use sensor_core::Scene;

/// What a view shows of a scene, for each modality its bytes.
pub fn shot(
    renderer: &mut CameraRenderer,
    scene: &Scene,
    view: &mut View,
    world_from_sensor: Isometry3<f64>,
    modalities: &[Modality],
) -> Vec<Vec<u8>> {
    let mut bytes: Vec<Vec<u8>> = modalities
        .iter()
        .map(|modality| vec![0xa5; view.payload_bytes(*modality)])
        .collect();
    let outputs = modalities
        .iter()
        .zip(&mut bytes)
        .map(|(modality, bytes)| Output {
            modality: *modality,
            place: Place::Memory(bytes),
        })
        .collect();
    let job = ViewJob {
        view,
        world_from_sensor,
        outputs,
    };
    renderer
        .render(scene, vec![job])
        .expect("the request is in order")
        .wait()
        .expect("the device works");
    bytes
}
