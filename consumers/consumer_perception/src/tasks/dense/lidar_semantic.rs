//! A class for every point: mean intersection over union over the points of the exact cloud.
//!
//! A program labels the cloud that it got. Truth is the exact cloud of the query; each of its points
//! takes the label of the nearest labelled point in the world within [`REACH_M`], and is unanswered
//! without one. Of the answered frame itself these are the same points.

use std::collections::{HashMap, VecDeque};

use consumer_metrics::classes::{Collector, Settings};
use nalgebra::{Isometry3, Point3};
use schema_frames::{
    ElementType, LidarPoint, LidarReturn, Modality, ResultType, SemanticLidarPoint,
};

use super::semantic::{bad, ignored};
use crate::evidence::moment::Moment;
use crate::suite::SuiteFault;
use crate::tasks::Unreadable;
use crate::tasks::classes::{semantic_table, semantic_targets};
use crate::tasks::spaces::EgoPoses;
use crate::tasks::{Bad, Context, Headline, Measure, Reading, Spec};

/// Farthest distance of a label from the point that takes it, metres.
pub const REACH_M: f32 = 0.5;

/// Clouds of the input that are held for results that are labels alone.
const HELD_CLOUDS: usize = 64;

/// Labelled points in the world, in cells of [`REACH_M`].
#[derive(Debug, Default)]
pub struct Labelled {
    cells: HashMap<[i32; 3], Vec<(Point3<f32>, u8)>>,
}

impl Labelled {
    fn cell(at: &Point3<f32>) -> [i32; 3] {
        [at.x, at.y, at.z].map(|part| (part / REACH_M).floor() as i32)
    }

    /// Labelled points.
    pub fn new(points: impl IntoIterator<Item = (Point3<f32>, u8)>) -> Labelled {
        let mut labelled = Labelled::default();
        for (at, class) in points {
            if at.iter().all(|part| part.is_finite()) {
                let cell = labelled.cells.entry(Labelled::cell(&at)).or_default();
                cell.push((at, class));
            }
        }
        labelled
    }

    /// The class of the nearest labelled point within reach.
    pub fn nearest(&self, at: &Point3<f32>) -> Option<u8> {
        let [x, y, z] = Labelled::cell(at);
        let mut best = (REACH_M * REACH_M, None);
        let mut look = |cell: [i32; 3]| {
            for (other, class) in self.cells.get(&cell).into_iter().flatten() {
                let distance = (other - at).norm_squared();
                if distance < best.0 || (distance <= best.0 && best.1.is_none()) {
                    best = (distance, Some(*class));
                }
            }
            best.0
        };
        // Mostly the very point is there.
        if look([x, y, z]) < 1e-4 {
            return best.1;
        }
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    if [dx, dy, dz] != [0, 0, 0] {
                        look([x + dx, y + dy, z + dz]);
                    }
                }
            }
        }
        best.1
    }
}

/// The measure.
pub struct LidarSemantic {
    spec: Spec,
    ignored: Vec<u8>,
    poses: EgoPoses,
    clouds: VecDeque<(u64, Vec<Point3<f32>>)>,
    now: Option<(u64, Vec<Point3<f32>>, Vec<u8>)>,
}

impl LidarSemantic {
    /// For a task.
    ///
    /// # Errors
    /// A sentence if a class cannot be asked for.
    pub fn new(spec: &Spec) -> Result<LidarSemantic, SuiteFault> {
        Ok(LidarSemantic {
            spec: spec.clone(),
            ignored: ignored(&semantic_targets(&spec.classes)?),
            poses: EgoPoses::default(),
            clouds: VecDeque::new(),
            now: None,
        })
    }

    /// Points of a result with fields.
    fn points(&self, reading: &Reading<'_>) -> Result<Labelled, Unreadable> {
        let (fields, _) = reading.about.point_fields();
        let field = |names: &[&str]| {
            let found = fields
                .iter()
                .find(|field| names.contains(&field.name.as_str()));
            let found =
                found.ok_or_else(|| format!("has points without a field {:?}", names[0]))?;
            let element = ElementType::from_name(&found.element);
            let element =
                element.ok_or_else(|| format!("has a field {:?} of no type", names[0]))?;
            Ok::<_, String>((found.offset as usize, element))
        };
        let class = field(&["class", "label"])?;
        let [x, y, z] = [field(&["x"])?, field(&["y"])?, field(&["z"])?];
        let world_from_space = self.poses.world_from_space(&reading.result.header)?;
        let table = semantic_table(reading.about);
        let step = reading.result.header.element_bytes as usize;
        let mut points = Vec::new();
        for point in reading.body.chunks_exact(step.max(1)) {
            let value = |(offset, element)| {
                number(point, offset, element).ok_or("has points shorter than their fields")
            };
            let at = Point3::new(value(x)?, value(y)?, value(z)?);
            let class = class_of(&table, value(class)?);
            points.push(((world_from_space * at).cast(), class));
        }
        Ok(Labelled::new(points))
    }

    /// Labels alone, of the cloud that the result answers.
    fn labels(&self, reading: &Reading<'_>) -> Result<Labelled, Unreadable> {
        let header = &reading.result.header;
        let of_input = reading.result.inputs.iter();
        let of_input = of_input.filter(|input| input.topic() == self.spec.input);
        let tick = of_input
            .map(|input| input.tick)
            .max()
            .unwrap_or(header.tick);
        let cloud = self.clouds.iter().find(|(other, _)| *other == tick);
        let (_, cloud) = cloud.ok_or_else(|| {
            format!("labels the cloud of tick {tick}, which is not held any more")
        })?;
        if header.n_items as usize != cloud.len() {
            return Err(format!(
                "has {} labels for a cloud of {} points",
                header.n_items,
                cloud.len()
            )
            .into());
        }
        let element = header.element_type().ok_or("has no type of elements")?;
        let table = semantic_table(reading.about);
        let labelled = cloud.iter().enumerate().map(|(at, point)| {
            let label = number(reading.body, at * element.element_bytes(), element);
            (*point, class_of(&table, label.unwrap_or(f64::NAN)))
        });
        Ok(Labelled::new(labelled))
    }
}

/// A class of a program's, by CARLA's numbers; 255 is no answer.
fn class_of(table: &[u8; 256], label: f64) -> u8 {
    let is_number = (0.0..256.0).contains(&label);
    if is_number {
        table[label as usize]
    } else {
        255
    }
}

/// A number of some type within bytes; `None` beyond their end.
fn number(bytes: &[u8], offset: usize, element: ElementType) -> Option<f64> {
    macro_rules! read {
        ($kind:ty) => {
            <$kind>::from_le_bytes(
                bytes
                    .get(offset..offset + size_of::<$kind>())?
                    .try_into()
                    .ok()?,
            ) as f64
        };
    }
    Some(match element {
        ElementType::U8 | ElementType::Bool => read!(u8),
        ElementType::I8 => read!(i8),
        ElementType::U16 => read!(u16),
        ElementType::I16 => read!(i16),
        ElementType::U32 => read!(u32),
        ElementType::I32 => read!(i32),
        ElementType::U64 => read!(u64),
        ElementType::I64 => read!(i64),
        ElementType::F32 => read!(f32),
        ElementType::F64 => read!(f64),
        ElementType::F16 => f64::NAN,
    })
}

/// Points of a cloud in the world.
fn in_world(points: &[[f32; 3]], world_from_sensor: &Isometry3<f64>) -> Vec<Point3<f32>> {
    let placed = points
        .iter()
        .map(|point| world_from_sensor * Point3::from(point.map(f64::from)));
    placed.map(|point| point.cast()).collect()
}

impl Measure for LidarSemantic {
    type Estimate = Labelled;
    type Part = Collector;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "mIoU",
            unit: "",
            higher_is_better: true,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        self.poses.begin(context);
        self.clouds.clear();
        self.now = None;
        Ok(())
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        self.poses.watch(moment);
        let input = moment.set.frames.iter();
        let input = input.filter(|frame| *frame.topic == *self.spec.input);
        for frame in input {
            let points: Vec<[f32; 3]> = match frame.modality {
                Modality::Lidar => {
                    let points = frame.elements::<LidarPoint>().into_iter();
                    points.map(|point| point.hit_in_sensor_m).collect()
                }
                Modality::SemanticLidar => {
                    let points = frame.elements::<SemanticLidarPoint>().into_iter();
                    points.map(|point| point.hit_in_sensor_m).collect()
                }
                Modality::LidarReturns => {
                    let points = frame.elements::<LidarReturn>().into_iter();
                    points.map(|point| point.hit_in_sensor_m).collect()
                }
                _ => continue,
            };
            let placed = in_world(&points, &frame.header.world_from_sensor.isometry());
            self.clouds.push_back((frame.header.tick, placed));
            if self.clouds.len() > HELD_CLOUDS {
                self.clouds.pop_front();
            }
        }
        let truth = moment.frame(&self.spec.truth, Modality::SemanticLidar);
        self.now = truth.map(|frame| {
            let points = frame.elements::<SemanticLidarPoint>();
            let hits: Vec<[f32; 3]> = points.iter().map(|point| point.hit_in_sensor_m).collect();
            let placed = in_world(&hits, &frame.header.world_from_sensor.isometry());
            let classes = points.iter().map(|point| point.class).collect();
            (frame.header.tick, placed, classes)
        });
    }

    fn empty(&self) -> Collector {
        Collector::new(Settings {
            ignored: self.ignored.clone(),
        })
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Labelled, Unreadable> {
        match reading.result.header.kind() {
            Some(ResultType::Points) => self.points(reading),
            _ => self.labels(reading),
        }
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Labelled>) -> Option<Collector> {
        let (_, points, classes) = self
            .now
            .as_ref()
            .filter(|(tick, ..)| *tick == moment.set.tick)?;
        let label = |point: &Point3<f32>| estimate.and_then(|found| found.nearest(point));
        let found: Vec<u8> = points
            .iter()
            .map(|point| label(point).unwrap_or(u8::MAX))
            .collect();
        let mut part = self.empty();
        part.add(classes, &found, None).ok()?;
        Some(part)
    }

    fn add(&self, total: &mut Collector, part: &Collector) {
        total.merge(part);
    }

    fn bad(&self, part: &Collector) -> Option<Bad> {
        bad(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_takes_the_nearest_label_within_reach_as_comparing_all_does() {
        let mut rng = fastrand::Rng::with_seed(5);
        let mut point = || Point3::new(rng.f32(), rng.f32(), rng.f32()) * 8.0;
        let labelled: Vec<(Point3<f32>, u8)> = (0..200u8).map(|class| (point(), class)).collect();
        let cells = Labelled::new(labelled.iter().copied());
        for _ in 0..500 {
            let at = point();
            let distance = |other: &Point3<f32>| (other - at).norm_squared();
            let nearest = labelled
                .iter()
                .min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)))
                .filter(|(other, _)| distance(other) <= REACH_M * REACH_M);
            assert_eq!(cells.nearest(&at), nearest.map(|(_, class)| *class));
        }
    }

    #[test]
    fn numbers_of_all_types_are_read_where_they_stand() {
        let mut bytes = vec![7u8];
        bytes.extend((-3i16).to_le_bytes());
        bytes.extend(2.5f64.to_le_bytes());
        assert_eq!(number(&bytes, 0, ElementType::U8), Some(7.0));
        assert_eq!(number(&bytes, 1, ElementType::I16), Some(-3.0));
        assert_eq!(number(&bytes, 3, ElementType::F64), Some(2.5));
        assert_eq!(number(&bytes, 4, ElementType::F64), None);
        let table = semantic_table(&schema_frames::About::default());
        assert_eq!((class_of(&table, -1.0), class_of(&table, 14.0)), (255, 14));
    }
}
