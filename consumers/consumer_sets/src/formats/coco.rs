//! COCO: `annotations/instances_<part>.json` and `images/<part>/`.
//!
//! Boxes and areas are those of visible pixels. Beside COCO's own fields annotations carry `track_id`,
//! and for what has a box in space `visible_fraction`, `truncation`, `occlusion` and `type_id`.

use std::io::Write as _;
use std::sync::Arc;

use anyhow::Context as _;
use schema_frames::Modality;
use serde_json::{Value, json};

use super::objects::{Object, cameras, image_name, keys, objects, wants};
use crate::classes;
use crate::exporter::{DoneScenario, Exporter, Format, last_number, splits};
use crate::options::{MaskForm, Options};
use crate::picture;
use crate::tree::{Job, PartFile, Tree};
use consumer_truth::masks::runs_text;
use consumer_truth::scenario::{Scenario, Topic};
use consumer_truth::ticks::TickSet;

/// Writes COCO.
pub struct Coco {
    options: Options,
    /// Lines of the running scenario: images, annotations.
    lines: Option<[PartFile; 2]>,
    /// Highest ids so far: of images, of annotations.
    ids: [u64; 2],
}

const LISTS: [&str; 2] = ["images", "annotations"];

impl Coco {
    /// Nothing is written yet.
    pub fn new(options: &Options) -> Coco {
        Coco {
            options: options.clone(),
            lines: None,
            ids: [0; 2],
        }
    }

    fn state(index: usize, list: &str) -> String {
        Tree::state(&format!("{index:04}_{list}.jsonl"))
    }

    fn annotation(&self, object: &Object, width: u32, height: u32) -> Value {
        let [x0, y0, x1, y1] = object.mask.bounds;
        let segmentation = match self.options.masks {
            MaskForm::Rle => json!({
                "size": [height, width],
                "counts": runs_text(&object.mask.runs(width, height)),
            }),
            MaskForm::Polygon => {
                let flat = |outline: Vec<[u32; 2]>| outline.concat();
                object.mask.outlines().into_iter().map(flat).collect()
            }
        };
        let mut annotation = json!({
            "category_id": object.category,
            "bbox": [x0, y0, x1 - x0, y1 - y0],
            "area": object.mask.n_pixels(),
            "iscrowd": 0,
            "segmentation": segmentation,
            "track_id": object.id,
        });
        if let Some((body, truth)) = &object.body {
            annotation["type_id"] = json!(body.type_id);
            annotation["truncation"] = json!(rounded(truth.truncation));
            if let Some(seen) = &truth.seen {
                annotation["occlusion"] = json!(rounded(seen.occlusion));
                annotation["visible_fraction"] = json!(rounded(seen.visible_fraction));
            }
        }
        annotation
    }
}

fn rounded(fraction: f64) -> f64 {
    (fraction * 1e4).round() / 1e4
}

impl Exporter for Coco {
    fn check(&mut self, scenario: &Scenario) -> anyhow::Result<()> {
        cameras(Format::Coco, scenario, &self.options).map(drop)
    }

    fn wants(&self, scenario: &Scenario, topic: &Topic) -> bool {
        wants(Format::Coco, scenario, topic, &self.options)
    }

    fn keys(&self, scenario: &Scenario) -> Vec<Arc<str>> {
        keys(Format::Coco, scenario, &self.options)
    }

    fn begin(
        &mut self,
        scenario: &Scenario,
        done: &[DoneScenario],
        tree: &Tree,
    ) -> anyhow::Result<()> {
        let last = |list: &str| last_number(done, list);
        self.ids = LISTS.map(last);
        let index = scenario.index as usize;
        let [images, annotations] = LISTS.map(|list| tree.begin(&Coco::state(index, list)));
        self.lines = Some([images?, annotations?]);
        Ok(())
    }

    fn tick(&mut self, scenario: &Scenario, tick: &TickSet, tree: &Tree) -> anyhow::Result<()> {
        let Some(key) = tick.key else { return Ok(()) };
        let mut jobs = Vec::new();
        for camera in cameras(Format::Coco, scenario, &self.options)? {
            let colour = tick.frame(&camera.name, Modality::Rgb);
            let Some(frame) =
                colour.filter(|_| tick.frame(&camera.name, Modality::Instance).is_some())
            else {
                continue;
            };
            let form = self.options.images;
            let name = image_name(scenario, &camera.name, key);
            let file = format!("{name}.{}", form.ending());
            let path = format!("images/{}/{file}", scenario.split);
            jobs.push(Job::new(path, move || picture::colour(frame, form)));
            let (width, height) = (frame.header.width, frame.header.height);
            self.ids[0] = self.ids[0].saturating_add(1);
            let image = json!({
                "id": self.ids[0], "file_name": file, "width": width, "height": height,
                "license": 0, "scenario": scenario.name, "camera": camera.name, "tick": tick.tick,
                "sim_nanos": tick.sim_nanos,
            });
            let mut lines = vec![(0, image)];
            for object in objects(scenario, tick, &camera.name, self.options.min_pixels) {
                self.ids[1] = self.ids[1].saturating_add(1);
                let mut annotation = self.annotation(&object, width, height);
                annotation["id"] = json!(self.ids[1]);
                annotation["image_id"] = json!(self.ids[0]);
                lines.push((1, annotation));
            }
            let files = self.lines.as_mut().expect("a scenario has begun");
            for (list, line) in lines {
                writeln!(files[list], "{line}").context("cannot write the export's state")?;
            }
        }
        tree.write_all(jobs)
    }

    fn end(&mut self, _: &Scenario, _: &Tree) -> anyhow::Result<Value> {
        for file in self.lines.take().into_iter().flatten() {
            file.finish()?;
        }
        Ok(json!({"images": self.ids[0], "annotations": self.ids[1]}))
    }

    fn finish(&mut self, done: &[DoneScenario], tree: &Tree) -> anyhow::Result<()> {
        for split in splits(done) {
            let path = format!("annotations/instances_{split}.json");
            let mut file = tree.begin(&path)?;
            let cannot = || format!("cannot write {}", tree.path(&path).display());
            let categories: Vec<Value> = classes::COCO
                .iter()
                .map(|(id, name, above)| json!({"id": id, "name": name, "supercategory": above}))
                .collect();
            let head = json!({"description": "Made by Gantry from a simulation", "version": env!("CARGO_PKG_VERSION")});
            let licences = json!([{"id": 0, "name": "", "url": ""}]);
            write!(
                file,
                "{{\"info\": {head},\n\"licenses\": {licences},\n\"categories\": {}",
                Value::from(categories)
            )
            .with_context(cannot)?;
            for list in LISTS {
                write!(file, ",\n\"{list}\": [").with_context(cannot)?;
                let mut first = true;
                for (index, _) in done
                    .iter()
                    .enumerate()
                    .filter(|(_, scenario)| scenario.split == split)
                {
                    tree.each_line(&Coco::state(index, list), &mut |line| {
                        let comma = if std::mem::take(&mut first) { "" } else { "," };
                        write!(file, "{comma}\n{line}").with_context(cannot)
                    })?;
                }
                write!(file, "\n]").with_context(cannot)?;
            }
            writeln!(file, "}}").with_context(cannot)?;
            file.finish()?;
        }
        Ok(())
    }
}
