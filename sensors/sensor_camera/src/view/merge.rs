//! Finds the jobs of a tick that see the same, so that they are drawn once.

use schema_frames::Modality;
use sensor_spec::ExposureMode;

use super::camera_view::ViewJob;

/// For each job the index of the first job whose drawing it shares, or its own index.
///
/// Pose, lens and previous firing must agree to the bit, and jobs with colour must have equal
/// optics.
pub(crate) fn leaders(jobs: &[ViewJob<'_, '_>]) -> Vec<usize> {
    let mut leaders: Vec<usize> = Vec::with_capacity(jobs.len());
    for (i, job) in jobs.iter().enumerate() {
        let leader = (0..i).find(|j| leaders[*j] == *j && shares_drawing(jobs, &leaders, *j, job));
        leaders.push(leader.unwrap_or(i));
    }
    leaders
}

fn shares_drawing(
    jobs: &[ViewJob<'_, '_>],
    leaders: &[usize],
    leader: usize,
    job: &ViewJob<'_, '_>,
) -> bool {
    let first = &jobs[leader];
    // The pose first: most views of many differ by it.
    let sees_alike = first.world_from_sensor == job.world_from_sensor
        && first.view.spec.intrinsics == job.view.spec.intrinsics
        && first.view.spec.lens == job.view.spec.lens
        && first.view.spec.optics.distortion() == job.view.spec.optics.distortion()
        && first.view.spec.shows_overlay == job.view.spec.shows_overlay
        && first.view.hidden == job.view.hidden
        && match (&first.view.previous, &job.view.previous) {
            (None, None) => true,
            (Some(a), Some(b)) => {
                (a.sim_time, a.episode, a.world_from_camera)
                    == (b.sim_time, b.episode, b.world_from_camera)
            }
            _ => false,
        };
    if !sees_alike || job.outputs.is_empty() || first.outputs.is_empty() {
        return false;
    }
    if !wants_colour(job) {
        return true;
    }
    // Automatic exposure has a state, so each such view develops its own image; other views share
    // one if their optics are equal.
    let remembers =
        |job: &ViewJob<'_, '_>| job.view.spec.optics.exposure.mode == ExposureMode::Histogram;
    let coloured = (leader..jobs.len().min(leaders.len()))
        .filter(|k| leaders[*k] == leader)
        .map(|k| &jobs[k])
        .filter(|k| wants_colour(k));
    let first_optics = &first.view.spec.optics;
    first_optics == &job.view.spec.optics
        && !remembers(job)
        && coloured
            .into_iter()
            .all(|other| other.view.spec.optics == *first_optics)
}

fn wants_colour(job: &ViewJob<'_, '_>) -> bool {
    job.outputs
        .iter()
        .any(|output| output.modality == Modality::Rgb)
}
