//! Objects of the scenery are hidden and shown again: images equal those of a scene without them,
//! and only changes are uploaded.

use crate::common;

use std::collections::BTreeSet;
use std::sync::Arc;

use schema_frames::Modality;
use schema_types::{Class, ObjectId};
use sensor_camera::{CameraRenderer, Quality};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets};
use sensor_gpu::Gpu;

const ALL: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

/// A street with a mesh of three posts, each an object of its own, and a house.
fn street() -> (Arc<SceneAssets>, [ObjectId; 3]) {
    let mut assets = SceneAssets::clone(&common::street().0);
    let posts = [0u32, 1, 2].map(|i| ObjectId::scenery(5000 + i));
    let mut builder = MeshBuilder::new("posts");
    for (i, post) in (0..).zip(posts) {
        let surface = Surface::new(Class::POLES, Material::Metal, [200, 60, 40]).of(post);
        builder.cuboid(
            surface,
            [6.0 + 2.0 * i as f32, 1.5 - i as f32, 1.5],
            [0.3, 0.3, 1.5],
        );
    }
    let mesh = assets.add_mesh(builder.finish());
    assets
        .statics
        .push(common::fixed(mesh, common::pose(0.0, 0.0, 0.0, [0.0; 3])));
    (Arc::new(assets), posts)
}

fn picture(gpu: &Gpu, renderer: &mut CameraRenderer, assets: &Arc<SceneAssets>) -> Vec<Vec<u8>> {
    let mut view = common::view(gpu, 96, 64);
    let scene = common::scene(assets, vec![], 50_000_000);
    common::render(
        renderer,
        &scene,
        &mut view,
        common::pose(0.0, 0.0, 1.5, [0.0; 3]),
        &ALL,
    )
    .into_values()
    .map(|(bytes, _)| bytes)
    .collect()
}

#[test]
fn hidden_objects_leave_the_picture_and_come_back_and_only_what_changed_is_uploaded() {
    let gpu = common::gpu();
    let (whole, posts) = street();
    let cases = common::rasterisers(&gpu)
        .into_iter()
        .flat_map(|rasteriser| [(rasteriser, Quality::Low), (rasteriser, Quality::High)]);
    for (rasteriser, quality) in cases {
        let fresh = || CameraRenderer::with_rasteriser(&gpu, quality, rasteriser);
        let mut renderer = fresh();
        let n_whole = renderer.load(&whole);
        let before = picture(&gpu, &mut renderer, &whole);
        let some = Arc::new(whole.without(&BTreeSet::from([posts[1]])));
        let none = Arc::new(whole.without(&BTreeSet::from(posts)));
        let mut seen = vec![before.clone()];
        for shown in [&some, &none, &whole] {
            let n_bytes = renderer.load(shown);
            // Three posts of twelve triangles.
            assert!(
                n_bytes <= 3 * 12 * 3 * 4 && n_bytes < n_whole / 10,
                "{n_bytes} of {n_whole} bytes"
            );
            let now = picture(&gpu, &mut renderer, shown);
            assert!(
                now == picture(&gpu, &mut fresh(), shown),
                "{rasteriser:?} {quality:?}: not the picture of a scene without them"
            );
            seen.push(now);
        }
        assert!(
            seen[0] != seen[1] && seen[1] != seen[2] && seen[2] != seen[3] && seen[3] == seen[0],
            "{rasteriser:?} {quality:?}"
        );
    }
}

#[test]
fn another_map_and_one_that_needs_more_room_are_uploaded_whole() {
    let gpu = common::gpu();
    let (whole, posts) = street();
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let some = Arc::new(whole.without(&BTreeSet::from([posts[1]])));
    let n_some = renderer.load(&some);
    let n_whole = renderer.load(&whole);
    assert_eq!(n_whole, n_some + 12 * 3 * 4);
    let mut other = SceneAssets::clone(&whole);
    other.episode += 1;
    assert_eq!(renderer.load(&Arc::new(other)), n_whole);
}

/// Scenery that is streamed comes and goes in any order, and every picture is that of a renderer that
/// has seen nothing else. Going on uploads the meshes that came, not those that stay.
#[test]
fn streamed_tiles_come_and_go_without_a_trace() {
    use sensor_core::stream::{TILE_M, Tiles, tile_at};
    let gpu = common::gpu();
    let mut assets = SceneAssets {
        episode: 1,
        streamed: true,
        ..SceneAssets::default()
    };
    // Eight rows of posts, one to a tile; the farther, the more posts.
    for row in 0..8u32 {
        let mut builder = MeshBuilder::new("row");
        let surface = Surface::new(Class::POLES, Material::Metal, [200, 60, 30 * row as u8]);
        for post in 0..(row + 1) * 40 {
            let y = 4.0 * (post % 40) as f32 - 80.0;
            builder.cuboid(surface, [0.1 * post as f32, y, 6.0], [0.5, 1.0, 6.0]);
        }
        let mesh = assets.add_mesh(builder.finish());
        let x = TILE_M * f64::from(row) * 0.25 + 30.0;
        assets
            .statics
            .push(common::fixed(mesh, common::pose(x, 0.0, 0.0, [0.0; 3])));
    }
    let tiles = Tiles::of(&mut assets).unwrap();
    let with = |columns: &[i64]| {
        let set = columns
            .iter()
            .map(|column| (*column, tile_at(0.0, 0.0).1))
            .collect();
        Arc::new(tiles.shown(&assets, &set))
    };
    let mut renderer = CameraRenderer::new(&gpu, Quality::Low);
    let n_whole = renderer.load(&with(&[0, 1, 2]));
    let mut rng = fastrand::Rng::with_seed(3);
    let mut seen = BTreeSet::new();
    for _ in 0..12 {
        let columns: Vec<i64> = (0..4).filter(|_| rng.bool()).collect();
        let shown = with(&columns);
        renderer.load(&shown);
        let now = picture(&gpu, &mut renderer, &shown);
        let fresh = picture(&gpu, &mut CameraRenderer::new(&gpu, Quality::Low), &shown);
        assert!(now == fresh, "{columns:?}");
        seen.insert(now);
    }
    assert!(seen.len() > 2, "{} pictures", seen.len());
    renderer.load(&with(&[0, 1]));
    let one_more = renderer.load(&with(&[0, 1, 2]));
    assert!(
        one_more > 0 && one_more < n_whole / 2,
        "{one_more} of {n_whole} bytes"
    );
}
