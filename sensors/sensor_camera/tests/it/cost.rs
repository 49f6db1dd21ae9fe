//! Outputs without readers cost nothing, outputs that are read together are drawn once, and the
//! same input gives the same bytes.

use crate::common;

use std::collections::BTreeMap;

use schema_frames::Modality;
use sensor_camera::{CameraRenderer, Output, Place, Quality, Rasteriser, RenderError, ViewJob};
use sensor_gpu::Counts;
use sensor_gpu::Gpu;

const ALL: [Modality; 7] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
    Modality::Dvs,
];

#[test]
fn view_without_readers_draws_nothing() {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let (assets, _) = common::street();
    let mut view = common::view(&gpu, 64, 48);
    let before = gpu.counters().counts();
    for nanos in [50_000_000, 100_000_000] {
        let scene = common::scene(&assets, vec![], nanos);
        let job = ViewJob {
            view: &mut view,
            world_from_sensor: common::pose(0.0, 0.0, 1.5, [0.0; 3]),
            outputs: vec![],
        };
        let submission = renderer.render(&scene, vec![job]).unwrap();
        assert!(submission.is_empty());
        assert!(submission.wait().unwrap()[0].outputs.is_empty());
    }
    assert_eq!(gpu.counters().counts().since(before), Counts::default());
}

/// What cameras of these sizes cost in one tick.
fn cost_of(gpu: &Gpu, sizes_px: &[[u32; 2]]) -> Counts {
    let mut renderer = CameraRenderer::new(gpu, Quality::Low);
    let (assets, _) = common::street();
    let scene = common::scene(&assets, vec![], 50_000_000);
    let mut views: Vec<_> = sizes_px
        .iter()
        .map(|[width, height]| common::view(gpu, *width, *height))
        .collect();
    let mut memory: Vec<Vec<Vec<u8>>> = views
        .iter()
        .map(|v| {
            [Modality::Depth, Modality::Semantic]
                .iter()
                .map(|m| vec![0; v.payload_bytes(*m)])
                .collect()
        })
        .collect();
    let before = gpu.counters().counts();
    let jobs = views.iter_mut().zip(&mut memory).map(|(view, memory)| {
        let outputs = [Modality::Depth, Modality::Semantic]
            .into_iter()
            .zip(memory);
        let outputs = outputs
            .map(|(modality, bytes)| Output {
                modality,
                place: Place::Memory(bytes),
            })
            .collect();
        let width_px = view.intrinsics().width_px;
        ViewJob {
            view,
            world_from_sensor: common::pose(width_px as f64 * 0.01, 0.0, 1.5, [0.0; 3]),
            outputs,
        }
    });
    let results = renderer
        .render(&scene, jobs.collect())
        .unwrap()
        .wait()
        .unwrap();
    assert_eq!(results.len(), sizes_px.len());
    gpu.counters().counts().since(before)
}

/// Goal: one submission for all views, with no more passes than each view needs by itself; computed
/// views together need no more passes than one.
#[test]
fn all_views_of_a_tick_are_drawn_in_one_submission() {
    let gpu = common::gpu();
    let sizes_px = [[64, 48], [80, 60], [32, 32]];
    let together = cost_of(&gpu, &sizes_px);
    let alone = sizes_px.map(|size_px| cost_of(&gpu, &[size_px]));
    let n_passes = match Rasteriser::default_for(&gpu) {
        Rasteriser::Drawn => alone.iter().map(|counts| counts.passes).sum(),
        Rasteriser::Computed => alone[0].passes,
    };
    assert_eq!(
        (together.passes, together.copies, together.submissions),
        (n_passes, 6, 1)
    );
    assert_eq!(
        together.draws,
        alone.iter().map(|counts| counts.draws).sum::<u64>()
    );
}

/// Goal: cameras of equal pose, lens and history are drawn once, and get the bytes they would get
/// alone.
#[test]
fn sensors_that_see_the_same_are_drawn_once() {
    let gpu = common::gpu();
    let (assets, car) = common::street();
    let run = |groups: &[&[Modality]]| {
        let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
        let mut views: Vec<_> = groups.iter().map(|_| common::view(&gpu, 96, 64)).collect();
        let mut memory: Vec<Vec<Vec<u8>>> = groups
            .iter()
            .map(|list| {
                list.iter()
                    .map(|m| vec![0; views[0].payload_bytes(*m)])
                    .collect()
            })
            .collect();
        let mut passes = 0;
        for step in 1..3u64 {
            let cars = vec![common::moving(
                5,
                car,
                common::pose(8.0 + step as f64, -2.0, 0.0, [0.0; 3]),
            )];
            let mut scene = common::scene(&assets, cars, step * 50_000_000);
            scene.weather.cloudiness = 100.0;
            let jobs =
                views
                    .iter_mut()
                    .zip(&mut memory)
                    .zip(groups)
                    .map(|((view, memory), list)| {
                        let outputs = list
                            .iter()
                            .zip(memory)
                            .map(|(m, bytes)| Output {
                                modality: *m,
                                place: Place::Memory(bytes),
                            })
                            .collect();
                        ViewJob {
                            view,
                            world_from_sensor: common::pose(0.3 * step as f64, -1.0, 1.5, [0.0; 3]),
                            outputs,
                        }
                    });
            let before = gpu.counters().counts();
            renderer
                .render(&scene, jobs.collect())
                .unwrap()
                .wait()
                .unwrap();
            passes = gpu.counters().counts().since(before).passes;
        }
        (memory.concat(), passes)
    };
    let together = run(&[
        &[Modality::Rgb],
        &[Modality::Depth, Modality::Flow],
        &[Modality::Rgb, Modality::Instance],
    ]);
    let alone = [
        &[Modality::Rgb][..],
        &[Modality::Depth, Modality::Flow],
        &[Modality::Rgb, Modality::Instance],
    ]
    .map(|list| run(&[list]));
    assert_eq!(
        together.1,
        run(&[&[
            Modality::Rgb,
            Modality::Depth,
            Modality::Flow,
            Modality::Instance
        ]])
        .1
    );
    assert!(together.0 == alone.map(|(bytes, _)| bytes).concat());
}

#[test]
fn readers_change_no_ones_bytes_and_runs_repeat() {
    let gpu = common::gpu();
    for rasteriser in common::rasterisers(&gpu) {
        readers_change_nothing(&gpu, Quality::Low, rasteriser);
        readers_change_nothing(&gpu, Quality::High, rasteriser);
    }
}

fn readers_change_nothing(gpu: &Gpu, quality: Quality, rasteriser: Rasteriser) {
    let (assets, car) = common::street();
    let run = |modalities: &[Modality]| {
        let mut renderer = CameraRenderer::with_rasteriser(gpu, quality, rasteriser);
        let mut view = common::view(gpu, 96, 64);
        let mut frames = BTreeMap::new();
        for step in 1..5u64 {
            let scene = common::scene(
                &assets,
                vec![common::moving(
                    5,
                    car,
                    common::pose(8.0 + step as f64, -2.0, 0.0, [0.0; 3]),
                )],
                step * 50_000_000,
            );
            let pose = common::pose(0.3 * step as f64, -1.0, 1.5, [0.0, 1.0, step as f64]);
            frames = common::render(&mut renderer, &scene, &mut view, pose, modalities);
        }
        frames
    };
    let (first, second) = (run(&ALL), run(&ALL));
    assert_eq!(first, second);
    assert!(first[&Modality::Dvs].1.n_bytes > 0);
    for modality in ALL {
        assert!(
            run(&[modality])[&modality].0 == first[&modality].0,
            "{modality:?} depends on other readers"
        );
    }
}

#[test]
fn wrong_requests_are_refused_with_a_sentence() {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let (assets, _) = common::street();
    let scene = common::scene(&assets, vec![], 50_000_000);
    let mut view = common::view(&gpu, 64, 48);
    let mut ask = |modalities: &[Modality], n_bytes: usize| {
        let mut memory = vec![vec![0u8; n_bytes]; modalities.len()];
        let outputs = modalities
            .iter()
            .zip(&mut memory)
            .map(|(m, bytes)| Output {
                modality: *m,
                place: Place::Memory(bytes),
            })
            .collect();
        let job = ViewJob {
            view: &mut view,
            world_from_sensor: common::pose(0.0, 0.0, 1.5, [0.0; 3]),
            outputs,
        };
        renderer
            .render(&scene, vec![job])
            .map(|submission| submission.wait().unwrap())
            .unwrap_err()
    };
    assert_eq!(
        ask(&[Modality::Lidar], 100_000),
        RenderError::NotACamera {
            modality: Modality::Lidar
        }
    );
    assert_eq!(
        ask(&[Modality::Dvs; 2], 100_000),
        RenderError::Twice {
            modality: Modality::Dvs
        }
    );
    let error = ask(&[Modality::Depth], 100);
    assert_eq!(
        error.to_string(),
        "\"depth\" needs 12288 bytes, but its place has 100"
    );
}

/// An image goes to as many places as are asked for, and is drawn once.
#[test]
fn an_image_has_several_places_also_parts_of_one() {
    let gpu = common::gpu();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let (assets, _) = common::street();
    let scene = common::scene(&assets, vec![], 50_000_000);
    let mut views = [common::view(&gpu, 64, 48), common::view(&gpu, 64, 48)];
    let n_bytes = 64 * 48 * 4;
    let mut own = vec![vec![0u8; n_bytes]; 4];
    let mut batches = vec![vec![0u8; 2 * n_bytes]; 2];
    let mut parts: Vec<Vec<Place<'_>>> = vec![Vec::new(), Vec::new()];
    for batch in &mut batches {
        let of_images = Place::Memory(batch).parts(2, n_bytes);
        parts
            .iter_mut()
            .zip(of_images)
            .for_each(|(of, part)| of.push(part));
    }
    for (i, bytes) in own.iter_mut().enumerate() {
        parts[i / 2].push(Place::Memory(bytes));
    }
    let jobs: Vec<ViewJob<'_, '_>> = views
        .iter_mut()
        .zip(parts)
        .enumerate()
        .map(|(i, (view, places))| ViewJob {
            view,
            world_from_sensor: common::pose(i as f64, 0.0, 1.5, [0.0; 3]),
            outputs: places
                .into_iter()
                .map(|place| Output {
                    modality: Modality::Rgb,
                    place,
                })
                .collect(),
        })
        .collect();
    let results = renderer.render(&scene, jobs).unwrap().wait().unwrap();
    assert!(results.iter().all(|result| result.outputs.len() == 4));
    assert!(own[0] == own[1] && own[2] == own[3] && own[0] != own[2]);
    for batch in &batches {
        assert!(batch[..n_bytes] == own[0][..] && batch[n_bytes..] == own[2][..]);
    }
}

#[test]
fn quality_changes_colour_only() {
    let gpu = common::gpu();
    let (assets, car) = common::street();
    let run = |quality: Quality| {
        let mut renderer = CameraRenderer::new(&gpu, quality);
        let mut view = common::view(&gpu, 96, 64);
        let scene = |step: u64| {
            common::scene(
                &assets,
                vec![common::moving(
                    5,
                    car,
                    common::pose(8.0 + step as f64, -2.0, 0.0, [0.0; 3]),
                )],
                step * 50_000_000,
            )
        };
        common::render(
            &mut renderer,
            &scene(1),
            &mut view,
            common::pose(0.0, -1.0, 1.5, [0.0; 3]),
            &[],
        );
        common::render(
            &mut renderer,
            &scene(2),
            &mut view,
            common::pose(0.3, -1.0, 1.5, [0.0, 1.0, 2.0]),
            &ALL[..6],
        )
    };
    let (low, high) = (run(Quality::Low), run(Quality::High));
    for modality in &ALL[1..6] {
        assert!(
            low[modality].0 == high[modality].0,
            "{modality:?} depends on the quality"
        );
    }
}

/// Goal: the sun's shadow of a box darkens the ground behind it and nothing else, and an overcast
/// sky throws none.
#[test]
fn box_throws_a_shadow_away_from_the_sun() {
    use sensor_core::mesh::Surface;
    use sensor_core::{Material, MeshBuilder, SceneAssets};
    let gpu = common::gpu();
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    let mut ground = MeshBuilder::new("ground");
    let grey = Surface::new(schema_types::Class::GROUND, Material::Cloth, [128; 3]);
    ground.quad(
        grey,
        [
            [-40.0, -40.0, 0.0],
            [40.0, -40.0, 0.0],
            [40.0, 40.0, 0.0],
            [-40.0, 40.0, 0.0],
        ],
        [[0.0; 2]; 4],
    );
    let ground = assets.add_mesh(ground.finish());
    assets
        .statics
        .push(common::fixed(ground, common::pose(0.0, 0.0, 0.0, [0.0; 3])));
    let tower = assets.add_mesh(common::cuboid(
        "tower",
        grey,
        [0.0, 0.0, 2.0],
        [0.5, 0.5, 2.0],
    ));
    assets
        .statics
        .push(common::fixed(tower, common::pose(0.0, 0.0, 0.0, [0.0; 3])));
    let assets = std::sync::Arc::new(assets);
    // Straight down from 20 m: x runs up the image, y to the left, 64 px are 40 m.
    let green_at = |cloudiness: f32| {
        let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
        let mut view = common::view(&gpu, 64, 64);
        let mut scene = common::scene(&assets, vec![], 50_000_000);
        (
            scene.weather.sun_azimuth_deg,
            scene.weather.sun_altitude_deg,
            scene.weather.cloudiness,
        ) = (0.0, 45.0, cloudiness);
        let frames = common::render(
            &mut renderer,
            &scene,
            &mut view,
            common::pose(0.0, 0.0, 20.0, [0.0, 90.0, 0.0]),
            &[Modality::Rgb],
        );
        let bytes = frames[&Modality::Rgb].0.clone();
        move |x_m: f64, y_m: f64| {
            bytes[4 * ((32.0 - 1.6 * x_m) as usize * 64 + (32.0 - 1.6 * y_m) as usize) + 1] as i32
        }
    };
    let clear = green_at(0.0);
    // The sun stands towards +x at 45 degrees: 4 m of tower throw 4 m of shadow towards -x.
    let (shade, lit) = (
        clear(-2.5, 0.0),
        [
            clear(2.5, 0.0),
            clear(-6.5, 0.0),
            clear(0.0, 5.0),
            clear(0.0, -5.0),
        ],
    );
    assert!(
        lit.iter().all(|green| *green > shade + 40),
        "{shade} in the shade, {lit:?} in the light"
    );
    let overcast = green_at(100.0);
    assert!((overcast(-2.5, 0.0) - overcast(2.5, 0.0)).abs() < 8);
}
