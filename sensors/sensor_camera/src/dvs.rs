//! The event camera: brightness of every pixel followed through the time between two firings.
//!
//! Nothing is drawn in between. What lies at a pixel at a time of the window is found by moving the
//! two rendered pictures along their
//! motion field, in steps of at most `substep_px`; between steps the logarithm of the brightness is
//! a straight line, and each crossing
//! of the pixel's threshold is an event. Model: Rebecq, Gehrig, Scaramuzza, *ESIM: an Open Event
//! Camera Simulator* (2018), section 3,
//! with warped pictures in place of extra renders.
//!
//! An edge is known to half a pixel of the rendered pictures, so an event's time is known to half a
//! pixel of motion.
//!
//! In mode `two_frame` the level of every pixel goes in a straight line from picture to picture, as
//! in CARLA.
//!
//! [`EventCamera`] works on the processor; `gpu` is the same model where the pictures are.

mod block;
mod chance;
mod crossing;
pub(crate) mod gpu;
mod images;
mod motion;
mod picture;
mod sort;
mod tiles;
mod window;

use rayon::prelude::*;
use schema_frames::DvsEvent;
use sensor_spec::{DvsMode, DvsSpec};

use chance::Chance;
pub use images::{EventImages, Rows};
use motion::{Motion, MotionMemory};
use picture::Picture;
use sensor_core::vector::vectorised;
use sort::Sorter;
use window::{Row, Window};

/// What a frame of events came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EventsMade {
    /// Events written.
    pub n_events: usize,
    /// Events that did not fit.
    pub n_dropped: u64,
    /// Whether this was the first picture, which makes no events.
    pub first: bool,
}

/// An event camera: fed with pictures, it makes events. Needs no GPU.
#[derive(Debug)]
pub struct EventCamera {
    spec: DvsSpec,
    size_px: [usize; 2],
    chance: Chance,
    /// Factor of both thresholds, per pixel; empty without mismatch.
    mismatch: Vec<f32>,
    /// Level at the last event, per pixel.
    references: Vec<f32>,
    /// Rest of the refractory period at the end of the last window, per pixel; empty without such a
    /// period.
    silent_nanos: Vec<u32>,
    rows: Vec<Vec<DvsEvent>>,
    sorter: Sorter,
    motion: MotionMemory,
    previous: Option<Picture>,
    /// The picture before, for its memory.
    spare: Option<Picture>,
    previous_window_nanos: u64,
    n_windows: u64,
}

impl EventCamera {
    /// A camera of `[width, height]` pixels; `seed` and `sensor` say what its chance depends on.
    pub fn new(spec: DvsSpec, size_px: [u32; 2], seed: u64, sensor: u64) -> Self {
        let size_px = size_px.map(|side| side as usize);
        let n_pixels = size_px[0] * size_px[1];
        let chance = chance_of(&spec, seed, sensor);
        EventCamera {
            mismatch: chance.mismatch(&spec, n_pixels),
            chance,
            size_px,
            references: vec![0.0; n_pixels],
            silent_nanos: if spec.refractory_nanos > 0 {
                vec![0; n_pixels]
            } else {
                Vec::new()
            },
            rows: vec![Vec::new(); size_px[1]],
            sorter: Sorter::default(),
            motion: MotionMemory::default(),
            previous: None,
            spare: None,
            previous_window_nanos: 0,
            n_windows: 0,
            spec,
        }
    }

    /// Follows the window that ends now and writes its events to `out`, sorted by time, y, x.
    pub fn advance(
        &mut self,
        images: &EventImages<'_>,
        window_nanos: u64,
        out: &mut [u8],
    ) -> EventsMade {
        let mut now = self
            .spare
            .take()
            .unwrap_or_else(|| Picture::blank(self.size_px));
        now.read(images, &self.spec);
        let previous = self.previous.take();
        let Some(previous) = previous.filter(|_| window_nanos > 0) else {
            self.begin(&now);
            self.previous = Some(now);
            self.previous_window_nanos = 0;
            return EventsMade {
                n_events: 0,
                n_dropped: 0,
                first: true,
            };
        };
        let ratio = if self.previous_window_nanos > 0 {
            window_nanos as f32 / self.previous_window_nanos as f32
        } else {
            0.0
        };
        self.follow(&previous, &now, ratio, window_nanos, images);
        self.add_shots(images, window_nanos);
        self.previous = Some(now);
        self.spare = Some(previous);
        self.previous_window_nanos = window_nanos;
        self.n_windows += 1;
        let n_made: usize = self.rows.iter().map(Vec::len).sum();
        let n_events = self.write(n_made, window_nanos, out);
        EventsMade {
            n_events,
            n_dropped: (n_made - n_events) as u64,
            first: false,
        }
    }

    /// Writes the events to the front of `out`, as many as it and the limit take; returns how many.
    fn write(&mut self, n_made: usize, window_nanos: u64, out: &mut [u8]) -> usize {
        let max_events =
            self.spec
                .max_events_of(self.size_px[0] as u32, self.size_px[1] as u32) as usize;
        let n_events = n_made
            .min(max_events)
            .min(out.len() / size_of::<DvsEvent>());
        let room = &mut out[..n_events * size_of::<DvsEvent>()];
        match bytemuck::try_cast_slice_mut(room) {
            Ok(place) if n_events == n_made => self.sorter.sort(&self.rows, window_nanos, place),
            _ => {
                let mut all = vec![bytemuck::Zeroable::zeroed(); n_made];
                self.sorter.sort(&self.rows, window_nanos, &mut all);
                room.copy_from_slice(bytemuck::cast_slice(&all[..n_events]));
            }
        }
        n_events
    }

    /// Takes the first picture as what every pixel remembers.
    fn begin(&mut self, picture: &Picture) {
        let leaks = self.spec.leak_rate_hz > 0.0;
        for (i, (reference, level)) in self.references.iter_mut().zip(&picture.level).enumerate() {
            let leaked = if leaks {
                self.chance.phase(i) * self.spec.positive_threshold
            } else {
                0.0
            };
            *reference = *level - leaked;
        }
        self.silent_nanos.fill(0);
    }

    fn add_shots(&mut self, images: &EventImages<'_>, window_nanos: u64) {
        let (width, rows) = (self.size_px[0], &mut self.rows);
        let light =
            |pixel: usize| float(&images.luminance.row(pixel / width)[4 * (pixel % width)..]);
        self.chance.shots(
            &self.spec,
            self.n_windows,
            window_nanos,
            self.references.len(),
            light,
            |pixel, nanos, polarity| {
                let (x, y) = (pixel % width, pixel / width);
                let id = word(&images.instance.row(y)[4 * x..]);
                rows[y].push(chance::shot_event(
                    pixel,
                    width,
                    nanos,
                    polarity,
                    id,
                    images.class.row(y)[x],
                ));
            },
        );
    }

    /// Fills `rows` with the events of the window.
    fn follow(
        &mut self,
        previous: &Picture,
        now: &Picture,
        ratio: f32,
        window_nanos: u64,
        images: &EventImages<'_>,
    ) {
        let width = self.size_px[0];
        let motion = match self.spec.mode {
            DvsMode::Motion => Some(Motion::between(
                previous,
                now,
                ratio,
                self.spec.substep_px,
                &mut self.motion,
            )),
            DvsMode::TwoFrame => None,
        };
        let window = Window {
            previous,
            now,
            motion: motion.as_ref(),
            spec: &self.spec,
            mismatch: &self.mismatch,
            chance: &self.chance,
            number: self.n_windows,
            nanos: window_nanos.min(u32::MAX as u64) as u32,
            leak: self.spec.leak_rate_hz
                * self.spec.positive_threshold
                * window_nanos as f32
                * 1e-9,
        };
        let rows = self
            .references
            .par_chunks_mut(width)
            .zip(&mut self.rows)
            .enumerate();
        if self.silent_nanos.is_empty() {
            rows.for_each(|(y, (references, events))| {
                vectorised(Row {
                    window: &window,
                    y,
                    references,
                    silent_nanos: &mut [],
                    images,
                    events,
                });
            });
        } else {
            rows.zip(self.silent_nanos.par_chunks_mut(width)).for_each(
                |((y, (references, events)), silent_nanos)| {
                    vectorised(Row {
                        window: &window,
                        y,
                        references,
                        silent_nanos,
                        images,
                        events,
                    });
                },
            );
        }
    }
}

/// What an event camera's chance depends on.
fn chance_of(spec: &DvsSpec, seed: u64, sensor: u64) -> Chance {
    Chance::new(seed, sensor ^ schema_types::noise::mix(spec.noise_seed))
}

fn float(bytes: &[u8]) -> f32 {
    f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}
