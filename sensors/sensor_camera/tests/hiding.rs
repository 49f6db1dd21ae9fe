//! Objects of the scenery are hidden and shown again: images equal those of a scene without them,
//! and only changes are uploaded.

#[path = "common/mod.rs"]
mod common;

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
