//! The event camera on the CPU.

use rayon::prelude::*;
use schema_frames::DvsEvent;
use sensor_core::vector_lanes::in_lanes;
use sensor_spec::{DvsMode, DvsSpec};

use super::chance::Chance;
use super::events_made::EventsMade;
use super::images::{EventImages, float, word};
use super::level_image::LevelImage;
use super::motion_field::{MotionField, MotionMemory};
use super::sort::Sorter;
use super::stage::EVENTS;
use super::tiles::TILE_PX;
use super::window::{TileRow, Window};

/// An event camera: makes events from rendered images. Needs no GPU.
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
    previous: Option<LevelImage>,
    /// An earlier image whose allocation is reused.
    spare: Option<LevelImage>,
    previous_window_nanos: u64,
    n_windows: u64,
}

impl EventCamera {
    /// A camera of `[width, height]` pixels; its noise depends on `seed` and `sensor`.
    pub fn new(spec: DvsSpec, size_px: [u32; 2], seed: u64, sensor: u64) -> Self {
        let size_px = size_px.map(|side| side as usize);
        let n_pixels = size_px[0] * size_px[1];
        let chance = Chance::of_camera(&spec, seed, sensor);
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
        let _span = EVENTS.span();
        let mut now = self
            .spare
            .take()
            .unwrap_or_else(|| LevelImage::blank(self.size_px));
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

    /// Writes the events to the front of `out`, up to its length and the limit; returns their
    /// number.
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

    /// Initialises every pixel's reference from the first image.
    fn begin(&mut self, first: &LevelImage) {
        let leaks = self.spec.leak_rate_hz > 0.0;
        for (i, (reference, level)) in self.references.iter_mut().zip(&first.level).enumerate() {
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
                rows[y].push(DvsEvent {
                    nanos_in_window: nanos,
                    x_px: x as u16,
                    y_px: y as u16,
                    object_id: id,
                    polarity,
                    class: images.class.row(y)[x],
                    reserved: 0,
                });
            },
        );
    }

    /// Fills `rows` with the events of the window.
    fn follow(
        &mut self,
        previous: &LevelImage,
        now: &LevelImage,
        ratio: f32,
        window_nanos: u64,
        images: &EventImages<'_>,
    ) {
        let width = self.size_px[0];
        let motion = match self.spec.mode {
            DvsMode::Motion => Some(MotionField::between(
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
            .par_chunks_mut(TILE_PX * width)
            .zip(self.rows.par_chunks_mut(TILE_PX))
            .enumerate();
        let follow = |ty, references, events, silent_nanos| {
            in_lanes(TileRow {
                window: &window,
                ty,
                references,
                silent_nanos,
                images,
                events,
            });
        };
        if self.silent_nanos.is_empty() {
            rows.for_each_init(
                || EVENTS.span(),
                |_span, (ty, (references, events))| follow(ty, references, events, &mut []),
            );
        } else {
            rows.zip(self.silent_nanos.par_chunks_mut(TILE_PX * width))
                .for_each_init(
                    || EVENTS.span(),
                    |_span, ((ty, (references, events)), silent_nanos)| {
                        follow(ty, references, events, silent_nanos)
                    },
                );
        }
    }
}
