//! Finds what each view sees, which lamps reach into it, and what its shadow maps need.

use rayon::prelude::*;

use super::active::{Active, eyes_of};
use super::tick::TickScene;
use crate::shadow::{ShadowMaps, ShadowPlans};
use crate::view::ViewJob;
use crate::visible::{Moving, Seen, StillAs};
use crate::{lamps, visible};

/// Does so in parallel; static instances are given as `still`, without what walls hide if `by_walls`.
/// Returns no shadow plans if the maps of all views exceed their memory limit.
pub(super) fn find(
    tick: &TickScene<'_>,
    (still, by_walls): (StillAs, bool),
    maps: &mut ShadowMaps,
    jobs: &[ViewJob<'_, '_>],
    active: &mut [Active],
) -> Option<ShadowPlans> {
    let TickScene {
        quality,
        scene,
        assets,
        light,
        ..
    } = *tick;
    let assets = &assets.meshes;
    let eyes = if light.has_shadows {
        eyes_of(active, jobs)
    } else {
        Vec::new()
    };
    let fits = maps.n_fitting(&eyes) == eyes.len();
    let shining = lamps::shining(scene, assets, light.exposure, light.dark_ratio);
    let seen: Vec<Seen<'_>> = active
        .iter()
        .map(|active| &*jobs[active.job_idx].view)
        .map(|view| Seen {
            lens: view.drawn,
            previous: view.previous.as_ref(),
            hidden: &view.hidden,
            still,
            by_walls,
        })
        .collect();
    let moving = Moving::of(scene, assets);
    let find = |(active, seen): (&mut Active, Seen<'_>)| {
        let (motion, drawn) = (&active.motion, &mut active.drawn);
        visible::visible(scene, assets, &moving, seen, motion, drawn);
        if active.set.is_lit() {
            active.lamps_in_view = lamps::reaching(&shining, quality, &seen.lens, motion);
        }
    };
    // A single view is done before other threads would wake up.
    if active.len() == 1 {
        active.iter_mut().zip(seen).for_each(find);
        return Some(maps.plan(assets, scene, light.sun_towards, &eyes));
    }
    let views = || active.par_iter_mut().zip(seen).for_each(find);
    let plans = || fits.then(|| maps.plan_in_parallel(assets, scene, light.sun_towards, &eyes));
    rayon::join(views, plans).1
}
