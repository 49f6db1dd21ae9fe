//! What a sensor remembers between firings.

use nalgebra::Isometry3;
use schema_frames::{FrameHeader, Modality, RadarDetection};
use schema_types::{ActorId, Lens};
use sensor_camera::{View, ViewSpec};
use sensor_core::imu::{ImuState, STANDARD_GRAVITY_MPS2};
use sensor_core::lane_marks::Corners;
use sensor_ray::{Lidar, RayCamera};
use sensor_spec::{CameraSpec, SensorSpec};

use crate::carrier::Carrier;

/// What a sensor remembers between firings.
pub enum Model {
    /// A view of the renderer.
    View(Box<View>),
    /// A camera with a lens.
    Lens(Box<LensCamera>),
    /// Lidar: its beam tables, and the pose at its previous firing for motion distortion.
    Lidar {
        /// Beams and memory of the last turn.
        lidar: Box<Lidar>,
        /// Pose at the previous firing.
        previous: Option<Isometry3<f64>>,
        /// Poses at the previous tick and at this one.
        ticks: [Option<Isometry3<f64>>; 2],
    },
    /// Radar: memory of its last detections.
    Radar(Vec<RadarDetection>),
    /// IMU: the motion of the body it sits on.
    Imu(ImuState),
    /// GNSS.
    Gnss,
    /// Obstacle detector.
    Obstacle,
    /// Collision detector.
    Collision,
    /// Lane invasion detector: where its carrier's box was at the previous tick.
    LaneInvasion {
        /// Lower corners.
        corners: Option<Corners>,
    },
}

/// A camera with a lens.
pub struct LensCamera {
    /// The direction of each pixel; `None` if it makes no labels.
    pub rays: Option<RayCamera>,
    /// Renders its colour; `None` if it makes none.
    pub view: Option<Box<View>>,
    /// Width and height.
    pub size_px: [u32; 2],
    /// `optics` of its headers.
    pub optics: u32,
    /// `calibration_crc` of its headers.
    pub calibration_crc: u32,
    /// Actors that its images leave out, by rising id.
    pub hidden: Vec<ActorId>,
}

impl LensCamera {
    fn new(lens: &Lens, camera: &CameraSpec, seed: u64, sensor_id: u32) -> LensCamera {
        let size_px = [camera.width_px, camera.height_px];
        let is_rendered = |modality: &Modality| *modality == Modality::Rgb;
        let modalities = &camera.modalities;
        let has_view = modalities.iter().any(is_rendered);
        let has_rays = !modalities.iter().all(is_rendered);
        let view = || {
            Box::new(View::of(ViewSpec {
                lens: Some(lens.clone()),
                ..view_spec(camera, seed, sensor_id)
            }))
        };
        LensCamera {
            rays: has_rays.then(|| RayCamera::new(lens, size_px)),
            view: has_view.then(view),
            size_px,
            optics: u32::from(lens.model().number()) | FrameHeader::DEPTH_ALONG_RAY,
            calibration_crc: FrameHeader::crc_of(lens, size_px),
            hidden: Vec::new(),
        }
    }

    /// Leaves these actors out of all images from now on, and no others.
    pub fn hide(&mut self, actors: &[ActorId]) {
        self.hidden = actors.to_vec();
        self.hidden.sort_unstable();
        if let Some(view) = &mut self.view {
            view.hide(actors.iter().copied());
        }
    }

    /// Says in a header which lens its image was made through.
    pub fn tell(&self, header: &mut FrameHeader) {
        let [width_px, height_px] = self.size_px;
        header.lens = [f32::NAN; 4];
        header.optics = self.optics;
        header.calibration_crc = self.calibration_crc;
        header.set_image(width_px, height_px);
    }
}

/// What a camera's view is made from, without a lens and without what the spectator alone sees.
fn view_spec(camera: &CameraSpec, seed: u64, sensor_id: u32) -> ViewSpec {
    ViewSpec {
        dvs: camera.dvs.clone(),
        optics: camera.optics.clone(),
        seed,
        sensor_id,
        ..ViewSpec::pinhole(camera.intrinsics())
    }
}

impl Model {
    /// The model of a sensor that has seen nothing yet.
    pub fn new(spec: &SensorSpec, seed: u64, sensor_id: u32, shows_overlay: bool) -> Model {
        if let SensorSpec::Camera(camera) = spec
            && let Some(lens) = camera.lens()
        {
            let camera = LensCamera::new(&lens, camera, seed, sensor_id);
            return Model::Lens(Box::new(camera));
        }
        match spec {
            SensorSpec::Camera(camera) => Model::View(Box::new(View::of(ViewSpec {
                shows_overlay,
                ..view_spec(camera, seed, sensor_id)
            }))),
            SensorSpec::Lidar(lidar) => Model::Lidar {
                lidar: Box::new(Lidar::new(lidar.clone())),
                previous: None,
                ticks: [None; 2],
            },
            SensorSpec::Imu(imu) => Model::Imu(ImuState::new(imu)),
            SensorSpec::Gnss(_) => Model::Gnss,
            SensorSpec::Radar(_) => Model::Radar(Vec::new()),
            SensorSpec::Obstacle(_) => Model::Obstacle,
            SensorSpec::Collision(_) => Model::Collision,
            SensorSpec::LaneInvasion(_) => Model::LaneInvasion { corners: None },
        }
    }

    /// Whether it needs the scene's triangles as rays see them.
    pub fn casts_rays(&self) -> bool {
        match self {
            Model::Lens(camera) => camera.rays.is_some(),
            Model::Lidar { .. } | Model::Radar(_) | Model::Obstacle => true,
            _ => false,
        }
    }

    /// The view that the renderer draws, of a camera that has one.
    pub fn view(&self) -> Option<&View> {
        match self {
            Model::View(view) => Some(view),
            Model::Lens(camera) => camera.view.as_deref(),
            _ => None,
        }
    }

    /// The same to draw it.
    pub fn view_mut(&mut self) -> Option<&mut View> {
        match self {
            Model::View(view) => Some(view),
            Model::Lens(camera) => camera.view.as_deref_mut(),
            _ => None,
        }
    }

    /// Whether its view makes images of `modality`; rays make the others of a camera with a lens.
    pub fn renders(&self, modality: Modality) -> bool {
        match self {
            Model::View(_) => true,
            Model::Lens(camera) => camera.view.is_some() && modality == Modality::Rgb,
            _ => false,
        }
    }

    /// Whether it measures its own motion and place, for which it needs nothing of the scene.
    pub fn is_motion(&self) -> bool {
        matches!(self, Model::Imu(_) | Model::Gnss)
    }

    /// Whether its rays see what moves where it was when they were fired.
    pub fn looks_back(&self) -> bool {
        matches!(self, Model::Lidar { lidar, .. } if lidar.spec().motion_distortion)
    }

    /// Whether a frame of it takes much of a tick.
    pub fn is_costly(&self) -> bool {
        matches!(self, Model::View(_) | Model::Lens(_) | Model::Lidar { .. })
    }

    /// Takes note of a tick, whether the sensor fires or not.
    pub fn follow(&mut self, carrier: &Carrier) {
        match self {
            Model::Imu(state) => {
                state.push(carrier.body, &carrier.mount(), STANDARD_GRAVITY_MPS2);
            }
            Model::Lidar { ticks, .. } => {
                *ticks = [ticks[1], Some(carrier.world_from_sensor.isometry())]
            }
            _ => {}
        }
    }

    /// Forgets everything, as if just made.
    pub fn reset(&mut self) {
        match self {
            Model::View(view) => view.reset(),
            Model::Lidar {
                lidar,
                previous,
                ticks,
            } => {
                lidar.reset();
                (*previous, *ticks) = (None, [None; 2]);
            }
            Model::Imu(state) => state.reset(),
            Model::LaneInvasion { corners } => *corners = None,
            Model::Lens(camera) => camera.view.iter_mut().for_each(|view| view.reset()),
            Model::Radar(_) | Model::Gnss | Model::Obstacle | Model::Collision => {}
        }
    }
}
