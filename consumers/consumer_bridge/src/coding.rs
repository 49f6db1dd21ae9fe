//! How payloads are made smaller for the link, topic by topic.
//!
//! `lz4` and `zstd` take any bytes. `lossless` is the coding of recordings, which knows images, clouds
//! and events and gives back exactly the same bytes. `jpeg` keeps colour images for people to look at.

use anyhow::{Context as _, bail, ensure};
use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{ExtendedColorType, ImageDecoder as _};
use schema_frames::{FrameHeader, Modality};
use schema_recording::codec;
use schema_recording::pattern::matches;
use zenoh::bytes::ZBytes;

/// Payloads below this size are sent as they are, bytes.
const LEAST_BYTES: usize = 512;
/// Level of zstd: the fastest, because frames must not wait.
const ZSTD_LEVEL: i32 = 1;
/// First number of the codings of recordings.
const FIRST_LOSSLESS: u8 = 16;

/// How one payload is coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// As it is.
    None,
    /// One block of LZ4.
    Lz4,
    /// One frame of zstd.
    Zstd,
    /// A JPEG file of a colour image.
    Jpeg,
    /// The codec of this number in [`codec::CODECS`].
    Lossless(u8),
}

impl Coding {
    /// Its number on the wire.
    pub fn number(self) -> u8 {
        match self {
            Coding::None => 0,
            Coding::Lz4 => 1,
            Coding::Zstd => 2,
            Coding::Jpeg => 3,
            Coding::Lossless(idx) => FIRST_LOSSLESS + idx,
        }
    }

    /// The coding with this number.
    pub fn from_number(number: u8) -> Option<Coding> {
        match number {
            0 => Some(Coding::None),
            1 => Some(Coding::Lz4),
            2 => Some(Coding::Zstd),
            3 => Some(Coding::Jpeg),
            other => {
                let idx = other.checked_sub(FIRST_LOSSLESS)?;
                (usize::from(idx) < codec::CODECS.len()).then_some(Coding::Lossless(idx))
            }
        }
    }
}

/// What a user asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wanted {
    /// Bytes as they are.
    #[default]
    None,
    /// LZ4.
    Lz4,
    /// zstd.
    Zstd,
    /// The coding of recordings, by modality.
    Lossless,
    /// JPEG of this quality, 1 to 100, for colour images; all else as `Zstd`.
    Jpeg(u8),
}

impl std::str::FromStr for Wanted {
    type Err = String;

    fn from_str(text: &str) -> Result<Wanted, String> {
        let quality = |text: &str| match text.parse::<u8>() {
            Ok(quality @ 1..=100) => Ok(Wanted::Jpeg(quality)),
            _ => Err(format!(
                "the quality of JPEG is {text:?}, but must be 1 to 100, as in jpeg:80"
            )),
        };
        match text {
            "none" => Ok(Wanted::None),
            "lz4" => Ok(Wanted::Lz4),
            "zstd" => Ok(Wanted::Zstd),
            "lossless" => Ok(Wanted::Lossless),
            "jpeg" => Ok(Wanted::Jpeg(80)),
            _ => match text.strip_prefix("jpeg:") {
                Some(text) => quality(text),
                None => Err(format!(
                    "{text:?} is no compression; there are none, lz4, zstd, lossless, jpeg and jpeg:QUALITY"
                )),
            },
        }
    }
}

/// Which topics are compressed how: the first rule whose pattern matches holds.
#[derive(Clone, Debug, Default)]
pub struct Rules(Vec<(String, Wanted)>);

impl Rules {
    /// Rules in the order in which they are asked.
    pub fn new(rules: Vec<(String, Wanted)>) -> Rules {
        Rules(rules)
    }

    /// How `topic` is to be compressed.
    pub fn of(&self, topic: &str) -> Wanted {
        let rule = self.0.iter().find(|(pattern, _)| matches(pattern, topic));
        rule.map(|(_, wanted)| *wanted).unwrap_or_default()
    }
}

/// Codes payloads one after another; keeps its memory for the next.
#[derive(Debug)]
pub struct Encoder {
    lossless: codec::Encoder,
}

impl Encoder {
    /// An encoder.
    ///
    /// # Errors
    /// If zstd refuses to make one.
    pub fn new() -> anyhow::Result<Encoder> {
        Ok(Encoder {
            lossless: codec::Encoder::new().context("zstd makes no encoder")?,
        })
    }

    /// The payload as `wanted` asks, or as it is where that gains nothing; `frame` is the header of
    /// a frame.
    pub fn encode(
        &mut self,
        wanted: Wanted,
        frame: Option<&FrameHeader>,
        payload: Vec<u8>,
    ) -> (Coding, Vec<u8>) {
        if payload.len() < LEAST_BYTES {
            return (Coding::None, payload);
        }
        let coded = match (wanted, frame) {
            (Wanted::None, _) => None,
            (Wanted::Lz4, _) => lz4::block::compress(&payload, None, false)
                .ok()
                .map(|coded| (Coding::Lz4, coded)),
            (Wanted::Lossless, Some(header)) => {
                let coded = self.lossless.encode(header, &payload);
                coded.and_then(|(name, bytes)| {
                    let idx = codec::CODECS.iter().position(|known| *known == name)?;
                    Some((Coding::Lossless(idx as u8), bytes.to_vec()))
                })
            }
            (Wanted::Jpeg(quality), Some(header)) if header.modality() == Some(Modality::Rgb) => {
                jpeg(header, &payload, quality).map(|coded| (Coding::Jpeg, coded))
            }
            (Wanted::Zstd | Wanted::Lossless | Wanted::Jpeg(_), _) => {
                zstd::bulk::compress(&payload, ZSTD_LEVEL)
                    .ok()
                    .map(|coded| (Coding::Zstd, coded))
            }
        };
        match coded {
            Some((coding, coded)) if coded.len() < payload.len() => (coding, coded),
            _ => (Coding::None, payload),
        }
    }
}

/// A JPEG file of a colour image; `None` if it is larger than JPEG allows, or its header claims what
/// the payload does not hold.
pub(crate) fn jpeg(header: &FrameHeader, payload: &[u8], quality: u8) -> Option<Vec<u8>> {
    let [width, height] = [header.width, header.height].map(|side| side as usize);
    let mut pixels = Vec::with_capacity(payload.len() / 4 * 3);
    // Padding may follow the last row.
    for row in payload
        .chunks(header.row_stride.max(1) as usize)
        .take(height)
    {
        let row = row.get(..width * 4)?.chunks_exact(4);
        pixels.extend(row.flat_map(|bgra| [bgra[2], bgra[1], bgra[0]]));
    }
    // The encoder panics on any other number of bytes.
    if pixels.len() != width * height * 3 {
        return None;
    }
    let mut file = Vec::with_capacity(pixels.len() / 8);
    JpegEncoder::new_with_quality(&mut file, quality)
        .encode(
            &pixels,
            header.width,
            header.height,
            ExtendedColorType::Rgb8,
        )
        .ok()
        .map(|()| file)
}

/// The payload's bytes, which zenoh may hold in pieces, copied to the front of `target`.
///
/// # Errors
/// A sentence if they are not as many as `target` has.
pub fn copy_to(payload: &ZBytes, target: &mut [u8]) -> anyhow::Result<()> {
    ensure!(
        payload.len() == target.len(),
        "a payload has {} bytes, {} were announced",
        payload.len(),
        target.len()
    );
    let mut at = 0;
    for piece in payload.slices() {
        target[at..at + piece.len()].copy_from_slice(piece);
        at += piece.len();
    }
    Ok(())
}

/// Decodes a payload into `out`, which is as long as the payload was; `frame` is the header of a
/// frame. Any bytes are safe to pass.
///
/// # Errors
/// A sentence if the bytes are no payload of that length.
pub fn decode(
    coding: Coding,
    frame: Option<&FrameHeader>,
    payload: &ZBytes,
    out: &mut [u8],
) -> anyhow::Result<()> {
    if coding == Coding::None {
        return copy_to(payload, out);
    }
    let coded = payload.to_bytes();
    let n_bytes = match coding {
        Coding::None => unreachable!("copied above"),
        Coding::Lz4 => {
            let n_bytes = i32::try_from(out.len()).context("LZ4 holds no payload of 2 GiB")?;
            lz4::block::decompress_to_buffer(&coded, Some(n_bytes), out)
                .context("a payload is no LZ4")?
        }
        Coding::Zstd => {
            zstd::bulk::decompress_to_buffer(&coded, out).context("a payload is no zstd")?
        }
        Coding::Lossless(idx) => {
            let header = frame.context("only frames are coded without loss by modality")?;
            let name = codec::CODECS.get(usize::from(idx)).copied();
            codec::decode(name.unwrap_or_default(), header, &coded, out)?;
            out.len()
        }
        Coding::Jpeg => {
            let header = frame.context("only frames come as JPEG")?;
            from_jpeg(header, &coded, out)?;
            out.len()
        }
    };
    ensure!(
        n_bytes == out.len(),
        "a payload decodes to {n_bytes} bytes, {} were announced",
        out.len()
    );
    Ok(())
}

fn from_jpeg(header: &FrameHeader, file: &[u8], out: &mut [u8]) -> anyhow::Result<()> {
    let decoder = JpegDecoder::new(std::io::Cursor::new(file)).context("a payload is no JPEG")?;
    let wanted = (header.width, header.height);
    if decoder.dimensions() != wanted || decoder.total_bytes() != pixels(wanted) * 3 {
        bail!(
            "a JPEG has {:?} pixels, its header says {wanted:?}",
            decoder.dimensions()
        );
    }
    let mut rgb = vec![0; decoder.total_bytes() as usize];
    decoder
        .read_image(&mut rgb)
        .context("a payload is a broken JPEG")?;
    let (stride, row_bytes) = (header.row_stride as usize, header.width as usize * 4);
    ensure!(
        row_bytes > 0 && stride >= row_bytes,
        "a colour image has rows of {stride} bytes"
    );
    let rows = rgb.chunks_exact(header.width as usize * 3);
    for (row, rgb) in out.chunks_mut(stride).zip(rows) {
        let row = row.get_mut(..row_bytes);
        let row = row.context("a colour image is shorter than its header says")?;
        for (bgra, rgb) in row.chunks_exact_mut(4).zip(rgb.chunks_exact(3)) {
            bgra.copy_from_slice(&[rgb[2], rgb[1], rgb[0], 255]);
        }
    }
    Ok(())
}

fn pixels((width, height): (u32, u32)) -> u64 {
    u64::from(width) * u64::from(height)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> (FrameHeader, Vec<u8>) {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(40, 30);
        let pixel = |idx: u32| {
            let (x, y) = (idx % 40, idx / 40);
            [(x / 8 * 40) as u8, (y / 8 * 60) as u8, 90, 255]
        };
        (header, (0..40 * 30).flat_map(pixel).collect())
    }

    fn there_and_back(wanted: Wanted) -> (Coding, Vec<u8>, Vec<u8>) {
        let (header, payload) = image();
        let mut encoder = Encoder::new().unwrap();
        let (coding, coded) = encoder.encode(wanted, Some(&header), payload.clone());
        let mut out = vec![0; payload.len()];
        decode(coding, Some(&header), &ZBytes::from(coded), &mut out).unwrap();
        (coding, payload, out)
    }

    #[test]
    fn lossless_codings_give_back_the_same_bytes() {
        for wanted in [Wanted::None, Wanted::Lz4, Wanted::Zstd, Wanted::Lossless] {
            let (coding, payload, out) = there_and_back(wanted);
            assert_eq!(payload, out, "{wanted:?}");
            assert_eq!(coding == Coding::None, wanted == Wanted::None, "{wanted:?}");
            assert_eq!(Coding::from_number(coding.number()), Some(coding));
        }
    }

    #[test]
    fn jpeg_looks_the_same() {
        let (coding, payload, out) = there_and_back(Wanted::Jpeg(95));
        assert_eq!(coding, Coding::Jpeg);
        let error: u64 = payload
            .iter()
            .zip(&out)
            .map(|(a, b)| u64::from(a.abs_diff(*b)))
            .sum();
        let mean = error as f64 / payload.len() as f64;
        assert!(mean < 3.0, "a byte is off by {mean} on average");
    }

    #[test]
    fn images_with_padding_or_an_odd_header_are_no_trouble() {
        let (mut header, mut payload) = image();
        payload.extend([9; 500]);
        assert!(jpeg(&header, &payload, 80).is_some());
        payload.truncate(40 * 4 * 30 - 1);
        assert!(jpeg(&header, &payload, 80).is_none());
        header.row_stride = 0;
        assert!(jpeg(&header, &payload, 80).is_none());
    }

    #[test]
    fn noise_and_short_payloads_stay_as_they_are() {
        let mut encoder = Encoder::new().unwrap();
        let mut random = fastrand::Rng::with_seed(3);
        let noise: Vec<u8> = (0..4096).map(|_| random.u8(..)).collect();
        for wanted in [Wanted::Lz4, Wanted::Zstd] {
            let (coding, bytes) = encoder.encode(wanted, None, noise.clone());
            assert_eq!((coding, bytes.len()), (Coding::None, 4096));
            let (coding, _) = encoder.encode(wanted, None, vec![0; 100]);
            assert_eq!(coding, Coding::None);
        }
    }

    #[test]
    fn changed_bytes_are_refused_and_never_panic() {
        let (header, payload) = image();
        let mut encoder = Encoder::new().unwrap();
        let mut random = fastrand::Rng::with_seed(11);
        for wanted in [
            Wanted::Lz4,
            Wanted::Zstd,
            Wanted::Lossless,
            Wanted::Jpeg(80),
        ] {
            let (coding, coded) = encoder.encode(wanted, Some(&header), payload.clone());
            for _ in 0..300 {
                let mut changed = coded.clone();
                for _ in 0..random.usize(1..4) {
                    let at = random.usize(..changed.len());
                    changed[at] = random.u8(..);
                }
                changed.truncate(random.usize(0..=changed.len()));
                let mut out = vec![0; payload.len()];
                let _ = decode(coding, Some(&header), &ZBytes::from(changed), &mut out);
            }
        }
    }

    #[test]
    fn the_first_rule_that_matches_holds() {
        let rules = Rules::new(vec![
            ("*/rgb".into(), Wanted::Jpeg(70)),
            ("ego/*".into(), Wanted::Lz4),
        ]);
        assert_eq!(rules.of("ego/front/rgb"), Wanted::Jpeg(70));
        assert_eq!(rules.of("ego/front/depth"), Wanted::Lz4);
        assert_eq!(rules.of("boxer/boxes"), Wanted::None);
        assert_eq!("jpeg:70".parse(), Ok(Wanted::Jpeg(70)));
        assert!("jpeg:0".parse::<Wanted>().is_err() && "gzip".parse::<Wanted>().is_err());
    }
}
