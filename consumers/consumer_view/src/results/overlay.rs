//! Boxes, tracks, masks and key points on the image that they answer.

use std::collections::BTreeSet;

use consumer_kit::items::{MAX_KEYPOINTS, MAX_MASK_PIXELS, is_box, mask_columns, part};
use rerun::{Radius, Rgba32};
use schema_frames::{Box2d, Keypoint, KeypointSet, MaskRecord, Track};

use super::canvas::{Canvas, class_id};
use super::state::Results;
use crate::pictures::{Over, Pictures};

use crate::rerun;

/// Order in which rerun draws: images have −10, boxes 10.
const MASK_ORDER: f32 = 1.0;
const MASK_OPACITY: f32 = 0.55;
/// Thickness of a box's lines and of a lost track's, points of the screen.
const LINE: f32 = 1.8;
const FAINT_LINE: f32 = 0.8;
const NOT_A_BOX: &str = "a box is not finite, or its corners are in the wrong order";

/// A box as it is drawn.
struct Drawn {
    min_px: [f32; 2],
    max_px: [f32; 2],
    class: u32,
    label: String,
    colour: Rgba32,
    line: f32,
}

impl Results {
    pub(super) fn boxes2d(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let boxes = parts.records::<Box2d>();
        let drawn = boxes.iter().map(|it| Drawn {
            min_px: it.min_px,
            max_px: it.max_px,
            class: it.class,
            label: parts.label(it.class, it.score, it.id),
            colour: canvas.colour(it.class, it.id, false),
            line: LINE,
        });
        let path = self.on_image(canvas)?;
        self.labelled.extend(canvas.image());
        self.rectangles(canvas, &path, drawn, true)
    }

    pub(super) fn tracks(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let tracks = parts.records::<Track>();
        // A track that has ended is in the result for the last time, and is not drawn.
        let alive = || tracks.iter().filter(|track| track.state < 3);
        let in_image = |track: &&Track| track.flags & Track::IN_IMAGE != 0;
        if alive().any(|track| in_image(&track)) || self.drawn.contains_key(parts.topic) {
            let drawn = alive().filter(in_image).map(|it| Drawn {
                min_px: it.min_px,
                max_px: it.max_px,
                class: it.class,
                label: parts.label(it.class, it.score, it.id),
                colour: canvas.colour(it.class, it.id, true),
                line: if it.state == 1 { LINE } else { FAINT_LINE },
            });
            let path = self.on_image(canvas)?;
            self.labelled.extend(canvas.image());
            self.rectangles(canvas, &path, drawn, true)?;
        }
        let in_space: Vec<&Track> = alive()
            .filter(|track| track.flags & Track::IN_SPACE != 0)
            .collect();
        self.tracks3d(canvas, &in_space)
    }

    fn rectangles(
        &mut self,
        canvas: &Canvas<'_>,
        path: &str,
        boxes: impl Iterator<Item = Drawn>,
        show_labels: bool,
    ) -> anyhow::Result<()> {
        let (good, bad): (Vec<Drawn>, Vec<Drawn>) =
            boxes.partition(|it| is_box(it.min_px, it.max_px));
        self.bad
            .note(canvas.parts.topic, bad.len() as u64, NOT_A_BOX);
        let size = |it: &Drawn| [it.max_px[0] - it.min_px[0], it.max_px[1] - it.min_px[1]];
        let list = rerun::Boxes2D::from_mins_and_sizes(
            good.iter().map(|it| it.min_px),
            good.iter().map(size),
        )
        .with_class_ids(good.iter().map(|it| class_id(it.class)))
        .with_colors(good.iter().map(|it| it.colour))
        .with_radii(good.iter().map(|it| Radius::new_ui_points(it.line)))
        .with_labels(good.iter().map(|it| it.label.as_str()))
        .with_show_labels(show_labels);
        self.draw(canvas, path, good.is_empty(), &list)
    }

    pub(super) fn masks(
        &mut self,
        canvas: &Canvas<'_>,
        pictures: &mut Pictures,
    ) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let (masks, runs) = (parts.records::<MaskRecord>(), parts.tail::<u32>());
        let size = [parts.header.width, parts.header.height];
        let (mut n_bad, mut budget) = (0, MAX_MASK_PIXELS);
        let mut numbers: Vec<u8> = Vec::new();
        let mut colours = vec![[0; 3]];
        for mask in &masks {
            let columns = part(&runs, mask.first_run, mask.n_runs)
                .and_then(|runs| mask_columns(runs, size))
                .unwrap_or_default();
            let n_pixels: u64 = columns.iter().map(|it| (it.end - it.first) as u64).sum();
            if n_pixels > budget || (columns.is_empty() && mask.n_runs > 1) {
                n_bad += 1;
                continue;
            }
            budget -= n_pixels;
            if numbers.is_empty() {
                numbers = vec![0; size[0] as usize * size[1] as usize];
            }
            let [r, g, b, _] = canvas.colour(mask.class, mask.id, true).to_array();
            let number = number_of([r, g, b], &mut colours);
            for column in columns {
                for y in column.first..column.end {
                    numbers[y as usize * size[0] as usize + column.x as usize] = number;
                }
            }
        }
        let why = "a mask's runs go beyond the list of runs or beyond the image";
        self.bad.note(parts.topic, n_bad, why);
        let path = self.on_image(canvas)?;
        let is_empty = numbers.is_empty();
        if is_empty {
            // One clear pixel takes the place of the picture before.
            numbers = vec![0];
        }
        let shown = if is_empty { [1, 1] } else { size };
        let layer = format!("{path}/pixels");
        let is_drawn = |drawn: &BTreeSet<String>| drawn.contains(&layer);
        if !is_empty || self.drawn.get(parts.topic).is_some_and(is_drawn) {
            self.note_drawn(canvas, &layer);
            let over = Over {
                opacity: MASK_OPACITY,
                order: MASK_ORDER,
            };
            pictures.overlay(canvas.rec, &layer, shown, &colours, &numbers, over)?;
        }
        let boxes = masks.iter().map(|it| Drawn {
            min_px: it.min_px,
            max_px: it.max_px,
            class: it.class,
            label: parts.label(it.class, it.score, it.id),
            colour: canvas.colour(it.class, it.id, true),
            line: FAINT_LINE,
        });
        let said = canvas
            .image()
            .is_some_and(|image| self.labelled.contains(&image));
        self.rectangles(canvas, &path, boxes, !said)
    }

    pub(super) fn keypoints(&mut self, canvas: &Canvas<'_>) -> anyhow::Result<()> {
        let parts = canvas.parts;
        let (sets, all) = (parts.records::<KeypointSet>(), parts.tail::<Keypoint>());
        let (mut at, mut colours, mut labels) = (Vec::new(), Vec::new(), Vec::new());
        let (mut bones, mut bone_colours) = (Vec::new(), Vec::new());
        let mut n_bad = 0;
        for set in &sets {
            let points = part(&all, set.first_point, set.n_points).unwrap_or_default();
            let fits = at.len() + points.len() <= MAX_KEYPOINTS;
            if !fits || (points.is_empty() && set.n_points > 0) {
                n_bad += 1;
                continue;
            }
            let colour = canvas.colour(set.class, set.id, true);
            let labelled = |point: &&Keypoint| point.visibility != 0;
            let drawable = |point: &&Keypoint| point.at_px.iter().all(|px| px.is_finite());
            n_bad += points
                .iter()
                .filter(labelled)
                .filter(|it| !drawable(it))
                .count() as u64;
            for (idx, point) in points.iter().filter(labelled).filter(drawable).enumerate() {
                at.push(point.at_px);
                colours.push(colour);
                labels.push(match idx {
                    0 => parts.label(set.class, set.score, set.id),
                    _ => String::new(),
                });
            }
            for [from, to] in &parts.about.bones {
                let end = |idx: u32| points.get(idx as usize).filter(labelled).filter(drawable);
                if let (Some(from), Some(to)) = (end(*from), end(*to)) {
                    bones.push([from.at_px, to.at_px]);
                    bone_colours.push(colour);
                }
            }
        }
        let why = "a key point is not finite, or a set names points that are not there";
        self.bad.note(parts.topic, n_bad, why);
        let path = self.on_image(canvas)?;
        let points = rerun::Points2D::new(at.iter().copied())
            .with_colors(colours)
            .with_radii([Radius::new_ui_points(3.0)])
            .with_labels(labels)
            .with_show_labels(true);
        self.draw(canvas, &path, at.is_empty(), &points)?;
        let lines = rerun::LineStrips2D::new(bones.iter().copied())
            .with_colors(bone_colours)
            .with_radii([Radius::new_ui_points(LINE)]);
        self.draw(canvas, &format!("{path}/bones"), bones.is_empty(), &lines)
    }
}

/// Number of a colour, which is added to the list if it is new and there is room.
fn number_of(colour: [u8; 3], colours: &mut Vec<[u8; 3]>) -> u8 {
    let known = colours.iter().skip(1).position(|known| *known == colour);
    match known {
        Some(at) => at as u8 + 1,
        None if colours.len() < 256 => {
            colours.push(colour);
            (colours.len() - 1) as u8
        }
        None => 255,
    }
}
