//! YOLO in two trees: `detect/` with boxes and `segment/` with outlines, each with its `data.yaml`.
//!
//! A label line is the class and numbers from 0 to 1 of the image's width and height. An object of
//! several parts has one outline that goes from part to part and back on the same line, so that it
//! encloses exactly the parts.

use std::fmt::Write as _;
use std::sync::Arc;

use schema_frames::Modality;
use serde_json::{Value, json};

use super::objects::{Object, cameras, image_name, keys, objects, wants};
use crate::classes;
use crate::exporter::{DoneScenario, Exporter, Format, splits};
use crate::options::Options;
use crate::picture;
use crate::tree::Tree;
use consumer_truth::scenario::{Scenario, Topic};
use consumer_truth::ticks::TickSet;

/// Writes YOLO.
pub struct Yolo {
    options: Options,
    n_images: u64,
}

impl Yolo {
    /// Nothing is written yet.
    pub fn new(options: &Options) -> Yolo {
        Yolo {
            options: options.clone(),
            n_images: 0,
        }
    }
}

/// Number of a category of COCO in YOLO's list.
fn class_of(category: u8) -> usize {
    let at = classes::COCO.iter().position(|(id, ..)| *id == category);
    at.expect("the table of classes names categories of the list only")
}

fn boxes(objects: &[Object], width: u32, height: u32) -> String {
    let mut text = String::new();
    for object in objects {
        let [x0, y0, x1, y1] = object.mask.bounds.map(f64::from);
        let (w, h) = (f64::from(width), f64::from(height));
        let _ = writeln!(
            text,
            "{} {:.6} {:.6} {:.6} {:.6}",
            class_of(object.category),
            (x0 + x1) / 2.0 / w,
            (y0 + y1) / 2.0 / h,
            (x1 - x0) / w,
            (y1 - y0) / h
        );
    }
    text
}

fn outlines(objects: &[Object], width: u32, height: u32) -> String {
    let mut text = String::new();
    for object in objects {
        let parts = object.mask.outlines();
        let mut path = parts[0].clone();
        for part in &parts[1..] {
            path.push(parts[0][0]);
            path.extend(part);
            path.push(part[0]);
        }
        let _ = write!(text, "{}", class_of(object.category));
        for [x, y] in path {
            let (x, y) = (
                f64::from(x) / f64::from(width),
                f64::from(y) / f64::from(height),
            );
            let _ = write!(text, " {x:.6} {y:.6}");
        }
        text.push('\n');
    }
    text
}

impl Exporter for Yolo {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        cameras(Format::Yolo, scenario, &self.options).map(drop)
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        wants(Format::Yolo, scenario, topic, &self.options)
    }

    fn keys(&self, scenario: &Scenario) -> Vec<Arc<str>> {
        keys(Format::Yolo, scenario, &self.options)
    }

    fn begin(&mut self, _: &Scenario, _: &[DoneScenario], _: &Tree) -> anyhow::Result<()> {
        self.n_images = 0;
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let Some(key) = tick.key else { return Ok(()) };
        for camera in cameras(Format::Yolo, scenario, &self.options)? {
            let colour = tick.frame(&camera.name, Modality::Rgb);
            let Some(frame) =
                colour.filter(|_| tick.frame(&camera.name, Modality::Instance).is_some())
            else {
                continue;
            };
            let form = self.options.images;
            let (width, height) = (frame.header.width, frame.header.height);
            let name = image_name(scenario, &camera.name, key);
            let split = &scenario.split;
            let image = |task: &str| format!("{task}/images/{split}/{name}.{}", form.ending());
            tree.write(&image("detect"), || picture::colour(frame, form))?;
            tree.link(&image("detect"), &image("segment"))?;
            let objects = objects(scenario, tick, &camera.name, self.options.min_pixels);
            let label = |task: &str| format!("{task}/labels/{split}/{name}.txt");
            tree.write(&label("detect"), || {
                Ok(boxes(&objects, width, height).into_bytes())
            })?;
            tree.write(&label("segment"), || {
                Ok(outlines(&objects, width, height).into_bytes())
            })?;
            self.n_images = self.n_images.saturating_add(1);
        }
        Ok(())
    }

    fn end(&mut self, _: &Scenario, _: &Tree) -> anyhow::Result<Value> {
        Ok(json!({"images": self.n_images}))
    }

    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()> {
        let splits = splits(done);
        let mut text = String::from("# Paths count from this file's folder.\npath: .\n");
        // Trainers insist on both parts; one that is not there is the other.
        for part in ["train", "val"] {
            let there = if splits.contains(&part) {
                part
            } else {
                splits[0]
            };
            let _ = writeln!(text, "{part}: images/{there}");
        }
        for part in splits
            .iter()
            .filter(|part| !["train", "val"].contains(part))
        {
            let _ = writeln!(text, "{part}: images/{part}");
        }
        text.push_str("names:\n");
        for (number, (_, name, _)) in classes::COCO.iter().enumerate() {
            let _ = writeln!(text, "  {number}: {name}");
        }
        for task in ["detect", "segment"] {
            tree.write(&format!("{task}/data.yaml"), || {
                Ok(text.clone().into_bytes())
            })?;
        }
        Ok(())
    }
}
