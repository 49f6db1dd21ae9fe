//! What a result holds, item by item, for programs that show or store results of others: nothing
//! here trusts an index, a length or a number of the writer's.

use std::collections::BTreeMap;

use bytemuck::{Pod, pod_read_unaligned};
use half::f16;
use schema_bus::ResultSample;
use schema_frames::{About, ElementType, InputRecord, Modality, ResultHeader, ResultType};

/// Longest side of an image that masks are unpacked for, pixels.
pub const MAX_SIDE_PX: u32 = 16_384;
/// Most pixels that the masks of one result may cover together.
pub const MAX_MASK_PIXELS: u64 = 1 << 28;
/// Most key points of one result that are shown.
pub const MAX_KEYPOINTS: usize = 1 << 20;
/// Bins of the histogram of a tensor.
pub const HISTOGRAM_BINS: usize = 64;

/// A result whose header has passed its check, in any memory.
#[derive(Clone, Copy, Debug)]
pub struct ResultParts<'a> {
    /// Its topic without the domain.
    pub topic: &'a str,
    /// Its header.
    pub header: &'a ResultHeader,
    /// Its type.
    pub kind: ResultType,
    /// The body, `body_bytes` long.
    pub body: &'a [u8],
    /// What it answers.
    pub inputs: &'a [InputRecord],
    /// Description of its topic.
    pub about: &'a About,
}

impl<'a> ResultParts<'a> {
    /// The parts of a result in shared memory.
    pub fn of(sample: &'a ResultSample, about: &'a About) -> Self {
        ResultParts {
            topic: sample.topic(),
            header: sample.header(),
            kind: sample.kind(),
            body: sample,
            inputs: sample.inputs(),
            about,
        }
    }

    /// Its records, copied; empty if they are not `T`'s size.
    pub fn records<T: Pod>(&self) -> Vec<T> {
        if self.header.element_bytes as usize != size_of::<T>() {
            return Vec::new();
        }
        let end = self.header.n_items as usize * size_of::<T>();
        copied(self.body.get(..end).unwrap_or_default())
    }

    /// What lies behind its records, copied: runs or key points.
    pub fn tail<T: Pod>(&self) -> Vec<T> {
        let start = self.header.n_items as usize * self.header.element_bytes as usize;
        copied(self.body.get(start..).unwrap_or_default())
    }

    /// Name of a class, confidence and number of an object in a few words: `Car 0.92 #7`. What the
    /// writer did not say is left out.
    pub fn label(&self, class: u32, score: f32, id: u32) -> String {
        let mut label = self.about.class_name(class);
        if score.is_finite() && score > 0.0 {
            label += &format!(" {score:.2}");
        }
        if id != 0 {
            label += &format!(" #{id}");
        }
        label
    }

    /// Its points' fields that lie inside a point.
    pub fn fields(&self) -> Vec<Field> {
        let (fields, _) = self.about.point_fields();
        let stride = self.header.element_bytes as usize;
        let field = |field: schema_frames::PointField| {
            let element = ElementType::from_name(&field.element)?;
            let offset = field.offset as usize;
            (offset + element.element_bytes() <= stride).then_some(Field {
                name: field.name,
                element,
                offset,
            })
        };
        fields.into_iter().filter_map(field).collect()
    }
}

fn copied<T: Pod>(bytes: &[u8]) -> Vec<T> {
    bytes
        .chunks_exact(size_of::<T>())
        .map(pod_read_unaligned)
        .collect()
}

/// The part of a list that a record names; `None` if it is not there.
pub fn part<T>(all: &[T], first: u32, n: u32) -> Option<&[T]> {
    let first = first as usize;
    all.get(first..first.checked_add(n as usize)?)
}

/// One field of the points of a cloud.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// Type of its value.
    pub element: ElementType,
    /// Where it begins in a point, bytes.
    pub offset: usize,
}

impl Field {
    /// Its value in a point; the point must be as long as the cloud's header says.
    pub fn of(&self, point: &[u8]) -> f64 {
        number(self.element, &point[self.offset..])
    }
}

/// The element that begins `bytes` as a number. Whole numbers beyond 2⁵³ are rounded.
///
/// # Panics
/// If `bytes` is shorter than the element.
pub fn number(of: ElementType, bytes: &[u8]) -> f64 {
    fn read<T: Pod>(bytes: &[u8]) -> T {
        pod_read_unaligned(&bytes[..size_of::<T>()])
    }
    match of {
        ElementType::U8 => bytes[0] as f64,
        ElementType::I8 => read::<i8>(bytes) as f64,
        ElementType::U16 => read::<u16>(bytes) as f64,
        ElementType::I16 => read::<i16>(bytes) as f64,
        ElementType::U32 => read::<u32>(bytes) as f64,
        ElementType::I32 => read::<i32>(bytes) as f64,
        ElementType::U64 => read::<u64>(bytes) as f64,
        ElementType::I64 => read::<i64>(bytes) as f64,
        ElementType::F16 => f16::from_bits(read(bytes)).to_f64(),
        ElementType::F32 => read::<f32>(bytes) as f64,
        ElementType::F64 => read(bytes),
        ElementType::Bool => (bytes[0] != 0) as u8 as f64,
    }
}

/// Whether a box in an image can be drawn: finite, and its largest corner not before its smallest.
pub fn is_box(min_px: [f32; 2], max_px: [f32; 2]) -> bool {
    let ordered = |axis: usize| min_px[axis] <= max_px[axis];
    min_px.iter().chain(&max_px).all(|px| px.is_finite()) && ordered(0) && ordered(1)
}

/// Whether a pose can be drawn: finite, and its quaternion of about unit length.
pub fn is_pose(pose: &schema_types::Pose) -> bool {
    let norm: f64 = pose.rotation_xyzw.iter().map(|x| x * x).sum();
    pose.translation_m.iter().all(|x| x.is_finite()) && (0.98..1.02).contains(&norm)
}

/// A piece of a column of an image: `x` and the rows `first..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Column.
    pub x: u32,
    /// First row.
    pub first: u32,
    /// Row after the last.
    pub end: u32,
}

/// The pixels of a mask from its runs: lengths of background and object in turn, column by column.
/// `None` if the runs go beyond the image, or a side of it is 0 or longer than [`MAX_SIDE_PX`].
pub fn mask_columns(runs: &[u32], size_px: [u32; 2]) -> Option<Vec<Column>> {
    let [width, height] = size_px;
    if !(1..=MAX_SIDE_PX).contains(&width) || !(1..=MAX_SIDE_PX).contains(&height) {
        return None;
    }
    let (n_pixels, height) = (width as u64 * height as u64, height as u64);
    let (mut at, mut columns) = (0u64, Vec::new());
    for (idx, run) in runs.iter().enumerate() {
        let end = at + *run as u64;
        if end > n_pixels {
            return None;
        }
        while idx % 2 == 1 && at < end {
            let x = at / height;
            let piece_end = end.min((x + 1) * height);
            columns.push(Column {
                x: x as u32,
                first: (at % height) as u32,
                end: (piece_end - x * height) as u32,
            });
            at = piece_end;
        }
        at = end;
    }
    Some(columns)
}

/// A tensor's numbers in figures. Numbers that are not finite count only in `n`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// All numbers.
    pub n: u64,
    /// Those that are finite.
    pub n_finite: u64,
    /// Smallest; 0 without a finite number, as the next three.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Numbers in [`HISTOGRAM_BINS`] bins of one width from `min` to `max`; empty without a finite
    /// number.
    pub histogram: Vec<u64>,
}

impl Figures {
    /// The figures of a tensor's body.
    pub fn of(element: ElementType, body: &[u8]) -> Figures {
        let numbers = || {
            body.chunks_exact(element.element_bytes())
                .map(|bytes| number(element, bytes))
        };
        let finite = || numbers().filter(|x| x.is_finite());
        let (min, max) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), x| {
            (min.min(x), max.max(x))
        });
        let mut figures = Figures {
            n: (body.len() / element.element_bytes()) as u64,
            ..Figures::default()
        };
        if min > max {
            return figures;
        }
        (figures.min, figures.max) = (min, max);
        figures.histogram = vec![0; HISTOGRAM_BINS];
        // Halves keep the width finite for the largest doubles.
        let half_width = (max * 0.5 - min * 0.5) / HISTOGRAM_BINS as f64;
        for x in finite() {
            figures.n_finite += 1;
            figures.mean += (x - figures.mean) / figures.n_finite as f64;
            let bin = match half_width > 0.0 {
                true => ((x * 0.5 - min * 0.5) / half_width) as usize,
                false => 0,
            };
            figures.histogram[bin.min(HISTOGRAM_BINS - 1)] += 1;
        }
        figures
    }

    /// The middle of each bin of the histogram.
    pub fn bins(&self) -> Vec<f64> {
        let middle = |bin: usize| (bin as f64 + 0.5) / HISTOGRAM_BINS as f64;
        (0..self.histogram.len())
            .map(|bin| self.min + (self.max - self.min) * middle(bin))
            .collect()
    }
}

/// Which sensor's frame stands at the beginning of each chain of results: a tracker answers a
/// detector, which answers a camera.
#[derive(Clone, Debug, Default)]
pub struct Chains {
    frames: BTreeMap<String, String>,
}

impl Chains {
    /// Topic of the frame that a result answers, through all results between; that of an earlier
    /// result of its topic if it names no input that is known. `None` if there was never one.
    pub fn frame_behind(&mut self, parts: &ResultParts<'_>) -> Option<&str> {
        let found = parts.inputs.iter().find_map(|input| {
            let topic = input.topic();
            let known = self.frames.get(&topic).cloned();
            known.or_else(|| ends_in_modality(&topic).then_some(topic))
        });
        if let Some(frame) = found
            && self.frames.get(parts.topic) != Some(&frame)
        {
            self.frames.insert(parts.topic.to_owned(), frame);
        }
        self.frames.get(parts.topic).map(String::as_str)
    }

    /// Says what was found otherwise, for example by the pose of a camera.
    pub fn remember(&mut self, topic: &str, frame: &str) {
        self.frames.insert(topic.to_owned(), frame.to_owned());
    }
}

fn ends_in_modality(topic: &str) -> bool {
    let last = topic.rsplit_once('/').map(|(_, last)| last);
    last.and_then(Modality::from_name).is_some()
}

/// Items of results that no program can show: boxes that are not finite, masks beyond their image.
/// They are counted by topic, and each topic's first is said.
#[derive(Clone, Debug, Default)]
pub struct BadItems {
    by_topic: BTreeMap<String, u64>,
}

impl BadItems {
    /// Counts `n` items of `topic` that are broken in the way that `what` says, as in "a box is not
    /// finite".
    pub fn note(&mut self, topic: &str, n: u64, what: &str) {
        if n == 0 {
            return;
        }
        match self.by_topic.get_mut(topic) {
            Some(count) => *count += n,
            None => {
                tracing::warn!(
                    topic,
                    n,
                    "a result cannot be shown whole: {what}; further ones are only counted"
                );
                self.by_topic.insert(topic.to_owned(), n);
            }
        }
    }

    /// Number of bad items by topic.
    pub fn by_topic(&self) -> &BTreeMap<String, u64> {
        &self.by_topic
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_go_down_the_columns_as_in_coco() {
        // 3 × 2 pixels; COCO's example of column order: pixels 1, 2 and 5 of 0..6.
        let columns = mask_columns(&[1, 2, 2, 1], [3, 2]).unwrap();
        let pixels: Vec<[u32; 2]> = columns
            .iter()
            .flat_map(|column| (column.first..column.end).map(|y| [column.x, y]))
            .collect();
        assert_eq!(pixels, [[0, 1], [1, 0], [2, 1]]);
        assert_eq!(mask_columns(&[], [3, 2]), Some(vec![]));
        assert_eq!(mask_columns(&[0, 6], [3, 2]).unwrap().len(), 3);
        for (runs, size) in [
            (&[1, 6][..], [3, 2]),
            (&[u32::MAX, u32::MAX, u32::MAX][..], [3, 2]),
            (&[0, 1][..], [0, 2]),
            (&[0, 1][..], [u32::MAX, 1]),
        ] {
            assert_eq!(mask_columns(runs, size), None, "{runs:?} of {size:?}");
        }
    }

    #[test]
    fn figures_leave_out_what_is_no_number() {
        let numbers = [1.0f32, 3.0, f32::NAN, 2.0, f32::INFINITY];
        let figures = Figures::of(ElementType::F32, bytemuck::cast_slice(&numbers));
        assert_eq!((figures.n, figures.n_finite), (5, 3));
        assert_eq!((figures.min, figures.max, figures.mean), (1.0, 3.0, 2.0));
        let histogram = &figures.histogram;
        assert_eq!((histogram[0], histogram[32], histogram[63]), (1, 1, 1));
        assert!(figures.bins()[0] > 1.0 && figures.bins()[63] < 3.0);
        let extreme = [f64::MIN, f64::MAX];
        let figures = Figures::of(ElementType::F64, bytemuck::cast_slice(&extreme));
        assert_eq!((figures.histogram[0], figures.histogram[63]), (1, 1));
        assert_eq!(Figures::of(ElementType::F16, &[]), Figures::default());
    }

    #[test]
    fn every_element_type_is_read_as_its_number() {
        let cases: &[(ElementType, &[u8], f64)] = &[
            (ElementType::U8, &[200], 200.0),
            (ElementType::I8, &[0xff], -1.0),
            (ElementType::U16, &[1, 2], 513.0),
            (ElementType::I16, &[0xfe, 0xff], -2.0),
            (ElementType::U32, &[0, 0, 0, 1], 16_777_216.0),
            (ElementType::I32, &[0xff; 4], -1.0),
            (ElementType::U64, &[1, 0, 0, 0, 0, 0, 0, 0], 1.0),
            (ElementType::I64, &[0xff; 8], -1.0),
            (ElementType::F16, &[0, 0xc0], -2.0),
            (ElementType::F32, &[0, 0, 0x80, 0x3f], 1.0),
            (ElementType::F64, &[0, 0, 0, 0, 0, 0, 0xf0, 0x3f], 1.0),
            (ElementType::Bool, &[7], 1.0),
        ];
        assert_eq!(cases.len(), ElementType::ALL.len());
        for (element, bytes, expected) in cases {
            assert_eq!(number(*element, bytes), *expected, "{element:?}");
        }
    }

    #[test]
    fn a_tracker_answers_the_camera_of_its_detector() {
        let (header, about) = (ResultHeader::new(ResultType::Tracks), About::default());
        let mut chains = Chains::default();
        let mut behind = |topic: &str, inputs: &[&str]| {
            let inputs: Vec<InputRecord> = inputs.iter().map(|it| InputRecord::new(it)).collect();
            let parts = ResultParts {
                topic,
                header: &header,
                kind: ResultType::Tracks,
                body: &[],
                inputs: &inputs,
                about: &about,
            };
            chains.frame_behind(&parts).map(str::to_owned)
        };
        assert_eq!(behind("tracker/tracks", &["detector/boxes"]), None);
        let camera = Some("ego/front/rgb".to_owned());
        assert_eq!(behind("detector/boxes", &["ego/front/rgb"]), camera);
        assert_eq!(behind("tracker/tracks", &["detector/boxes"]), camera);
        // A result without inputs belongs where those before it belonged.
        assert_eq!(behind("tracker/tracks", &[]), camera);
    }

    #[test]
    fn a_field_beyond_its_point_does_not_exist() {
        let mut header = ResultHeader::new(ResultType::Points);
        header.set_list(0, 12, 0);
        let about = About::default();
        let parts = ResultParts {
            topic: "a",
            header: &header,
            kind: ResultType::Points,
            body: &[],
            inputs: &[],
            about: &about,
        };
        let names: Vec<String> = parts.fields().into_iter().map(|field| field.name).collect();
        assert_eq!(names, ["x", "y", "z"]);
        assert_eq!(parts.label(14, 0.918, 7), "Car 0.92 #7");
        assert_eq!(parts.label(14, f32::NAN, 0), "Car");
    }
}
