//! How things are drawn, as far as users choose it.

use clap::ValueEnum;

/// How images go to the viewer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Images {
    /// Colour as JPEG, distances as PNG in centimetres (from 10 m on the step grows with the
    /// distance), classes, objects and events as PNG without loss.
    #[default]
    Jpeg,
    /// As `jpeg`, but colour as H.264: smallest, for slow lines; windows need ffmpeg for it.
    H264,
    /// Every value as the sensor sent it; some twenty times as large.
    Raw,
}

/// How things are drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// How images go to the viewer.
    pub images: Images,
    /// Quality of JPEGs, 1 to 100.
    pub quality: u8,
    /// Most points that are shown of a cloud; larger clouds are thinned evenly.
    pub max_points: usize,
    /// Whether boxes of the actors are drawn over images that have instance ids beside them.
    pub truth: bool,
    /// Whether event cameras get a picture of how long ago each pixel changed, too.
    pub time_surface: bool,
    /// Whether the window is divided by us, rather than by a blueprint of the user's.
    pub arranges: bool,
}

impl Default for Look {
    fn default() -> Look {
        Look {
            images: Images::default(),
            quality: 80,
            max_points: 20_000,
            truth: true,
            time_surface: false,
            arranges: true,
        }
    }
}
