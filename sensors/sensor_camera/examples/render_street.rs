//! Draws the test street and writes every modality as PNG files: `cargo run --release --example
//! render_street -- OUT_DIR [WEATHER [high|low]]`.
//!
//! WEATHER is `noon` (default), `evening`, `night`, `overcast`, `fog` or `rain`.

#[path = "../tests/it/common.rs"]
mod common;

use std::path::Path;

use schema_frames::Modality;
use schema_frames::document::Weather;
use sensor_camera::{CameraRenderer, Quality};

const SIZE_PX: [u32; 2] = [960, 600];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = arguments
        .first()
        .map_or("target/pictures", |text| text.as_str());
    let name = arguments.get(1).map_or("noon", |text| text.as_str());
    std::fs::create_dir_all(folder).expect("the folder can be made");
    let gpu = common::gpu();
    let quality = match arguments.get(2).map(|text| text.as_str()) {
        Some("high") => Quality::High,
        Some("low") => Quality::Low,
        _ => Quality::default_for(&gpu),
    };
    let mut renderer = CameraRenderer::new(&gpu, quality);
    let (assets, car) = common::street();
    let mut view = common::view(&gpu, SIZE_PX[0], SIZE_PX[1]);
    let modalities = [
        Modality::Rgb,
        Modality::Depth,
        Modality::Semantic,
        Modality::Flow,
        Modality::Normals,
        Modality::Dvs,
    ];
    let mut frames = Default::default();
    for step in 0..3u64 {
        let x = step as f64 * 0.5;
        let mut cars = vec![
            common::moving(11, car, common::pose(14.0 + 0.4 * x, -2.2, 0.0, [0.0; 3])),
            common::moving(12, car, common::pose(22.0 - x, 2.4, 0.0, [0.0, 0.0, 180.0])),
        ];
        cars[1].tint_rgb = [30, 60, 130];
        cars.iter_mut().for_each(|car| car.lamps = 3);
        let mut scene = common::scene(&assets, cars, (step + 1) * 50_000_000);
        scene.weather = weather(name);
        frames = common::render(
            &mut renderer,
            &scene,
            &mut view,
            common::pose(x, -2.0, 1.5, [0.0, 2.0, 0.0]),
            &modalities,
        );
    }
    for (modality, (bytes, _)) in &frames {
        let rgb: Vec<u8> = match modality {
            Modality::Rgb => bytes
                .chunks_exact(4)
                .flat_map(|p| [p[2], p[1], p[0]])
                .collect(),
            Modality::Depth => common::floats(bytes)
                .iter()
                .flat_map(|d| [(255.0 / (1.0 + 0.05 * d)) as u8; 3])
                .collect(),
            Modality::Semantic => bytes
                .iter()
                .flat_map(|c| {
                    schema_types::Class(*c)
                        .info()
                        .map_or([0; 3], |info| info.rgb)
                })
                .collect(),
            Modality::Flow => common::floats(bytes)
                .chunks_exact(2)
                .flat_map(|f| [(128.0 + 2.0 * f[0]) as u8, (128.0 + 2.0 * f[1]) as u8, 128])
                .collect(),
            Modality::Dvs => events(bytes),
            _ => continue,
        };
        write(
            &Path::new(folder).join(format!("{name}_{}.png", modality.name())),
            &rgb,
        );
    }
}

fn events(bytes: &[u8]) -> Vec<u8> {
    let mut rgb = vec![20; (SIZE_PX[0] * SIZE_PX[1] * 3) as usize];
    for event in bytes.chunks_exact(16) {
        let event: schema_frames::DvsEvent = bytemuck::pod_read_unaligned(event);
        let i = (event.y_px as usize * SIZE_PX[0] as usize + event.x_px as usize) * 3;
        rgb[i..i + 3].copy_from_slice(if event.polarity == 1 {
            &[90, 160, 255]
        } else {
            &[255, 90, 70]
        });
    }
    rgb
}

fn weather(name: &str) -> Weather {
    let clear = Weather::default();
    match name {
        "evening" => Weather {
            sun_altitude_deg: 7.0,
            sun_azimuth_deg: 35.0,
            cloudiness: 35.0,
            ..clear
        },
        "night" => Weather {
            sun_altitude_deg: -20.0,
            ..clear
        },
        "overcast" => Weather {
            cloudiness: 95.0,
            ..clear
        },
        "fog" => Weather {
            fog_density: 60.0,
            cloudiness: 60.0,
            ..clear
        },
        "rain" => Weather {
            cloudiness: 90.0,
            precipitation: 70.0,
            wetness: 80.0,
            ..clear
        },
        _ => clear,
    }
}

fn write(path: &Path, rgb: &[u8]) {
    let file = std::fs::File::create(path).expect("the file can be made");
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), SIZE_PX[0], SIZE_PX[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(rgb))
        .expect("the picture can be written");
}
