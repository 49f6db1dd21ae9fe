//! A view: a lens, its state from firing to firing, and what is asked of it in one tick.

use std::sync::Arc;

use nalgebra::Isometry3;
use parking_lot::Mutex;
use schema_frames::Modality;
use schema_types::{ActorId, Distortion, Lens};
use sensor_gpu::{Gpu, Place};
use sensor_spec::{DvsSpec, Intrinsics, OpticsSpec, drawn_by};

use crate::camera_motion::Firing;
use crate::dvs::{EventCamera, GpuEventCamera};
use crate::faces::{FacePlan, FaceTable};
use crate::target::{TargetSet, Targets, Turns};

/// The constant properties of a view.
#[derive(Clone, Debug)]
pub struct ViewSpec {
    /// Lens and resolution.
    pub intrinsics: Intrinsics,
    /// A calibrated lens in place of the pinhole, of which only the size is left then. Such a view
    /// makes `rgb` alone.
    pub lens: Option<Lens>,
    /// Exposure, lens and white balance of `rgb`.
    pub optics: OpticsSpec,
    /// Event camera; used only if `dvs` is asked for.
    pub dvs: DvsSpec,
    /// Seed of the run, for the mismatch of the event camera's thresholds.
    pub seed: u64,
    /// Sensor id: keeps the noise of sensors apart.
    pub sensor_id: u32,
    /// Whether `rgb` shows what the spectator alone sees: texts, and shapes on the screen.
    pub shows_overlay: bool,
}

impl ViewSpec {
    /// A lens with default optics and event camera, seed and id 0.
    pub fn pinhole(intrinsics: Intrinsics) -> ViewSpec {
        ViewSpec {
            intrinsics,
            lens: None,
            optics: OpticsSpec::default(),
            dvs: DvsSpec::default(),
            seed: 0,
            sensor_id: 0,
            shows_overlay: false,
        }
    }
}

/// Persistent state of one camera. Render targets are made when they are first needed.
pub struct View {
    pub(crate) spec: ViewSpec,
    /// The pinhole camera that is drawn: that of `spec`, or with margins if the lens bends.
    pub(crate) drawn: Intrinsics,
    /// Actors that it does not show, by rising id.
    pub(crate) hidden: Vec<ActorId>,
    /// Of a calibrated lens: its faces, and where the picture's pixels lie in them.
    pub(crate) plan: Option<Arc<FacePlan>>,
    /// A view for each face of `plan`.
    pub(crate) faces: Vec<View>,
    /// Whether it is a face of another view.
    pub(crate) is_face: bool,
    /// `plan`'s table on the GPU.
    pub(crate) face_table: Option<FaceTable>,
    /// Bent images: those of this firing and of the one before.
    pub(crate) bent: [Arc<Targets>; 2],
    /// Targets for compute shaders, shared with views of equal size.
    pub(crate) turns: Option<Arc<Turns>>,
    /// Targets for drawing: those of this firing and, if the copy queue may still read them, those
    /// of the firing before.
    pub(crate) targets: [Arc<Targets>; 2],
    /// All targets that were ever asked for; they are kept.
    pub(crate) kept: TargetSet,
    pub(crate) previous: Option<Firing>,
    pub(crate) dvs: Option<Arc<Mutex<EventCamera>>>,
    /// Replaces `dvs` where the GPU follows events.
    pub(crate) gpu_events: Option<GpuEventCamera>,
    /// State of automatic exposure: EV100, and whether it is known.
    pub(crate) meter: Option<wgpu::Buffer>,
    /// Whether the meter starts in this firing.
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
    /// A view that has not fired. Nothing is allocated on the GPU yet.
    pub fn new(_gpu: &Gpu, spec: ViewSpec) -> View {
        View::of(spec)
    }

    /// As [`View::new`], where no GPU is at hand yet.
    pub fn of(spec: ViewSpec) -> View {
        let drawn = match spec.optics.distortion() {
            Some(bend) => drawn_by(&bend, &spec.intrinsics),
            None => spec.intrinsics,
        };
        let size_px = [spec.intrinsics.width_px, spec.intrinsics.height_px];
        let plan = spec.lens.as_ref().map(|lens| FacePlan::new(lens, size_px));
        let face = |intrinsics: Intrinsics| View {
            is_face: true,
            ..View::of(ViewSpec::pinhole(intrinsics))
        };
        let faces = plan.iter().flat_map(|plan| &plan.faces);
        View {
            faces: faces.map(|it| face(it.intrinsics)).collect(),
            plan: plan.map(Arc::new),
            is_face: false,
            face_table: None,
            spec,
            drawn,
            hidden: Vec::new(),
            bent: Default::default(),
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

    /// Leaves these actors out of all images from now on, and no others. Their shadows stay.
    pub fn hide(&mut self, actors: impl Iterator<Item = ActorId>) {
        self.hidden = actors.collect();
        self.hidden.sort_unstable();
        self.hidden.dedup();
    }

    /// How its lens bends lines; `None` for a pinhole.
    pub fn lens(&self) -> Option<Distortion> {
        self.spec.optics.distortion()
    }

    /// Its lens.
    pub fn intrinsics(&self) -> Intrinsics {
        self.spec.intrinsics
    }

    /// Payload bytes of a frame of `modality`; for `dvs` the upper limit.
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

    /// Gives back all that it has on the GPU, and forgets what [`View::reset`] forgets.
    pub fn release(&mut self) {
        self.reset();
        self.faces.iter_mut().for_each(View::release);
        self.face_table = None;
        self.bent = Default::default();
        self.turns = None;
        self.targets = Default::default();
    }

    /// Forgets the previous firing and the event camera's state, as if the sensor had just been
    /// made.
    pub fn reset(&mut self) {
        self.faces.iter_mut().for_each(View::reset);
        self.previous = None;
        self.dvs = None;
        self.gpu_events = None;
        self.meter = None;
    }
}

/// One frame that has a reader.
#[derive(Debug)]
pub struct Output<'a> {
    /// What it shows.
    pub modality: Modality,
    /// Where its bytes go; at least [`View::payload_bytes`] long (`dvs`: any length, it bounds the
    /// number of events).
    pub place: Place<'a>,
}

/// One scheduled firing of a view. Pass it even without readers (`outputs` empty), because flow
/// refers to the previous *scheduled* firing.
#[derive(Debug)]
pub struct ViewJob<'v, 'a> {
    /// The view.
    pub view: &'v mut View,
    /// Pose of the sensor (x forward, y left, z up).
    pub world_from_sensor: Isometry3<f64>,
    /// Outputs with readers; a modality that is an image may have several places.
    pub outputs: Vec<Output<'a>>,
}

impl<'a> ViewJob<'_, 'a> {
    /// The same job for a while; its outputs go with it.
    pub(crate) fn reborrow(&mut self) -> ViewJob<'_, 'a> {
        ViewJob {
            view: &mut *self.view,
            world_from_sensor: self.world_from_sensor,
            outputs: std::mem::take(&mut self.outputs),
        }
    }
}
