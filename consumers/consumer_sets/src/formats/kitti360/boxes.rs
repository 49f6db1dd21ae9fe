//! KITTI-360's boxes in space (an XML file per sequence), and its labels.

use std::collections::BTreeMap;
use std::io::Write as _;

use anyhow::Context as _;
use nalgebra::{Matrix4, Vector3};

use crate::formats::family::matrix;
use crate::tree::PartFile;
use consumer_truth::Body;

/// Name, number in files of boxes (`kittiId`), whether objects are numbered, colour; the index is the
/// label id of images.
const LABELS: [(&str, i8, bool, [u8; 3]); 45] = [
    ("unlabeled", -1, false, [0, 0, 0]),
    ("ego vehicle", -1, false, [0, 0, 0]),
    ("rectification border", -1, false, [0, 0, 0]),
    ("out of roi", -1, false, [0, 0, 0]),
    ("static", -1, false, [0, 0, 0]),
    ("dynamic", -1, false, [111, 74, 0]),
    ("ground", -1, false, [81, 0, 81]),
    ("road", 1, false, [128, 64, 128]),
    ("sidewalk", 3, false, [244, 35, 232]),
    ("parking", 2, false, [250, 170, 160]),
    ("rail track", 10, false, [230, 150, 140]),
    ("building", 11, true, [70, 70, 70]),
    ("wall", 7, false, [102, 102, 156]),
    ("fence", 8, false, [190, 153, 153]),
    ("guard rail", 30, false, [180, 165, 180]),
    ("bridge", 31, false, [150, 100, 100]),
    ("tunnel", 32, false, [150, 120, 90]),
    ("pole", 21, true, [153, 153, 153]),
    ("polegroup", -1, false, [153, 153, 153]),
    ("traffic light", 23, true, [250, 170, 30]),
    ("traffic sign", 24, true, [220, 220, 0]),
    ("vegetation", 5, false, [107, 142, 35]),
    ("terrain", 4, false, [152, 251, 152]),
    ("sky", 9, false, [70, 130, 180]),
    ("person", 19, true, [220, 20, 60]),
    ("rider", 20, true, [255, 0, 0]),
    ("car", 13, true, [0, 0, 142]),
    ("truck", 14, true, [0, 0, 70]),
    ("bus", 34, true, [0, 60, 100]),
    ("caravan", 16, true, [0, 0, 90]),
    ("trailer", 15, true, [0, 0, 110]),
    ("train", 33, true, [0, 80, 100]),
    ("motorcycle", 17, true, [0, 0, 230]),
    ("bicycle", 18, true, [119, 11, 32]),
    ("garage", 12, true, [64, 128, 128]),
    ("gate", 6, false, [190, 153, 153]),
    ("stop", 29, true, [150, 120, 90]),
    ("smallpole", 22, true, [153, 153, 153]),
    ("lamp", 25, true, [0, 64, 64]),
    ("trash bin", 26, true, [0, 128, 192]),
    ("vending machine", 27, true, [128, 64, 0]),
    ("box", 28, true, [64, 64, 128]),
    ("unknown construction", 35, false, [102, 0, 0]),
    ("unknown vehicle", 36, false, [51, 0, 51]),
    ("unknown object", 37, false, [32, 32, 32]),
];

/// Whether objects of a label have numbers.
pub fn has_instances(label: u8) -> bool {
    LABELS
        .get(usize::from(label))
        .is_some_and(|(_, _, numbered, _)| *numbered)
}

/// Colour of a label.
pub fn colour(label: u8) -> [u8; 3] {
    LABELS
        .get(usize::from(label))
        .map_or([0; 3], |(.., colour)| *colour)
}

/// Corners of a cube of side 1 in KITTI-360's order, in which corner i of the front is opposite to
/// corner 5 − i or 9 − i of the back.
const CORNERS: [[f64; 3]; 8] = [
    [0.5, -0.5, -0.5],
    [0.5, -0.5, 0.5],
    [0.5, 0.5, -0.5],
    [0.5, 0.5, 0.5],
    [-0.5, -0.5, 0.5],
    [-0.5, -0.5, -0.5],
    [-0.5, 0.5, 0.5],
    [-0.5, 0.5, -0.5],
];
/// Its sides as triangles.
const FACES: [[u8; 3]; 12] = [
    [0, 2, 3],
    [0, 3, 1],
    [5, 4, 6],
    [5, 6, 7],
    [0, 1, 4],
    [0, 4, 5],
    [2, 7, 6],
    [2, 6, 3],
    [1, 3, 6],
    [1, 6, 4],
    [0, 5, 7],
    [0, 7, 2],
];

/// The file of a sequence.
pub struct Boxes {
    file: PartFile,
    n: u64,
    /// Cars of the map: label, and the first and the last frame in which they are shown.
    still: BTreeMap<u32, (Body, u8, [u64; 2])>,
}

const CANNOT: &str = "cannot write the boxes of a scenario";

impl Boxes {
    /// An empty file.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn begin(mut file: PartFile) -> anyhow::Result<Boxes> {
        writeln!(file, "<?xml version=\"1.0\"?>\n<opencv_storage>").context(CANNOT)?;
        Ok(Boxes {
            file,
            n: 0,
            still: BTreeMap::new(),
        })
    }

    /// Adds a body at a frame.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn add(&mut self, body: &Body, label: u8, number: u16, frame: u64) -> anyhow::Result<()> {
        self.write(body, label, number, Some(frame), [frame; 2])
    }

    /// Notes that a body of the map is shown in a frame; it is written once, at the end.
    pub fn note_still(&mut self, body: &Body, label: u8, frame: u64) {
        let noted = self.still.entry(body.id);
        let noted = noted.or_insert_with(|| (body.clone(), label, [frame; 2]));
        noted.2[1] = frame;
    }

    /// Writes a body: of one frame, or one that stands still from the first to the last.
    fn write(
        &mut self,
        body: &Body,
        label: u8,
        number: u16,
        frame: Option<u64>,
        [first, last]: [u64; 2],
    ) -> anyhow::Result<()> {
        let (name, kitti_id, _, _) = LABELS[usize::from(label)];
        if kitti_id < 0 {
            return Ok(());
        }
        self.n = self.n.saturating_add(1);
        let n = self.n;
        let size = Matrix4::new_nonuniform_scaling(&Vector3::from(body.size_m()));
        let transform = matrix(&body.world_from_box) * size;
        let list = |values: &mut dyn Iterator<Item = f64>| {
            values
                .map(|value| format!("{:.9e}", value + 0.0))
                .collect::<Vec<_>>()
                .join(" ")
        };
        let transform = list(&mut (0..16).map(|i| transform[(i / 4, i % 4)]));
        let corners = list(&mut CORNERS.iter().flatten().copied());
        let faces = FACES
            .iter()
            .flatten()
            .map(u8::to_string)
            .collect::<Vec<_>>()
            .join(" ");
        let opencv = |tag: &str, rows: u32, columns: u32, kind: &str, data: &str| {
            format!(
                "  <{tag} type_id=\"opencv-matrix\"><rows>{rows}</rows><cols>{columns}</cols><dt>{kind}</dt><data>{data}</data></{tag}>\n"
            )
        };
        let timestamp = frame.map_or(-1, |frame| frame as i64);
        let dynamic = u8::from(frame.is_some());
        let text = format!(
            "<object{n}>\n  <index>{n}</index>\n  <label>{name}</label>\n  <semanticId_orig>{label}</semanticId_orig>\n  <semanticId>{kitti_id}</semanticId>\n  <instanceId>{number}</instanceId>\n  <category>{}</category>\n  <timestamp>{timestamp}</timestamp>\n  <dynamic>{dynamic}</dynamic>\n  <start_frame>{first}</start_frame>\n  <end_frame>{last}</end_frame>\n{}{}{}</object{n}>\n",
            if body.kind == schema_frames::ActorKind::Walker {
                "human"
            } else {
                "vehicle"
            },
            opencv("transform", 4, 4, "f", &transform),
            opencv("vertices", 8, 3, "f", &corners),
            opencv("faces", 12, 3, "i", &faces),
        );
        self.file.write_all(text.as_bytes()).context(CANNOT)
    }

    /// All boxes are there; `number` gives those of the map their numbers, by label and id.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn finish(mut self, number: &mut dyn FnMut(u8, u32) -> u16) -> anyhow::Result<()> {
        for (id, (body, label, frames)) in std::mem::take(&mut self.still) {
            self.write(&body, label, number(label, id), None, frames)?;
        }
        writeln!(self.file, "</opencv_storage>").context(CANNOT)?;
        self.file.finish()
    }
}
