//! Effects of weather on images, field by field: changes go in the direction that physics demands,
//! and other modalities stay untouched.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::Modality;
use schema_frames::document::Weather;
use sensor_camera::{CameraRenderer, Quality, View, ViewSpec};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::{Intrinsics, OpticsSpec};
use test_render::{Stage, shot};

const SIZE_PX: [u32; 2] = [160, 120];

struct Eye {
    gpu: Gpu,
    renderer: CameraRenderer,
    stage: Stage,
}

/// Linear light R G B, and the bytes of depth, class, id and normals.
struct Seen {
    rgb: Vec<Vector3<f64>>,
    labels: Vec<Vec<u8>>,
}

impl Eye {
    fn new(quality: Quality) -> Eye {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap();
        Eye {
            renderer: CameraRenderer::new(&gpu, quality),
            gpu,
            stage: Stage::new("Town07", 3, 0).unwrap(),
        }
    }

    /// From 60 m above the ground towards this azimuth and altitude.
    fn look(&mut self, weather: Weather, azimuth_deg: f64, altitude_deg: f64) -> Seen {
        let turn = UnitQuaternion::from_euler_angles(
            0.0,
            -altitude_deg.to_radians(),
            azimuth_deg.to_radians(),
        );
        let place = self.stage.places[0].translation.vector + Vector3::new(0.0, 0.0, 60.0);
        let world_from_sensor = Isometry3::from_parts(Translation3::from(place), turn);
        let lens = Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], 40f64.to_radians());
        // Two stops darker, so that hardly anything is clipped.
        let mut optics = OpticsSpec {
            postprocess: false,
            ..OpticsSpec::default()
        };
        optics.exposure.compensation_ev = -2.0;
        let mut view = View::new(
            &self.gpu,
            ViewSpec {
                optics,
                ..ViewSpec::pinhole(lens)
            },
        );
        let modalities = [
            Modality::Rgb,
            Modality::Depth,
            Modality::Semantic,
            Modality::Instance,
            Modality::Normals,
        ];
        let scene = self.stage.scene(weather);
        let mut bytes = shot(
            &mut self.renderer,
            &scene,
            &mut view,
            world_from_sensor,
            &modalities,
        );
        let light = |byte: u8| (f64::from(byte) / 255.0).powf(2.2);
        let rgb = bytes
            .remove(0)
            .chunks_exact(4)
            .map(|p| Vector3::new(light(p[2]), light(p[1]), light(p[0])))
            .collect();
        Seen { rgb, labels: bytes }
    }
}

impl Seen {
    fn middle(&self) -> Vector3<f64> {
        self.at(SIZE_PX[0] as usize / 2, SIZE_PX[1] as usize / 2)
    }

    /// Mean of 5 × 5 pixels.
    fn at(&self, x: usize, y: usize) -> Vector3<f64> {
        let pixel = |k: usize| self.rgb[(y + k / 5 - 2) * SIZE_PX[0] as usize + x + k % 5 - 2];
        (0..25).map(pixel).sum::<Vector3<f64>>() / 25.0
    }
}

fn clear() -> Weather {
    Weather {
        cloudiness: 0.0,
        sun_azimuth_deg: 0.0,
        sun_altitude_deg: 30.0,
        ..Weather::default()
    }
}

#[test]
fn every_field_of_the_air_acts_the_way_it_should_and_changes_colours_only() {
    for quality in [Quality::Low, Quality::High] {
        let mut eye = Eye::new(quality);
        let usual = clear();
        let mut pair = |a: Weather, b: Weather, azimuth_deg: f64, altitude_deg: f64| {
            let (a, b) = (
                eye.look(a, azimuth_deg, altitude_deg),
                eye.look(b, azimuth_deg, altitude_deg),
            );
            assert!(
                a.labels == b.labels,
                "weather changes depth, classes, ids or normals"
            );
            (a, b)
        };
        // Fewer molecules: a darker sky; many more: a whiter one (scattering saturates in blue
        // first).
        let (blue, dark) = pair(
            usual,
            Weather {
                rayleigh_scattering_scale: 0.005,
                ..usual
            },
            140.0,
            45.0,
        );
        assert!(
            dark.middle().z < 0.3 * blue.middle().z,
            "{quality:?}: {} {}",
            blue.middle(),
            dark.middle()
        );
        let (_, white) = pair(
            usual,
            Weather {
                rayleigh_scattering_scale: 0.1,
                ..usual
            },
            140.0,
            45.0,
        );
        let blueness = |seen: &Seen| seen.middle().z / seen.middle().x;
        assert!(
            blueness(&white) < 0.9 * blueness(&blue),
            "{quality:?}: {} {}",
            blueness(&blue),
            blueness(&white)
        );
        // Haze: a glow about the sun, and none on the other side.
        let hazy = Weather {
            mie_scattering_scale: 0.3,
            ..usual
        };
        let (plain, glow) = pair(usual, hazy, 12.0, 38.0);
        let near = glow.middle().y - plain.middle().y;
        let (plain, glow) = pair(usual, hazy, 170.0, 38.0);
        let far = glow.middle().y - plain.middle().y;
        assert!(
            near > 0.012 && far < 0.3 * near,
            "{quality:?}: {near} near the sun, {far} away from it"
        );
        // Fog that scatters: brighter towards the sun only.
        let fog = Weather {
            fog_density: 35.0,
            fog_falloff: 0.0,
            scattering_intensity: 0.0,
            ..usual
        };
        let (plain, lit) = pair(
            fog,
            Weather {
                scattering_intensity: 3.0,
                ..fog
            },
            0.0,
            0.0,
        );
        assert!(
            lit.middle().y > 1.15 * plain.middle().y,
            "{quality:?}: {} {}",
            plain.middle(),
            lit.middle()
        );
        let (plain, lit) = pair(
            fog,
            Weather {
                scattering_intensity: 3.0,
                ..fog
            },
            180.0,
            0.0,
        );
        assert!(
            (lit.middle().y - plain.middle().y).abs() < 2e-3,
            "{quality:?}: {} {}",
            plain.middle(),
            lit.middle()
        );
        // Dust: brown, and the distance fades.
        let (plain, dust) = pair(
            usual,
            Weather {
                dust_storm: 100.0,
                ..usual
            },
            90.0,
            -6.0,
        );
        assert!(
            dust.middle().x > 1.4 * dust.middle().z,
            "{quality:?}: dust is brown: {}",
            dust.middle()
        );
        let contrast = |seen: &Seen| {
            let row: Vec<f64> = (5..155)
                .map(|x| seen.rgb[70 * SIZE_PX[0] as usize + x].y)
                .collect();
            row.iter().copied().fold(0.0, f64::max) - row.iter().copied().fold(1.0, f64::min)
        };
        assert!(
            contrast(&dust) < 0.3 * contrast(&plain),
            "{quality:?}: {} {}",
            contrast(&plain),
            contrast(&dust)
        );
        // Night: a moon opposite the sun, behind clouds where there are any.
        let night = Weather {
            sun_altitude_deg: -40.0,
            ..usual
        };
        let (sky, _) = pair(night, night, 180.0, 40.0);
        assert!(
            sky.middle().min() > 0.1,
            "{quality:?}: the moon is white: {}",
            sky.middle()
        );
        assert!(
            sky.at(20, 20).max() < 0.02,
            "{quality:?}: and the sky is dark: {}",
            sky.at(20, 20)
        );
        let (_, hidden) = pair(
            night,
            Weather {
                cloudiness: 100.0,
                ..night
            },
            180.0,
            40.0,
        );
        assert!(
            hidden.middle().max() < 0.5 * sky.middle().max(),
            "{quality:?}: clouds hide it: {}",
            hidden.middle()
        );
    }
}
