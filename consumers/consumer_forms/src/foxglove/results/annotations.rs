//! Boxes, tracks, masks and key points as Foxglove's annotations of images. Both count pixels from
//! the outer corner of the top-left one.

use consumer_kit::items::{MAX_KEYPOINTS, is_box, mask_columns, part};
use fox::points_annotation::Type;
use foxglove::messages as fox;
use schema_frames::{Box2d, Keypoint, KeypointSet, MaskRecord, Track};

use super::shot::{OPACITY, Shot};
use super::state::ResultConverter;
use crate::foxglove::frames::timestamp;
use schema_recording::messages::{Content, Entry};

/// Most pieces of columns that show the masks of one result.
const MAX_COLUMNS: usize = 1 << 20;
const FONT_PX: f64 = 14.0;
const LINE_PX: f64 = 2.0;

impl ResultConverter {
    pub(super) fn boxes2d(&mut self, shot: &Shot<'_>) -> Entry {
        let mut drawing = Drawing::new(shot);
        for it in shot.parts.records::<Box2d>() {
            let colour = shot.colour(it.class, it.id, false, 1.0);
            let label = shot.parts.label(it.class, it.score, it.id);
            drawing.rectangle(it.min_px, it.max_px, colour, label);
        }
        self.finish(drawing)
    }

    pub(super) fn tracks(&mut self, shot: &Shot<'_>) -> Vec<Entry> {
        let (topic, tracks) = (shot.parts.topic, shot.parts.records::<Track>());
        let mut drawing = Drawing::new(shot);
        let alive = || tracks.iter().filter(|track| track.state < 3);
        for it in alive().filter(|it| it.flags & Track::IN_IMAGE != 0) {
            let colour = shot.colour(it.class, it.id, true, 1.0);
            let label = shot.parts.label(it.class, it.score, it.id);
            drawing.rectangle(it.min_px, it.max_px, colour, label);
        }
        let mut entries = vec![self.finish(drawing)];
        let in_space: Vec<&Track> = alive()
            .filter(|it| it.flags & Track::IN_SPACE != 0)
            .collect();
        if !in_space.is_empty() && !self.in_space.contains(topic) {
            self.in_space.insert(topic.to_owned());
        }
        if self.in_space.contains(topic) {
            entries.push(self.tracks3d(shot, &in_space));
        }
        entries
    }

    pub(super) fn masks(&mut self, shot: &Shot<'_>) -> Entry {
        let runs = shot.parts.tail::<u32>();
        let size = [shot.parts.header.width, shot.parts.header.height];
        let (mut drawing, mut n_columns) = (Drawing::new(shot), 0);
        for mask in shot.parts.records::<MaskRecord>() {
            let colour = |opacity| shot.colour(mask.class, mask.id, true, opacity);
            let label = shot.parts.label(mask.class, mask.score, mask.id);
            drawing.rectangle(mask.min_px, mask.max_px, colour(1.0), label);
            let columns = part(&runs, mask.first_run, mask.n_runs)
                .and_then(|runs| mask_columns(runs, size))
                .filter(|columns| n_columns + columns.len() <= MAX_COLUMNS);
            let Some(columns) = columns else {
                drawing.bad(
                    1,
                    "a mask's runs go beyond the list of runs or beyond the image",
                );
                continue;
            };
            n_columns += columns.len();
            // One line of a pixel's width down each piece of a column.
            let ends = columns.iter().flat_map(|column| {
                let x = column.x as f64 + 0.5;
                [point(x, column.first as f64), point(x, column.end as f64)]
            });
            drawing.lines(Type::LineList, ends.collect(), colour(OPACITY), 1.0);
        }
        self.finish(drawing)
    }

    pub(super) fn keypoints(&mut self, shot: &Shot<'_>) -> Entry {
        let all = shot.parts.tail::<Keypoint>();
        let (mut drawing, mut n_points) = (Drawing::new(shot), 0);
        for set in shot.parts.records::<KeypointSet>() {
            let points = part(&all, set.first_point, set.n_points);
            let points = points.filter(|points| n_points + points.len() <= MAX_KEYPOINTS);
            let Some(points) = points else {
                drawing.bad(1, "a set of key points names points that are not there");
                continue;
            };
            n_points += points.len();
            let place = |it: &Keypoint| {
                let [x, y] = it.at_px;
                let is_finite = x.is_finite() && y.is_finite();
                (it.visibility != 0 && is_finite).then(|| point(x as f64, y as f64))
            };
            let labelled = points.iter().filter(|it| it.visibility != 0).count();
            let places: Vec<fox::Point2> = points.iter().filter_map(place).collect();
            drawing.bad(
                (labelled - places.len()) as u64,
                "a key point is not finite",
            );
            let colour = shot.colour(set.class, set.id, true, 1.0);
            if let Some(first) = places.first() {
                let label = shot.parts.label(set.class, set.score, set.id);
                drawing.text(*first, label, colour);
            }
            let end = |idx: u32| points.get(idx as usize).and_then(place);
            let bones = shot.parts.about.bones.iter();
            let bones = bones.filter_map(|[from, to]| Some([end(*from)?, end(*to)?]));
            let bones: Vec<fox::Point2> = bones.flatten().collect();
            drawing.lines(Type::Points, places, colour, 3.0 * LINE_PX);
            drawing.lines(Type::LineList, bones, colour, LINE_PX);
        }
        self.finish(drawing)
    }

    fn finish(&mut self, drawing: Drawing<'_, '_>) -> Entry {
        for (n, why) in drawing.bad {
            self.bad.note(drawing.shot.parts.topic, n, why);
        }
        drawing
            .shot
            .entry(Content::ImageAnnotations, &drawing.message)
    }
}

/// Annotations of one image.
struct Drawing<'s, 'a> {
    shot: &'s Shot<'a>,
    message: fox::ImageAnnotations,
    /// Numbers of items that cannot be drawn, and why.
    bad: Vec<(u64, &'static str)>,
}

impl<'s, 'a> Drawing<'s, 'a> {
    fn new(shot: &'s Shot<'a>) -> Self {
        let message = fox::ImageAnnotations {
            timestamp: Some(timestamp(shot.sim_nanos)),
            ..Default::default()
        };
        Drawing {
            shot,
            message,
            bad: Vec::new(),
        }
    }

    fn bad(&mut self, n: u64, why: &'static str) {
        if n > 0 {
            self.bad.push((n, why));
        }
    }

    fn rectangle(&mut self, min: [f32; 2], max: [f32; 2], colour: fox::Color, label: String) {
        if !is_box(min, max) {
            let why = "a box is not finite, or its corners are in the wrong order";
            return self.bad(1, why);
        }
        let ([left, top], [right, bottom]) = (min.map(f64::from), max.map(f64::from));
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        let corners = corners.map(|(x, y)| point(x, y));
        self.text(corners[0], label, colour);
        self.lines(Type::LineLoop, corners.to_vec(), colour, LINE_PX);
    }

    fn text(&mut self, position: fox::Point2, text: String, colour: fox::Color) {
        self.message.texts.push(fox::TextAnnotation {
            timestamp: Some(timestamp(self.shot.sim_nanos)),
            position: Some(position),
            text,
            font_size: FONT_PX,
            text_color: Some(colour),
            ..Default::default()
        });
    }

    fn lines(&mut self, of: Type, points: Vec<fox::Point2>, colour: fox::Color, thickness: f64) {
        if points.is_empty() {
            return;
        }
        self.message.points.push(fox::PointsAnnotation {
            timestamp: Some(timestamp(self.shot.sim_nanos)),
            r#type: of as i32,
            points,
            outline_color: Some(colour),
            thickness,
            ..Default::default()
        });
    }
}

fn point(x: f64, y: f64) -> fox::Point2 {
    fox::Point2 { x, y }
}
