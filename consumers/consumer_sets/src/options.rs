//! What an export is asked for, and the deterministic split of scenarios into parts of a set.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::exporter::Format;

/// An export's options. What is serialised goes into the manifest: a continued export must have the
/// same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Format to write.
    #[serde(with = "format_name")]
    pub format: Format,
    /// Folder to write.
    #[serde(skip)]
    pub out: PathBuf,
    /// Rig whose sensors are exported; `None`: `ego`, or the only one.
    pub rig: Option<String>,
    /// Cameras in the order in which they are exported; empty: all that the format can hold.
    pub cameras: Vec<String>,
    /// Start, nanoseconds after the recording's first snapshot.
    pub from_nanos: u64,
    /// End, nanoseconds after the recording's first snapshot; `None`: the recording's end.
    pub to_nanos: Option<u64>,
    /// Every how many keyframes one is exported, from 1.
    pub every: u64,
    /// Most keyframes of each scenario; `None`: all.
    pub frames: Option<u64>,
    /// Names and shares of the parts of the set.
    pub split: Vec<(String, f64)>,
    /// Seed by which scenarios are dealt to the parts.
    pub split_seed: u64,
    /// Form of colour images.
    pub images: ImageForm,
    /// Form of COCO's masks.
    pub masks: MaskForm,
    /// Objects that fewer pixels show get no label.
    pub min_pixels: u64,
    /// Go on with an export that was stopped.
    #[serde(skip)]
    pub resume: bool,
}

/// Form of colour images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageForm {
    /// Lossless.
    Png,
    /// JPEG of this quality, 1 to 100.
    Jpeg(u8),
}

/// Form of COCO's masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum MaskForm {
    /// Run lengths: every pixel exactly
    Rle,
    /// Outlines along the pixels' edges, without holes
    Polygon,
}

impl ImageForm {
    /// Ending of the files, without the dot.
    pub fn ending(self) -> &'static str {
        match self {
            ImageForm::Png => "png",
            ImageForm::Jpeg(_) => "jpg",
        }
    }
}

impl Options {
    /// Options with every default.
    pub fn new(format: Format, out: PathBuf) -> Options {
        Options {
            format,
            out,
            rig: None,
            cameras: Vec::new(),
            from_nanos: 0,
            to_nanos: None,
            every: 1,
            frames: None,
            split: vec![("train".into(), 1.0)],
            split_seed: 0,
            images: ImageForm::Png,
            masks: MaskForm::Rle,
            min_pixels: 10,
            resume: false,
        }
    }
}

mod format_name {
    //! A format in the manifest is its name on the command line.

    use clap::ValueEnum as _;
    use serde::{Deserialize as _, Deserializer, Serializer};

    use crate::exporter::Format;

    pub fn serialize<S: Serializer>(format: &Format, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(format.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Format, D::Error> {
        let name = String::deserialize(from)?;
        Format::from_str(&name, false).map_err(serde::de::Error::custom)
    }
}

/// Reads `train=0.8,val=0.2`. Shares are positive and are scaled to a sum of 1.
///
/// # Errors
/// A sentence that says what is wrong.
pub fn parse_split(text: &str) -> Result<Vec<(String, f64)>, String> {
    let rule = "write parts and shares like train=0.8,val=0.2";
    let mut parts: Vec<(String, f64)> = Vec::new();
    for word in text.split(',') {
        let (name, share) = word
            .split_once('=')
            .ok_or_else(|| format!("{word:?} has no share; {rule}"))?;
        let is_name = !name.is_empty()
            && name.len() <= 32
            && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if !is_name {
            return Err(format!(
                "{name:?} is no name of a part: 1 to 32 letters, digits or '_'; {rule}"
            ));
        }
        if parts.iter().any(|(other, _)| other == name) {
            return Err(format!("the part {name:?} stands there twice; {rule}"));
        }
        match share.parse::<f64>() {
            Ok(share) if share.is_finite() && share > 0.0 => parts.push((name.into(), share)),
            _ => return Err(format!("the share {share:?} is no number above 0; {rule}")),
        }
    }
    let sum: f64 = parts.iter().map(|(_, share)| share).sum();
    parts.iter_mut().for_each(|(_, share)| *share /= sum);
    Ok(parts)
}

/// The part of each scenario, in the order of `names`. Which scenario goes where follows from its
/// name and the seed alone as far as the shares allow; each part gets its share of the scenarios,
/// rounded so that the sum is right (largest remainders first, then the earlier part).
pub fn deal(names: &[String], split: &[(String, f64)], seed: u64) -> Vec<String> {
    let n = names.len();
    let mut counts: Vec<usize> = split
        .iter()
        .map(|(_, share)| (share * n as f64 + 1e-9).floor() as usize)
        .collect();
    let mut by_remainder: Vec<usize> = (0..split.len()).collect();
    let remainder = |i: usize| split[i].1 * n as f64 - counts[i] as f64;
    by_remainder.sort_by(|&a, &b| remainder(b).total_cmp(&remainder(a)).then(a.cmp(&b)));
    let left = n.saturating_sub(counts.iter().sum());
    for i in by_remainder.into_iter().cycle().take(left) {
        counts[i] += 1;
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|&i| (hash(seed, &names[i]), i));
    let mut parts = vec![String::new(); n];
    let mut dealt = order.into_iter();
    for ((name, _), count) in split.iter().zip(counts) {
        for i in dealt.by_ref().take(count) {
            parts[i] = name.clone();
        }
    }
    parts
}

/// FNV-1a, 64 bits, over the seed and the text, finished with a mixer so that close names differ in
/// all bits.
pub fn hash(seed: u64, text: &str) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    for byte in seed.to_le_bytes().into_iter().chain(text.bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    hash ^ (hash >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(n: usize) -> Vec<String> {
        (0..n).map(|i| format!("town_{i}")).collect()
    }

    #[test]
    fn parts_get_their_shares_and_the_seed_decides_who() {
        let split = parse_split("train=8,val=1,test=1").expect("a split");
        let parts = deal(&names(20), &split, 7);
        let count = |part: &str| parts.iter().filter(|p| *p == part).count();
        assert_eq!((count("train"), count("val"), count("test")), (16, 2, 2));
        assert_eq!(parts, deal(&names(20), &split, 7));
        assert_ne!(parts, deal(&names(20), &split, 8));
    }

    #[test]
    fn one_scenario_goes_to_the_largest_part_and_every_scenario_has_one() {
        let split = parse_split("val=0.2,train=0.8").expect("a split");
        assert_eq!(deal(&names(1), &split, 3), ["train"]);
        for n in 0..12 {
            assert!(
                deal(&names(n), &split, 3)
                    .iter()
                    .all(|part| !part.is_empty())
            );
        }
    }

    #[test]
    fn a_wrong_split_is_told_what_is_wrong() {
        for (text, word) in [
            ("train", "no share"),
            ("train=0.5,train=0.5", "twice"),
            ("train=-1", "above 0"),
            ("train=nan", "above 0"),
            ("a/b=1", "no name"),
            ("", "no share"),
        ] {
            let error = parse_split(text).expect_err(text);
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
