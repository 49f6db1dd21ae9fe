//! Shadows lie where the sun puts them: near the camera in the near map, and far from it in the far
//! map, also with the smaller maps of small images.

use crate::common;

use std::sync::Arc;

use schema_frames::Modality;
use schema_types::Class;
use sensor_camera::{CameraRenderer, Quality};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets};

/// Ground of 300 m with a tower in its middle, 20 m wide and 60 m high.
fn tower(x_m: f64, y_m: f64) -> Arc<SceneAssets> {
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let grey = Surface::new(Class::GROUND, Material::Cloth, [128; 3]);
    let mut ground = MeshBuilder::new("ground");
    ground.quad(
        grey,
        [
            [-150.0, -150.0, 0.0],
            [150.0, -150.0, 0.0],
            [150.0, 150.0, 0.0],
            [-150.0, 150.0, 0.0],
        ],
        [[0.0; 2]; 4],
    );
    for mesh in [
        ground.finish(),
        common::cuboid("tower", grey, [0.0, 0.0, 30.0], [10.0, 10.0, 30.0]),
    ] {
        let mesh = assets.add_mesh(mesh);
        assets
            .statics
            .push(common::fixed(mesh, common::pose(x_m, y_m, 0.0, [0.0; 3])));
    }
    Arc::new(assets)
}

/// From 150 m above, straight down: x runs up the image, y to the left, `size_px` pixels are 300 m.
#[test]
fn far_shadows_lie_away_from_the_sun_in_pictures_of_any_size() {
    let gpu = common::gpu();
    let places = [(0.0, 0.0), (700.0, -300.0), (-450.0, 1200.0)];
    for rasteriser in common::rasterisers(&gpu) {
        for (size_px, (x_m, y_m)) in [64, 160, 640]
            .into_iter()
            .flat_map(|size_px| places.map(|place| (size_px, place)))
        {
            let mut renderer = CameraRenderer::with_rasteriser(&gpu, Quality::High, rasteriser);
            let mut view = common::view(&gpu, size_px, size_px);
            let mut scene = common::scene(&tower(x_m, y_m), vec![], 50_000_000);
            (
                scene.weather.sun_azimuth_deg,
                scene.weather.sun_altitude_deg,
                scene.weather.cloudiness,
            ) = (0.0, 45.0, 0.0);
            let eye = common::pose(x_m, y_m, 150.0, [0.0, 90.0, 0.0]);
            let frames = common::render(&mut renderer, &scene, &mut view, eye, &[Modality::Rgb]);
            let bytes = &frames[&Modality::Rgb].0;
            let pixel = |along_m: f64| (f64::from(size_px) * (0.5 - along_m / 300.0)) as usize;
            let green_at = |x_m: f64, y_m: f64| {
                bytes[4 * (pixel(x_m) * size_px as usize + pixel(y_m)) + 1] as i32
            };
            // The sun stands towards +x at 45 degrees: 60 m of tower throw 60 m of shadow towards
            // -x, from the tower's far side on.
            let shade = [-25.0, -40.0, -55.0].map(|x| green_at(x, 0.0));
            let lit = [
                (40.0, 0.0),
                (90.0, 0.0),
                (-90.0, 0.0),
                (-40.0, 30.0),
                (-40.0, -30.0),
                (0.0, 60.0),
                (0.0, -100.0),
                (120.0, 120.0),
            ];
            let lit = lit.map(|(x, y)| green_at(x, y));
            let (darkest, brightest) = (*lit.iter().min().unwrap(), *shade.iter().max().unwrap());
            assert!(
                darkest > brightest + 40,
                "{rasteriser:?}, {size_px} px, at {x_m}, {y_m}: {shade:?} in the shade, {lit:?} in the light"
            );
        }
    }
}
