//! A view: a lens, what it remembers from firing to firing, and what is asked of it in one tick.

use std::sync::{Arc, Mutex};

use nalgebra::Isometry3;
use schema_frames::Modality;
use sensor_gpu::{Gpu, Place};
use sensor_spec::{DvsSpec, Intrinsics, OpticsSpec};

use crate::camera_motion::Firing;
use crate::dvs::{EventCamera, GpuEventCamera};
use crate::target::{TargetSet, Targets, Turns};

/// What a view is for as long as it lives.
#[derive(Clone, Debug)]
pub struct ViewSpec {
    /// Lens and resolution.
    pub intrinsics: Intrinsics,
    /// Exposure, lens and white balance of `rgb`.
    pub optics: OpticsSpec,
    /// Event camera; matters only if `dvs` is ever asked for.
    pub dvs: DvsSpec,
    /// Seed of the run, for the mismatch of the event camera's thresholds.
    pub seed: u64,
    /// Sensor id: keeps the noise of sensors apart.
    pub sensor_id: u32,
}

impl ViewSpec {
    /// A lens and nothing special: optics and event camera as by default, seed and id 0.
    pub fn pinhole(intrinsics: Intrinsics) -> ViewSpec {
        ViewSpec {
            intrinsics,
            optics: OpticsSpec::default(),
            dvs: DvsSpec::default(),
            seed: 0,
            sensor_id: 0,
        }
    }
}

/// Persistent state of one camera. Render targets are made when they are first needed.
pub struct View {
    pub(crate) spec: ViewSpec,
    /// Where compute shaders write them: shared with its likes.
    pub(crate) turns: Option<Arc<Turns>>,
    /// Where it is drawn: those of this firing and, where they are copied beside the next drawing,
    /// those of the firing before.
    pub(crate) targets: [Arc<Targets>; 2],
    /// Everything that was ever asked of it: targets stay.
    pub(crate) kept: TargetSet,
    pub(crate) previous: Option<Firing>,
    pub(crate) dvs: Option<Arc<Mutex<EventCamera>>>,
    /// In its place where the GPU follows events.
    pub(crate) gpu_events: Option<GpuEventCamera>,
    /// Of automatic exposure: EV100, and whether there is one.
    pub(crate) meter: Option<wgpu::Buffer>,
    /// Whether it begins anew in this firing.
    pub(crate) meter_begins: bool,
}

impl std::fmt::Debug for View {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("View")
            .field("spec", &self.spec)
            .finish_non_exhaustive()
    }
}

impl View {
    /// A view that has not fired. Allocates nothing on the GPU yet.
    pub fn new(_gpu: &Gpu, spec: ViewSpec) -> View {
        View {
            spec,
            turns: None,
            targets: Default::default(),
            kept: TargetSet::default(),
            previous: None,
            dvs: None,
            gpu_events: None,
            meter: None,
            meter_begins: false,
        }
    }

    /// Its lens.
    pub fn intrinsics(&self) -> Intrinsics {
        self.spec.intrinsics
    }

    /// Bytes one frame of `modality` has; for `dvs` the most it can have.
    pub fn payload_bytes(&self, modality: Modality) -> usize {
        let n_elements = if modality == Modality::Dvs {
            self.spec.dvs.max_events_of(
                self.spec.intrinsics.width_px,
                self.spec.intrinsics.height_px,
            ) as usize
        } else {
            self.spec.intrinsics.width_px as usize * self.spec.intrinsics.height_px as usize
        };
        n_elements * modality.element_bytes()
    }

    /// Forgets the previous firing and the event camera's state, as if the sensor had just been
    /// made.
    pub fn reset(&mut self) {
        self.previous = None;
        self.dvs = None;
        self.gpu_events = None;
        self.meter = None;
    }
}

/// One frame that somebody reads.
#[derive(Debug)]
pub struct Output<'a> {
    /// What it shows.
    pub modality: Modality,
    /// Where its bytes go; at least [`View::payload_bytes`] long (`dvs`: any length, it bounds the
    /// number of events).
    pub place: Place<'a>,
}

/// One scheduled firing of a view. Pass it even when nobody reads (`outputs` empty): flow refers to
/// the previous *scheduled* firing.
#[derive(Debug)]
pub struct ViewJob<'v, 'a> {
    /// The view.
    pub view: &'v mut View,
    /// Pose of the sensor (x forward, y left, z up).
    pub world_from_sensor: Isometry3<f64>,
    /// What somebody reads, each modality at most once.
    pub outputs: Vec<Output<'a>>,
}
