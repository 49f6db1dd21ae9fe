//! Times frames of many cameras: all views in one submission, several frames in flight, written
//! into memory that the GPU has imported.

#![expect(
    unsafe_code,
    reason = "frames go to raw memory that the GPU imported; each block carries its proof"
)]

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_camera::{
    CameraRenderer, Output, Quality, Rasteriser, Submission, View, ViewJob, ViewSpec,
};
use sensor_core::Scene;
use sensor_gpu::{Gpu, ShmTarget};
use sensor_spec::{Intrinsics, OpticsSpec};

/// Views that fire together.
pub struct Cameras {
    gpu: Gpu,
    renderer: CameraRenderer,
    views: Vec<View>,
    asked: Vec<Vec<Modality>>,
    target: Arc<ShmTarget>,
    /// Where `target` begins.
    base: *const u8,
    frame_bytes: usize,
    n_in_flight: usize,
    /// Submissions of single views so far.
    n_alone: usize,
}

/// Result of a run.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Median wall time from one submission's end to the next, milliseconds.
    pub p50_ms: f64,
    /// The shortest.
    pub best_ms: f64,
    /// Mean over the whole run.
    pub mean_ms: f64,
    /// CPU time of this process per frame, milliseconds: mean.
    pub cpu_ms: f64,
    /// CPU time of the cheapest frame, milliseconds: least disturbed by other load on the machine.
    pub cpu_best_ms: f64,
    /// Triangles given to draw calls, per frame.
    pub n_triangles: u64,
    /// Draw calls per frame.
    pub n_draws: u64,
    /// Passes per frame.
    pub n_passes: u64,
}

/// Frames that are rendered before timing starts, while pipelines compile and shadow maps are
/// drawn.
pub const WARM_UP: usize = 4;

impl Cameras {
    /// One view per list of `asked`, all with this lens; up to `n_in_flight` frames may be in
    /// flight.
    pub fn new(
        gpu: &Gpu,
        quality: Quality,
        lens: Intrinsics,
        asked: &[&[Modality]],
        n_in_flight: usize,
    ) -> Cameras {
        Cameras::with_optics(
            gpu,
            quality,
            lens,
            OpticsSpec::default(),
            asked,
            n_in_flight,
        )
    }

    /// As [`Cameras::new`], with other optics.
    pub fn with_optics(
        gpu: &Gpu,
        quality: Quality,
        lens: Intrinsics,
        optics: OpticsSpec,
        asked: &[&[Modality]],
        n_in_flight: usize,
    ) -> Cameras {
        let spec = |i: usize| ViewSpec {
            sensor_id: i as u32,
            optics: optics.clone(),
            ..ViewSpec::pinhole(lens)
        };
        let views: Vec<View> = (0..asked.len()).map(|i| View::new(gpu, spec(i))).collect();
        let bytes = |list: &&[Modality]| {
            list.iter()
                .map(|modality| views[0].payload_bytes(*modality).next_multiple_of(64))
                .sum::<usize>()
        };
        let frame_bytes: usize = asked.iter().map(bytes).sum();
        let len = (frame_bytes * n_in_flight).next_multiple_of(1 << 21);
        let base = page_aligned(len);
        // SAFETY: the memory is leaked, and only frames in flight touch it, each its own range.
        let target = Arc::new(unsafe { ShmTarget::import(gpu, base, len, ()) });
        let asked = asked.iter().map(|list| list.to_vec()).collect();
        Cameras {
            gpu: gpu.clone(),
            renderer: CameraRenderer::new(gpu, quality),
            views,
            asked,
            target,
            base,
            frame_bytes,
            n_in_flight,
            n_alone: 0,
        }
    }

    /// Lets this rasteriser draw.
    pub fn rasterise(&mut self, quality: Quality, rasteriser: Rasteriser) {
        self.renderer = CameraRenderer::with_rasteriser(&self.gpu, quality, rasteriser);
    }

    /// FNV-1a over the bytes of the last frames of a run, as many as were in flight.
    pub fn hash(&self) -> u64 {
        let n_bytes = self.frame_bytes * self.n_in_flight;
        // SAFETY: the memory is leaked and so long; a run that has ended has nothing in flight.
        let bytes = unsafe { std::slice::from_raw_parts(self.base, n_bytes) };
        bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        })
    }

    /// Number of copies on the CPU that a frame costs.
    pub fn cpu_copies(&self) -> u32 {
        self.target.cpu_copies()
    }

    /// Renders `n_frames`; `look` gives the scene and one pose per view for each of them.
    pub fn run(
        &mut self,
        n_frames: usize,
        mut look: impl FnMut(usize) -> (Arc<Scene>, Vec<Isometry3<f64>>),
    ) -> Figures {
        let mut in_flight: VecDeque<Submission<'static>> = VecDeque::new();
        let (mut millis, mut cpu) = (Vec::with_capacity(n_frames), Vec::with_capacity(n_frames));
        let (mut begin, mut cpu_begin, mut counts) =
            (Instant::now(), cpu_millis(), self.gpu.counters().counts());
        let mut last = begin;
        for frame in 0..n_frames + WARM_UP {
            if frame == WARM_UP {
                in_flight.drain(..).for_each(finish);
                self.gpu.take_spans();
                (begin, cpu_begin, counts) =
                    (Instant::now(), cpu_millis(), self.gpu.counters().counts());
                last = begin;
            }
            while in_flight.len() >= self.n_in_flight {
                if let Some(oldest) = in_flight.pop_front() {
                    finish(oldest);
                }
                let now = Instant::now();
                millis.push((now - last).as_secs_f64() * 1e3);
                cpu.push(cpu_millis());
                last = now;
            }
            let (scene, poses) = look(frame);
            in_flight.push_back(self.submit(&scene, &poses, frame % self.n_in_flight));
        }
        in_flight.drain(..).for_each(finish);
        let mean_ms = begin.elapsed().as_secs_f64() * 1e3 / n_frames as f64;
        let cpu_ms = (cpu_millis() - cpu_begin) / n_frames as f64;
        let counts = self.gpu.counters().counts().since(counts);
        let mut millis = millis.split_off(millis.len().min(WARM_UP));
        millis.sort_by(f64::total_cmp);
        let at = |share: f64| {
            millis
                .get((share * millis.len() as f64) as usize)
                .copied()
                .unwrap_or(mean_ms)
        };
        let per_frame = |n: u64| n / n_frames as u64;
        Figures {
            p50_ms: at(0.5),
            best_ms: at(0.0),
            mean_ms,
            cpu_ms,
            cpu_best_ms: cpu[cpu.len().min(WARM_UP)..]
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .fold(cpu_ms, f64::min),
            n_triangles: per_frame(counts.triangles),
            n_draws: per_frame(counts.draws),
            n_passes: per_frame(counts.passes),
        }
    }

    fn submit(
        &mut self,
        scene: &Scene,
        poses: &[Isometry3<f64>],
        slot: usize,
    ) -> Submission<'static> {
        let mut offset_bytes = slot * self.frame_bytes;
        let mut jobs = Vec::with_capacity(self.views.len());
        for ((view, list), pose) in self.views.iter_mut().zip(&self.asked).zip(poses) {
            jobs.push(job(view, list, pose, &self.target, &mut offset_bytes));
        }
        self.renderer
            .render(scene, jobs)
            .expect("the request is in order")
    }

    /// How many views there are.
    pub(crate) fn n_views(&self) -> usize {
        self.views.len()
    }

    /// Renders one of the views alone. Its bytes are written to the same place again after
    /// `n_in_flight` submissions.
    pub(crate) fn submit_one(
        &mut self,
        scene: &Scene,
        pose: &Isometry3<f64>,
        view_idx: usize,
    ) -> Submission<'static> {
        self.n_alone += 1;
        let view_bytes = |view: &View, list: &[Modality]| {
            list.iter()
                .map(|m| view.payload_bytes(*m).next_multiple_of(64))
                .sum::<usize>()
        };
        let before: usize = self
            .views
            .iter()
            .zip(&self.asked)
            .take(view_idx)
            .map(|(view, list)| view_bytes(view, list))
            .sum();
        let mut offset_bytes = self.n_alone % self.n_in_flight * self.frame_bytes + before;
        let job = job(
            &mut self.views[view_idx],
            &self.asked[view_idx],
            pose,
            &self.target,
            &mut offset_bytes,
        );
        self.renderer
            .render(scene, vec![job])
            .expect("the request is in order")
    }
}

/// The job of a view with the modalities of `list`; its output begins at `offset_bytes`, which is
/// advanced beyond it.
fn job<'v>(
    view: &'v mut View,
    list: &[Modality],
    pose: &Isometry3<f64>,
    target: &Arc<ShmTarget>,
    offset_bytes: &mut usize,
) -> ViewJob<'v, 'static> {
    let mut outputs = Vec::with_capacity(list.len());
    for modality in list {
        let capacity_bytes = view.payload_bytes(*modality);
        // SAFETY: ranges of a leaked segment that do not overlap, and are looked at after the wait.
        let place = unsafe { target.place(*offset_bytes, capacity_bytes) };
        outputs.push(Output {
            modality: *modality,
            place,
        });
        *offset_bytes += capacity_bytes.next_multiple_of(64);
    }
    ViewJob {
        view,
        world_from_sensor: *pose,
        outputs,
    }
}

pub(crate) fn finish(submission: Submission<'static>) {
    submission.wait().expect("the device works");
}

/// Memory that lives as long as the process.
fn page_aligned(len: usize) -> *mut u8 {
    const PAGE: usize = 1 << 16;
    let memory: &'static mut [u8] = vec![1u8; len + PAGE].leak();
    let aligned = memory.as_ptr().align_offset(PAGE);
    memory[aligned..aligned + len].as_mut_ptr()
}

/// CPU time of this process so far, milliseconds. It is one system call, since it is measured in
/// every frame.
pub fn cpu_millis() -> f64 {
    let clock = nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID;
    let time = nix::time::clock_gettime(clock).expect("Linux has a clock of each process");
    time.tv_sec() as f64 * 1e3 + time.tv_nsec() as f64 * 1e-6
}
