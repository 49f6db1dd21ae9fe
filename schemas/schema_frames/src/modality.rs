//! What a frame shows: the name that ends its topic, its encoding number and the size of one
//! element.

/// Kind of sensor, as in [`crate::FrameHeader::kind`].
#[repr(u16)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum SensorKind {
    /// A view: any of the camera modalities.
    Camera = 1,
    /// Lidar or semantic lidar.
    Lidar = 2,
    /// Radar.
    Radar = 3,
    /// Inertial measurement unit.
    Imu = 4,
    /// Satellite positioning.
    Gnss = 5,
    /// Collision, lane invasion, obstacle.
    Event = 6,
}

impl SensorKind {
    /// The kind with this number, if there is one.
    pub fn from_code(code: u16) -> Option<Self> {
        [
            Self::Camera,
            Self::Lidar,
            Self::Radar,
            Self::Imu,
            Self::Gnss,
            Self::Event,
        ]
        .into_iter()
        .find(|k| *k as u16 == code)
    }
}

macro_rules! modalities {
    ($($(#[$doc:meta])* $variant:ident = $code:literal, $name:literal, $bytes:literal, $kind:ident;)*) => {
        /// A stream of frames of one encoding. The number is [`crate::FrameHeader::encoding`].
        #[repr(u16)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Modality { $($(#[$doc])* $variant = $code,)* }

        impl Modality {
            /// Every modality in the order of its number.
            pub const ALL: &[Modality] = &[$(Modality::$variant,)*];

            /// Last segment of the topic.
            pub const fn name(self) -> &'static str {
                match self { $(Modality::$variant => $name,)* }
            }

            /// Size of one pixel or list element, bytes.
            pub const fn element_bytes(self) -> usize {
                match self { $(Modality::$variant => $bytes,)* }
            }

            /// Kind of sensor that makes it.
            pub const fn sensor_kind(self) -> SensorKind {
                match self { $(Modality::$variant => SensorKind::$kind,)* }
            }
        }
    };
}

modalities! {
    /// `height × width` pixels B G R A `u8`, sRGB, A = 255.
    Rgb = 1, "rgb", 4, Camera;
    /// `height × width` `f32`, metres along the optical axis; +∞ where nothing was hit.
    Depth = 2, "depth", 4, Camera;
    /// `height × width` `u8` class number.
    Semantic = 3, "semantic", 1, Camera;
    /// `height × width` `u32` object id; 0 is the background.
    Instance = 4, "instance", 4, Camera;
    /// `height × width` pairs of `f32`, pixels: where this point is now minus where it was at the
    /// previous firing; x right, y down.
    Flow = 5, "flow", 8, Camera;
    /// `height × width` four `f16`: unit normal in world space, 0.
    Normals = 6, "normals", 8, Camera;
    /// List of [`crate::DvsEvent`], sorted by time, then y, then x.
    Dvs = 7, "dvs", 16, Camera;
    /// List of [`crate::LidarPoint`], channel after channel.
    Lidar = 8, "lidar", 16, Lidar;
    /// List of [`crate::SemanticLidarPoint`], channel after channel.
    SemanticLidar = 9, "semantic_lidar", 24, Lidar;
    /// List of [`crate::RadarDetection`], in the order of the rays.
    Radar = 10, "radar", 32, Radar;
    /// One [`crate::ImuSample`].
    Imu = 11, "imu", 72, Imu;
    /// One [`crate::GnssSample`].
    Gnss = 12, "gnss", 40, Gnss;
    /// List of [`crate::CollisionEvent`], ordered by what was touched; sent only for ticks with a
    /// collision.
    Collision = 13, "collision", 64, Event;
    /// List of [`crate::LaneCrossing`], ordered by time; sent only for ticks with a crossing.
    LaneInvasion = 14, "lane_invasion", 32, Event;
    /// One [`crate::ObstacleEvent`]; sent only for ticks with an obstacle.
    Obstacle = 15, "obstacle", 32, Event;
    /// List of [`crate::LidarReturn`], channel after channel.
    LidarReturns = 16, "lidar_returns", 32, Lidar;
}

impl Modality {
    /// The modality with this number, if there is one.
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.iter().copied().find(|m| *m as u16 == code)
    }

    /// The modality with this topic name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|m| m.name() == name)
    }

    /// Whether frames are sent only for ticks in which something happened. The `seq` of such frames
    /// counts these ticks, whether anybody reads or not.
    pub const fn is_event(self) -> bool {
        matches!(
            self,
            Modality::Collision | Modality::LaneInvasion | Modality::Obstacle
        )
    }

    /// Whether frames are `height × width` images; the others are lists with height 1.
    pub const fn is_image(self) -> bool {
        (self as u16) <= Modality::Normals as u16
    }
}
