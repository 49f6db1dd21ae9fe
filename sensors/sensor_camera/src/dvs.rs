//! The event camera: brightness of every pixel followed through the time between two firings.
//!
//! Nothing is drawn in between. What lies at a pixel at a time of the window is found by moving the two rendered pictures along their
//! motion field, in steps of at most `substep_px`; between steps the logarithm of the brightness is a straight line, and each crossing
//! of the pixel's threshold is an event. Model: Rebecq, Gehrig, Scaramuzza, *ESIM: an Open Event Camera Simulator* (2018), section 3,
//! with warped pictures in place of extra renders.
//!
//! An edge is known to half a pixel of the rendered pictures, so an event's time is known to half a pixel of motion.

mod block;
mod field;

use bytemuck::Zeroable as _;
use rayon::prelude::*;
use schema_frames::DvsEvent;
use schema_types::noise::Noise;
use sensor_gpu::Mapped;
use sensor_spec::DvsSpec;

use crate::view::ViewSpec;
use block::{Block, LANES};
use field::{Bounds, Motion, Path, Picture, norm2};

/// Images of this firing, as the GPU left them.
pub(crate) struct DvsImages {
    pub luminance: Mapped,
    pub flow: Mapped,
    pub depth: Mapped,
    pub instance: Mapped,
    pub class: Mapped,
}

/// What a frame of events came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Made {
    pub n_events: usize,
    pub n_dropped: u64,
    pub first: bool,
}

/// Memory of an event camera.
#[derive(Debug)]
pub(crate) struct DvsState {
    spec: DvsSpec,
    size_px: [usize; 2],
    /// Factor of both thresholds, per pixel; empty without mismatch.
    mismatch: Vec<f32>,
    pixels: Vec<PixelState>,
    previous: Option<Picture>,
    /// The picture before, for its memory.
    spare: Option<Picture>,
    previous_window_nanos: u64,
}

/// Memory of a pixel.
#[derive(Clone, Copy, Debug, Default)]
struct PixelState {
    /// Logarithm of the brightness at the last event.
    reference: f32,
    /// Rest of the refractory period when the window began, nanoseconds.
    silent_nanos: u32,
}

/// Stream of the thresholds' noise, apart from a sensor's other noise.
const MISMATCH_STREAM: u64 = 0x6476_735f_7468_7265;
/// Thresholds do not fall below this share of their nominal value, however unlucky the pixel.
const MIN_MISMATCH: f64 = 0.1;
/// Most steps of a pixel in one window: beyond, motion per step exceeds `substep_px`.
const MAX_STEPS: usize = 256;

impl DvsState {
    pub fn new(spec: &ViewSpec) -> Self {
        let size_px = [spec.intrinsics.width_px as usize, spec.intrinsics.height_px as usize];
        let n_pixels = size_px[0] * size_px[1];
        let noise = Noise::new(spec.seed, spec.sensor_id as u64 ^ MISMATCH_STREAM, 0);
        let relative =
            spec.dvs.threshold_mismatch_stddev as f64 / (0.5 * (spec.dvs.positive_threshold + spec.dvs.negative_threshold)) as f64;
        let factor = |pixel: usize| (1.0 + relative * noise.gaussian(pixel as u64)).max(MIN_MISMATCH) as f32;
        let mismatch = if relative > 0.0 { (0..n_pixels).into_par_iter().map(factor).collect() } else { Vec::new() };
        DvsState {
            spec: spec.dvs.clone(),
            size_px,
            mismatch,
            pixels: vec![PixelState::default(); n_pixels],
            previous: None,
            spare: None,
            previous_window_nanos: 0,
        }
    }

    /// Follows the window that ends now and writes its events to `out`, sorted by time, y, x.
    pub fn advance(&mut self, images: &DvsImages, window_nanos: u64, out: &mut [u8]) -> Made {
        let mut now = self.spare.take().unwrap_or_else(|| Picture::blank(self.size_px));
        now.read(images, self.spec.log_eps);
        let previous = self.previous.take();
        let Some(previous) = previous.filter(|_| window_nanos > 0) else {
            for (pixel, log) in self.pixels.iter_mut().zip(&now.log) {
                *pixel = PixelState { reference: *log, silent_nanos: 0 };
            }
            self.previous = Some(now);
            self.previous_window_nanos = 0;
            return Made { n_events: 0, n_dropped: 0, first: true };
        };
        let ratio = if self.previous_window_nanos > 0 { window_nanos as f32 / self.previous_window_nanos as f32 } else { 0.0 };
        let events = self.follow(&previous, &now, ratio, window_nanos, images);
        self.previous = Some(now);
        self.spare = Some(previous);
        self.previous_window_nanos = window_nanos;
        let n_events = write(&events, self.spec.max_events_of(self.size_px[0] as u32, self.size_px[1] as u32) as usize, out);
        Made { n_events, n_dropped: (events.len() - n_events) as u64, first: false }
    }

    fn follow(&mut self, previous: &Picture, now: &Picture, ratio: f32, window_nanos: u64, images: &DvsImages) -> Vec<DvsEvent> {
        let width = self.size_px[0];
        let motion = Motion::between(previous, now, ratio);
        let bounds = [Bounds::of(previous), Bounds::of(now)];
        let window =
            Window { previous, now, motion: &motion, bounds: &bounds, spec: &self.spec, nanos: window_nanos.min(u32::MAX as u64) as u32 };
        let mismatch = &self.mismatch;
        let rows: Vec<Vec<DvsEvent>> = self
            .pixels
            .par_chunks_mut(width)
            .enumerate()
            .map(|(y, pixels)| {
                let (ids, classes) = (images.instance.row(y), images.class.row(y));
                let mut events = Vec::new();
                for (block, pixels) in pixels.chunks_mut(LANES).enumerate() {
                    let first = block * LANES;
                    let factors = mismatch.get(y * width + first..y * width + first + pixels.len()).unwrap_or_default();
                    window.follow_pixels([first, y], pixels, factors, &mut |lane, nanos_in_window, polarity| {
                        let x = first + lane;
                        let id = [ids[4 * x], ids[4 * x + 1], ids[4 * x + 2], ids[4 * x + 3]];
                        events.push(DvsEvent {
                            nanos_in_window,
                            x_px: x as u16,
                            y_px: y as u16,
                            object_id: u32::from_le_bytes(id),
                            polarity,
                            class: classes[x],
                            reserved: 0,
                        });
                    });
                }
                events
            })
            .collect();
        sorted_by_time(&rows, window_nanos)
    }
}

/// Intervals of the window that events are sorted into before they are compared.
const N_INTERVALS: u64 = 8192;

/// All events by time, y, x. Dealt out to short intervals first: comparing then costs a quarter.
fn sorted_by_time(rows: &[Vec<DvsEvent>], window_nanos: u64) -> Vec<DvsEvent> {
    let interval_of = |event: &DvsEvent| (event.nanos_in_window as u64 * N_INTERVALS / (window_nanos + 1)).min(N_INTERVALS - 1) as usize;
    let mut ends = vec![0_usize; N_INTERVALS as usize + 1];
    for event in rows.iter().flatten() {
        ends[interval_of(event) + 1] += 1;
    }
    for i in 1..ends.len() {
        ends[i] += ends[i - 1];
    }
    // Now where each interval begins; after dealing out, where it ends.
    let mut events = vec![DvsEvent::zeroed(); ends[N_INTERVALS as usize]];
    for event in rows.iter().flatten() {
        let place = &mut ends[interval_of(event)];
        events[*place] = *event;
        *place += 1;
    }
    let mut intervals = Vec::with_capacity(N_INTERVALS as usize);
    let (mut rest, mut begin) = (events.as_mut_slice(), 0);
    for end in &ends[..N_INTERVALS as usize] {
        let (interval, behind) = rest.split_at_mut(end - begin);
        intervals.push(interval);
        (rest, begin) = (behind, *end);
    }
    // One number per event: three times as fast as comparing field by field. Equal keys are one pixel's equal events.
    let key = |event: &DvsEvent| (event.nanos_in_window as u64) << 32 | (event.y_px as u64) << 16 | event.x_px as u64;
    intervals.into_par_iter().with_min_len(256).for_each(|interval| interval.sort_unstable_by_key(key));
    events
}

/// Copies events to the front of `out`, as many as it and the limit take; returns how many.
fn write(events: &[DvsEvent], max_events: usize, out: &mut [u8]) -> usize {
    let n_events = events.len().min(max_events).min(out.len() / size_of::<DvsEvent>());
    let bytes: &[u8] = bytemuck::cast_slice(&events[..n_events]);
    out[..bytes.len()].copy_from_slice(bytes);
    n_events
}

/// The time between two firings.
struct Window<'w> {
    previous: &'w Picture,
    now: &'w Picture,
    motion: &'w Motion<'w>,
    bounds: &'w [Bounds; 2],
    spec: &'w DvsSpec,
    nanos: u32,
}

impl Window<'_> {
    /// Follows up to [`LANES`] neighbouring pixels from `(x, y)` on and calls `event(lane, nanos_in_window, polarity)` for each crossing.
    fn follow_pixels(&self, [x, y]: [usize; 2], pixels: &mut [PixelState], factors: &[f32], event: &mut impl FnMut(usize, u32, u8)) {
        let mut block = Block::new(x, y);
        let one_step = self.spec.substep_px * self.spec.substep_px;
        for (lane, pixel) in pixels.iter_mut().enumerate() {
            let i = y * self.now.size_px[0] + x + lane;
            let mut crossing = self.crossing(pixel, factors.get(lane));
            let (begin, end) = (self.previous.log[i], self.now.log[i]);
            match self.motion.path(x + lane, y) {
                Path::Still => self.follow_still(&mut crossing, [begin, end], &mut |nanos, polarity| event(lane, nanos, polarity)),
                // Less than a step of motion: the two pictures say it all.
                Path::Smooth { begin: from, end: to } if norm2(from).max(norm2(to)) < one_step => {
                    self.follow_still(&mut crossing, [begin, end], &mut |nanos, polarity| event(lane, nanos, polarity))
                }
                Path::Smooth { begin: from, end: to } => block.set(lane, [from, to], [begin, end], crossing.limits(), self.now.size_px),
                Path::Several { motions, n } => {
                    let event = &mut |nanos, polarity| event(lane, nanos, polarity);
                    self.follow_several(&motions[..n], [x + lane, y], &mut crossing, event);
                }
            }
        }
        if block.any() {
            self.follow_smooth(&mut block, pixels, factors, event);
        }
        for pixel in pixels {
            pixel.silent_nanos = pixel.silent_nanos.saturating_sub(self.nanos);
        }
    }

    /// A pixel whose level goes in a straight line from one picture to the other.
    fn follow_still(&self, crossing: &mut Crossing<'_>, [begin, end]: [f32; 2], event: &mut impl FnMut(u32, u8)) {
        if crossing.is_beyond(end) {
            crossing.follow(begin, end, 0, self.nanos, event);
        }
    }

    fn crossing<'p>(&self, pixel: &'p mut PixelState, factor: Option<&f32>) -> Crossing<'p> {
        let factor = factor.copied().unwrap_or(1.0);
        Crossing {
            up: self.spec.positive_threshold * factor,
            down: self.spec.negative_threshold * factor,
            pixel,
            refractory_nanos: self.spec.refractory_nanos,
        }
    }

    fn n_steps(&self, fastest_px: f32) -> usize {
        ((fastest_px / self.spec.substep_px).min(MAX_STEPS as f32 - 1.0) as usize + 1).clamp(1, MAX_STEPS)
    }

    fn nanos(&self, step: usize, n_steps: usize) -> u32 {
        (self.nanos as u64 * step as u64 / n_steps as u64) as u32
    }

    /// Pixels that one surface passes, all in the steps of the fastest.
    fn follow_smooth(&self, block: &mut Block, pixels: &mut [PixelState], factors: &[f32], event: &mut impl FnMut(usize, u32, u8)) {
        let n_steps = self.n_steps(block.fastest_px());
        let share = |step: usize| step as f32 / n_steps as f32;
        let mut before = block.begin;
        let mut step = 0;
        while step < n_steps {
            // A stretch whose surroundings hold no crossing is passed in one go.
            let last = (step + STRETCH_STEPS).min(n_steps);
            let first = if block.is_quiet(self.bounds, share(step), share(last)) { last } else { step + 1 };
            for next in first..=last {
                let levels = if next == n_steps { block.end } else { block.levels(self.previous, self.now, share(next)) };
                if block.crosses(&levels) {
                    for lane in block.crossing_lanes(&levels) {
                        let mut crossing = self.crossing(&mut pixels[lane], factors.get(lane));
                        let (begin_nanos, end_nanos) = (self.nanos(step, n_steps), self.nanos(next, n_steps));
                        crossing.follow(before[lane], levels[lane], begin_nanos, end_nanos, &mut |nanos, polarity| {
                            event(lane, nanos, polarity)
                        });
                        block.set_limits(lane, crossing.limits());
                    }
                }
                (before, step) = (levels, next);
            }
        }
    }

    /// A pixel that several surfaces pass.
    fn follow_several(&self, motions: &[[f32; 2]], [x, y]: [usize; 2], crossing: &mut Crossing<'_>, event: &mut impl FnMut(u32, u8)) {
        let i = y * self.now.size_px[0] + x;
        let fastest_px = motions.iter().map(|m| norm2(*m)).fold(0.0, f32::max).sqrt();
        let n_steps = self.n_steps(fastest_px);
        let mut before = self.previous.log[i];
        for step in 1..=n_steps {
            let share = step as f32 / n_steps as f32;
            let level = if step == n_steps { self.now.log[i] } else { self.motion.level(self.previous, self.now, motions, x, y, share) };
            crossing.follow(before, level, self.nanos(step - 1, n_steps), self.nanos(step, n_steps), event);
            before = level;
        }
    }
}

/// Steps that are tried in one go: fewer cost more in looking at tiles than they save (bench measure_views).
const STRETCH_STEPS: usize = 24;

/// Threshold crossings of one pixel.
struct Crossing<'p> {
    up: f32,
    down: f32,
    pixel: &'p mut PixelState,
    refractory_nanos: u32,
}

impl Crossing<'_> {
    /// Levels at which the next event comes, below and above.
    fn limits(&self) -> [f32; 2] {
        [self.pixel.reference - self.down, self.pixel.reference + self.up]
    }

    fn is_beyond(&self, level: f32) -> bool {
        let [low, high] = self.limits();
        level <= low || level >= high
    }

    /// The level goes in a straight line from `before` to `after`.
    fn follow(&mut self, before: f32, after: f32, begin_nanos: u32, end_nanos: u32, event: &mut impl FnMut(u32, u8)) {
        let (step, polarity) = if after > before { (self.up, 1) } else { (-self.down, 0) };
        loop {
            let target = self.pixel.reference + step;
            let crosses = if step > 0.0 { after >= target } else { after <= target };
            if !crosses {
                return;
            }
            // A level that is beyond already (a step where pictures do not meet) crosses at once.
            let share = if after == before { 1.0 } else { ((target - before) / (after - before)).clamp(0.0, 1.0) };
            let nanos = begin_nanos + (share as f64 * (end_nanos - begin_nanos) as f64).round() as u32;
            self.pixel.reference = target;
            // In the refractory period the change is lost, as in the real pixel.
            if nanos >= self.pixel.silent_nanos {
                event(nanos, polarity);
                self.pixel.silent_nanos = nanos.saturating_add(self.refractory_nanos);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramp_crosses_at_equal_times_and_remembers_the_rest() {
        let mut pixel = PixelState { reference: 0.0, silent_nanos: 0 };
        let mut events = Vec::new();
        let mut crossing = Crossing { up: 0.25, down: 0.25, pixel: &mut pixel, refractory_nanos: 0 };
        crossing.follow(0.0, 1.1, 0, 1_100, &mut |nanos, polarity| events.push((nanos, polarity)));
        assert_eq!(events, [(250, 1), (500, 1), (750, 1), (1000, 1)]);
        assert_eq!(pixel.reference, 1.0);
    }

    #[test]
    fn refractory_period_swallows_events() {
        let mut pixel = PixelState { reference: 0.0, silent_nanos: 0 };
        let mut events = Vec::new();
        let mut crossing = Crossing { up: 0.25, down: 0.25, pixel: &mut pixel, refractory_nanos: 400 };
        crossing.follow(0.0, -1.0, 0, 1_000, &mut |nanos, polarity| events.push((nanos, polarity)));
        assert_eq!(events, [(250, 0), (750, 0)]);
    }
}
