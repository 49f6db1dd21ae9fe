//! Finds what each view sees, which lamps reach into it, and what its shadow maps need.

use rayon::prelude::*;
use schema_types::ActorId;
use sensor_spec::Intrinsics;

use super::active::{Active, eyes_of};
use super::tick::TickScene;
use crate::camera_motion::Firing;
use crate::shadow::{ShadowMaps, ShadowPlans};
use crate::view::ViewJob;
use crate::{lamps, visible};

/// A view's lens, its firing before, and the actors that it does not show.
type Seen<'v> = (Intrinsics, Option<&'v Firing>, &'v [ActorId]);

/// Does so in parallel. Returns no shadow plans if the maps of all views exceed their memory limit.
pub(super) fn find(
    tick: &TickScene<'_>,
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
        .map(|view| (view.drawn, view.previous.as_ref(), &*view.hidden))
        .collect();
    let find = |(active, (lens, previous, hidden)): (&mut Active, Seen<'_>)| {
        visible::visible(
            scene,
            assets,
            &lens,
            &active.motion,
            previous,
            hidden,
            &mut active.drawn,
        );
        if active.set.is_lit() {
            active.lamps_in_view = lamps::reaching(&shining, quality, &lens, &active.motion);
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
