//! The lidars of one submission, and the tables that are uploaded with them.

use schema_types::noise::Noise;
use schema_types::{ActorId, ObjectId};
use sensor_gpu::Place;
use sensor_spec::LidarSpec;

use super::pairs::{pair, pair_of_pairs, rows};
use super::shader::CHUNK_RAYS;
use crate::lidar::{Lidar, SensorPath, Times, column_poses, keep_limit};
use crate::ray_scene::Moment;

/// One frame of one lidar that is to be cast.
#[derive(Debug)]
pub struct ScanJob<'l, 'p> {
    /// The lidar; its head must have been turned already.
    pub lidar: &'l mut Lidar,
    /// Where it was while its head turned.
    pub path: SensorPath,
    /// Noise key (seed, sensor, tick).
    pub noise: Noise,
    /// Rays pass through the parts of this actor.
    pub ignored: Option<ActorId>,
    /// Where the points go; must have room for a point per ray.
    pub place: Place<'p>,
}

/// Stands for the moments of a lidar that has none.
pub(super) const ALL_AT_ONCE: u32 = u32::MAX;

/// A lidar as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct LidarWords {
    n_channels: u32,
    n_columns: u32,
    /// First row of its elevations, azimuths and poses in the tables.
    first_elevation: u32,
    first_azimuth: u32,
    first_pose: u32,
    /// 1, or one per column.
    n_poses: u32,
    /// First word of its unpacked points.
    first_word: u32,
    /// First of its counts of returns.
    first_chunk: u32,
    is_semantic: u32,
    /// Object that rays pass through; 0 for none.
    ignored: u32,
    /// General drop-off as a numerator over 2⁵³: low word, high word.
    misfires: [u32; 2],
    /// Noise key: low word, high word.
    noise_key: [u32; 2],
    n_chunks: u32,
    /// 32-bit words of a point.
    point_words: u32,
    /// Range as the sum of two numbers, metres.
    range_m: [f32; 2],
    attenuation_per_m: f32,
    noise_range_stddev_m: f32,
    /// Intensity from which on every return is kept.
    keep_limit: f32,
    dropoff_intensity_limit: f32,
    dropoff_zero_intensity_ratio: f32,
    /// Root of the hierarchy over instances that its rays walk.
    root: u32,
    /// Which output its points go to.
    output: u32,
    /// First word there.
    first_out: u32,
    /// First of the counts that its packing clears for the next submission.
    first_cleared: u32,
    /// First row of the moments of its columns in the tables; [`ALL_AT_ONCE`] if its rays see
    /// everything as it is at the tick.
    first_moment: u32,
}

impl LidarWords {
    pub fn n_rays(&self) -> u32 {
        self.n_channels * self.n_columns
    }

    /// Bytes that a point for every ray takes.
    pub fn n_bytes(&self) -> usize {
        4 * (self.point_words * self.n_rays()) as usize
    }

    pub fn n_chunks(&self) -> u32 {
        self.n_chunks
    }

    /// Where its words begin among the unpacked points.
    pub fn first_word(&self) -> u32 {
        self.first_word
    }

    pub fn n_channels(&self) -> u32 {
        self.n_channels
    }

    pub fn n_columns(&self) -> u32 {
        self.n_columns
    }

    /// Sends its points to an output of its dispatch, from `first_word` of that on.
    pub fn send_to(&mut self, output: u32, first_word: u32) {
        (self.output, self.first_out) = (output, first_word);
    }

    /// Places its counts of returns in the half of the memory that begins at `own`. Its packing
    /// clears the counts in the other half, which begins at `other`.
    pub fn count_in(&mut self, own: u32, other: u32) {
        self.first_cleared = other + self.first_chunk;
        self.first_chunk += own;
    }
}

/// The lidars of one submission, and their tables.
#[derive(Default)]
pub(super) struct Submission {
    pub lidars: Vec<LidarWords>,
    pub tables: Vec<[f32; 4]>,
    pub n_words: u32,
    pub n_chunks: u32,
}

impl Submission {
    /// Adds a job and returns where its points go.
    ///
    /// `ages_nanos` are those of the ticks that the scene's motion leads through, and `swept_root` is
    /// the root of the hierarchy over all places on the way.
    pub fn add<'p>(
        &mut self,
        job: ScanJob<'_, 'p>,
        ages_nanos: &[u64],
        swept_root: u32,
    ) -> Place<'p> {
        let ScanJob {
            lidar,
            path,
            noise,
            ignored,
            place,
        } = job;
        let spec = lidar.spec().clone();
        let past_nanos = lidar.past_nanos();
        let beams = lidar.aim();
        let (n_channels, n_columns) = (beams.elevations.len() as u32, beams.azimuths.len() as u32);
        let first_elevation = self.tables.len() as u32;
        self.tables
            .extend(beams.elevations.iter().map(pair_of_pairs));
        let first_azimuth = self.tables.len() as u32;
        self.tables.extend(beams.azimuths.iter().map(pair_of_pairs));
        let poses = column_poses(&spec, &path, n_columns as usize, 0);
        let first_pose = self.tables.len() as u32;
        for pose in &poses {
            self.tables
                .extend(rows(&pose.world_from_sensor, &pose.origin_m.coords));
        }
        let times = Times::new(&spec, n_columns as usize, past_nanos);
        let times = times.filter(|_| !ages_nanos.is_empty());
        let (root, first_moment) = match &times {
            Some(_) => (swept_root, self.tables.len() as u32),
            None => (0, ALL_AT_ONCE),
        };
        if let Some(times) = &times {
            let columns = 0..n_columns;
            self.tables.extend(columns.map(|column| {
                let moment = Moment::at(ages_nanos, times.age_of_column(column));
                // −1 stands for the tick itself.
                let (leg, share) = moment.map_or((-1.0, 0.0), |at| (at.leg as f32, at.share));
                let [high, low] = pair(share);
                [leg, high, low, 0.0]
            }));
        }
        let (n_rays, point_words) = (n_channels * n_columns, if spec.semantic { 6 } else { 4 });
        let n_chunks = n_rays.div_ceil(CHUNK_RAYS).max(1);
        let ignored = ignored.map_or(0, |actor| ObjectId::from(actor).0);
        self.lidars.push(LidarWords {
            n_channels,
            n_columns,
            first_elevation,
            first_azimuth,
            first_pose,
            n_poses: poses.len() as u32,
            first_word: self.n_words,
            first_chunk: self.n_chunks,
            is_semantic: spec.semantic as u32,
            ignored,
            misfires: words(misfires(&spec)),
            noise_key: words(noise.key()),
            n_chunks,
            point_words,
            range_m: pair(spec.range_m),
            attenuation_per_m: spec.attenuation_per_m as f32,
            noise_range_stddev_m: spec.noise_range_stddev_m as f32,
            keep_limit: keep_limit(&spec) as f32,
            dropoff_intensity_limit: spec.dropoff_intensity_limit as f32,
            dropoff_zero_intensity_ratio: spec.dropoff_zero_intensity_ratio as f32,
            root,
            output: 0,
            first_out: 0,
            first_cleared: 0,
            first_moment,
        });
        self.n_words += n_rays * point_words;
        self.n_chunks += n_chunks;
        place
    }
}

/// General drop-off as a numerator over 2⁵³: a ray is lost if its 53 random bits `k` are below this
/// number, which is the same as `k/2⁵³ < ratio`.
fn misfires(spec: &LidarSpec) -> u64 {
    if spec.semantic {
        0
    } else {
        (spec.dropoff_general_ratio * (1u64 << 53) as f64).ceil() as u64
    }
}

/// The low and the high word of a number.
fn words(number: u64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}
