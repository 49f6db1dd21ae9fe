//! What is uploaded for one submission.

use schema_types::noise::Noise;
use schema_types::{ActorId, ObjectId};
use sensor_gpu::Place;
use sensor_spec::LidarSpec;

use super::pairs::{pair, pair_of_pairs, rows};
use super::shader::CHUNK_RAYS;
use crate::lidar::{Lidar, SensorPath, column_poses, keep_limit};

/// One lidar's frame to be made.
#[derive(Debug)]
pub struct ScanJob<'l, 'p> {
    /// The lidar, its head turned.
    pub lidar: &'l mut Lidar,
    /// Where it was.
    pub path: SensorPath,
    /// Key (seed, sensor, tick).
    pub noise: Noise,
    /// Rays pass through the parts of this actor.
    pub ignored: Option<ActorId>,
    /// Where the points go: room for a point per ray.
    pub place: Place<'p>,
}

/// A lidar as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct LidarWords {
    pub shape: [u32; 4],
    pub place: [u32; 4],
    pub what: [u32; 4],
    pub noise: [u32; 4],
    pub range: [f32; 4],
    pub loss: [f32; 4],
    /// Output that its points go to, first word there, first of the counts that its packing clears
    /// for the next submission.
    pub out: [u32; 4],
}

impl LidarWords {
    pub fn n_rays(&self) -> u32 {
        self.shape[0] * self.shape[1]
    }

    /// Bytes of a point for every ray.
    pub fn n_bytes(&self) -> usize {
        4 * (self.noise[3] * self.n_rays()) as usize
    }

    pub fn n_chunks(&self) -> u32 {
        self.noise[2]
    }

    /// First of its words among the points that are not packed yet.
    pub fn first_word(&self) -> u32 {
        self.place[2]
    }

    /// Moves its counts to the half of the memory that begins at `own`; those of the other half,
    /// which begins at `other`, it clears.
    pub fn count_in(&mut self, own: u32, other: u32) {
        self.out[2] = other + self.place[3];
        self.place[3] += own;
    }
}

/// Lidars of one submission with their tables.
#[derive(Default)]
pub(super) struct Submission {
    pub lidars: Vec<LidarWords>,
    pub tables: Vec<[f32; 4]>,
    pub n_words: u32,
    pub n_chunks: u32,
}

impl Submission {
    /// Adds a job and returns where its points go.
    pub fn add<'p>(&mut self, job: ScanJob<'_, 'p>) -> Place<'p> {
        let ScanJob {
            lidar,
            path,
            noise,
            ignored,
            place,
        } = job;
        let spec = lidar.spec().clone();
        let beams = lidar.aim();
        let (n_channels, n_columns) = (beams.elevations.len() as u32, beams.azimuths.len() as u32);
        let first_elevation = self.tables.len() as u32;
        self.tables
            .extend(beams.elevations.iter().map(pair_of_pairs));
        let first_azimuth = self.tables.len() as u32;
        self.tables.extend(beams.azimuths.iter().map(pair_of_pairs));
        let poses = column_poses(&spec, &path, n_columns as usize);
        let first_pose = self.tables.len() as u32;
        for pose in &poses {
            self.tables
                .extend(rows(&pose.world_from_sensor, &pose.origin_m.coords));
        }
        let (n_rays, point_words) = (n_channels * n_columns, if spec.semantic { 6 } else { 4 });
        let n_chunks = n_rays.div_ceil(CHUNK_RAYS).max(1);
        let ignored = ignored.map_or(0, |actor| ObjectId::from(actor).0);
        let misfires = misfires(&spec);
        let key = noise.key();
        let [range_high, range_low] = pair(spec.range_m);
        self.lidars.push(LidarWords {
            shape: [n_channels, n_columns, first_elevation, first_azimuth],
            place: [first_pose, poses.len() as u32, self.n_words, self.n_chunks],
            what: [
                spec.semantic as u32,
                ignored,
                misfires as u32,
                (misfires >> 32) as u32,
            ],
            noise: [key as u32, (key >> 32) as u32, n_chunks, point_words],
            range: [
                range_high,
                range_low,
                spec.attenuation_per_m as f32,
                spec.noise_range_stddev_m as f32,
            ],
            loss: [
                keep_limit(&spec) as f32,
                spec.dropoff_intensity_limit as f32,
                spec.dropoff_zero_intensity_ratio as f32,
                0.0,
            ],
            out: [0; 4],
        });
        self.n_words += n_rays * point_words;
        self.n_chunks += n_chunks;
        place
    }
}

/// Numerator over 2⁵³ below which a uniform number loses a ray: `k/2⁵³ < ratio` exactly if `k` is
/// below it.
fn misfires(spec: &LidarSpec) -> u64 {
    if spec.semantic {
        0
    } else {
        (spec.dropoff_general_ratio * (1u64 << 53) as f64).ceil() as u64
    }
}
