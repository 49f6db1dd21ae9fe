//! H.264 of pictures: planes of luma and chroma in, access units in Annex B out, made by OpenH264.
//!
//! One quantiser for every frame, so quality does not hang on a rate. Only key frames and frames
//! that refer to the one before, in the order they came; parameter sets stand before each key frame.

#![expect(
    unsafe_code,
    reason = "OpenH264 has an interface of C; each block proves itself"
)]

use std::ptr::null_mut;

use openh264_sys2 as sys;

use super::error::PictureError;

/// Fewest and most pixels along the shorter side, as OpenH264 takes them.
const SHORT_SIDE_PX: std::ops::RangeInclusive<u32> = 16..=2160;
/// Most along the longer side.
const MAX_LONG_SIDE_PX: u32 = 3840;
/// Smallest and largest quantiser.
pub const QP: std::ops::RangeInclusive<u8> = 1..=51;

/// A picture in 4:2:0: luma of every pixel, chroma of every two by two.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    width: u32,
    height: u32,
    luma: Vec<u8>,
    blue: Vec<u8>,
    red: Vec<u8>,
}

impl Planes {
    /// Takes a picture in BGRA in, its rows `stride` bytes apart. An odd last column or row is left
    /// out, as 4:2:0 has none. Colours become those of BT.601 in 16 to 235.
    pub fn set_bgra(&mut self, size_px: [u32; 2], stride: usize, pixels: &[u8]) {
        let [width, height] = size_px.map(|px| px as usize & !1);
        (self.width, self.height) = (width as u32, height as u32);
        self.luma.resize(width * height, 0);
        self.blue.resize(width * height / 4, 0);
        self.red.resize(width * height / 4, 0);
        if width == 0 || height == 0 {
            return;
        }
        let luma_of = |p: &[u8]| {
            ((66 * p[2] as i32 + 129 * p[1] as i32 + 25 * p[0] as i32 + 128) >> 8) as u8 + 16
        };
        let pairs = self.luma.chunks_exact_mut(width * 2);
        let chroma = self.blue.chunks_exact_mut(width / 2);
        let chroma = chroma.zip(self.red.chunks_exact_mut(width / 2));
        for (y, (luma, (blue, red))) in pairs.zip(chroma).enumerate() {
            let upper = &pixels[2 * y * stride..][..width * 4];
            let lower = &pixels[(2 * y + 1) * stride..][..width * 4];
            let (luma_upper, luma_lower) = luma.split_at_mut(width);
            for (luma, row) in [(luma_upper, upper), (luma_lower, lower)] {
                for (luma, pixel) in luma.iter_mut().zip(row.chunks_exact(4)) {
                    *luma = luma_of(pixel);
                }
            }
            let blocks = upper.chunks_exact(8).zip(lower.chunks_exact(8));
            for ((blue, red), (a, b)) in blue.iter_mut().zip(red).zip(blocks) {
                // Sums of four pixels, so that the weights count 1024 in place of 256.
                let sum = |k: usize| a[k] as i32 + a[k + 4] as i32 + b[k] as i32 + b[k + 4] as i32;
                let [b, g, r] = [sum(0), sum(1), sum(2)];
                *blue = (((112 * b - 74 * g - 38 * r + 512) >> 10) + 128) as u8;
                *red = (((112 * r - 94 * g - 18 * b + 512) >> 10) + 128) as u8;
            }
        }
    }
}

/// An encoder of one stream of pictures of one size.
pub struct H264 {
    raw: *mut sys::ISVCEncoder,
    found: Box<sys::SFrameBSInfo>,
    size_px: [u32; 2],
}

// SAFETY: the encoder belongs to this value alone, and OpenH264 ties none to a thread.
unsafe impl Send for H264 {}

impl std::fmt::Debug for H264 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("H264")
            .field("size_px", &self.size_px)
            .finish_non_exhaustive()
    }
}

impl H264 {
    /// An encoder with the quantiser `qp` of [`QP`]: the lower, the better and larger.
    ///
    /// # Errors
    /// [`PictureError`] if the size, odd pixels left out, or the quantiser is none for OpenH264.
    pub fn new(size_px: [u32; 2], qp: u8) -> Result<H264, PictureError> {
        let [width, height] = size_px.map(|px| px & !1);
        let (short, long) = (width.min(height), width.max(height));
        if !SHORT_SIDE_PX.contains(&short) || long > MAX_LONG_SIDE_PX {
            return Err(PictureError::VideoSize(size_px));
        }
        if !QP.contains(&qp) {
            return Err(PictureError::Quantiser(qp));
        }
        let mut raw = null_mut();
        // SAFETY: the pointer is valid for the call, which stores an encoder there or fails.
        let code = unsafe { sys::source::APILoader::WelsCreateSVCEncoder(&raw mut raw) };
        if code != 0 || raw.is_null() {
            return Err(PictureError::NoEncoder(code));
        }
        let encoder = H264 {
            raw,
            found: Box::default(),
            size_px: [width, height],
        };
        encoder.begin(qp)?;
        Ok(encoder)
    }

    fn table(&self) -> sys::ISVCEncoderVtbl {
        // SAFETY: `raw` came from WelsCreateSVCEncoder and lives until drop; it begins with the
        // address of its table of functions.
        unsafe { **self.raw }
    }

    fn begin(&self, qp: u8) -> Result<(), PictureError> {
        let table = self.table();
        let [width, height] = self.size_px.map(|px| px as i32);
        let mut settings = sys::SEncParamExt::default();
        let (Some(defaults), Some(initialize), Some(set)) =
            (table.GetDefaultParams, table.InitializeExt, table.SetOption)
        else {
            return Err(PictureError::NoFunction);
        };
        let mut quiet = sys::WELS_LOG_QUIET;
        // SAFETY: the encoder lives; the number is read during the call only.
        unsafe {
            set(
                self.raw,
                sys::ENCODER_OPTION_TRACE_LEVEL,
                (&raw mut quiet).cast(),
            )
        };
        // SAFETY: the encoder lives, and the settings are ours to fill.
        told(unsafe { defaults(self.raw, &raw mut settings) }, "settings")?;
        settings.iUsageType = sys::CAMERA_VIDEO_REAL_TIME;
        (settings.iPicWidth, settings.iPicHeight) = (width, height);
        settings.iRCMode = sys::RC_OFF_MODE;
        settings.iTemporalLayerNum = 1;
        settings.iSpatialLayerNum = 1;
        settings.iComplexityMode = sys::LOW_COMPLEXITY;
        // Key frames come when they are asked for.
        settings.uiIntraPeriod = 0;
        settings.bEnableSceneChangeDetect = false;
        settings.iNumRefFrame = 1;
        settings.eSpsPpsIdStrategy = sys::CONSTANT_ID;
        settings.iEntropyCodingModeFlag = 1;
        settings.bEnableFrameSkip = false;
        settings.bEnableAdaptiveQuant = false;
        settings.bEnableBackgroundDetection = false;
        settings.bEnableDenoise = false;
        // Frames of several topics are coded side by side already.
        settings.iMultipleThreadIdc = 1;
        let layer = &mut settings.sSpatialLayers[0];
        (layer.iVideoWidth, layer.iVideoHeight) = (width, height);
        layer.fFrameRate = settings.fMaxFrameRate;
        layer.uiProfileIdc = sys::PRO_HIGH;
        layer.iDLayerQp = qp as i32;
        // Primaries of BT.709, transfer of sRGB, matrix of BT.601 (ITU-T H.264, tables E-3 to E-5).
        layer.bVideoSignalTypePresent = true;
        layer.bColorDescriptionPresent = true;
        layer.bFullRange = false;
        layer.uiColorPrimaries = 1;
        layer.uiTransferCharacteristics = 13;
        layer.uiColorMatrix = 6;
        // SAFETY: the encoder lives; the settings are read during the call only.
        let code = unsafe { initialize(self.raw, &raw const settings) };
        told(code, "these settings")
    }

    /// Codes the next picture, as a key frame if `is_key`, and appends it to `out`.
    ///
    /// # Errors
    /// [`PictureError`] if the picture has another size or OpenH264 fails; `out` is as it was.
    pub fn encode(
        &mut self,
        picture: &Planes,
        is_key: bool,
        out: &mut Vec<u8>,
    ) -> Result<(), PictureError> {
        if [picture.width, picture.height] != self.size_px {
            return Err(PictureError::OtherSize);
        }
        let table = self.table();
        let (Some(force), Some(encode)) = (table.ForceIntraFrame, table.EncodeFrame) else {
            return Err(PictureError::NoFunction);
        };
        if is_key {
            // SAFETY: the encoder lives and is initialized.
            told(unsafe { force(self.raw, true) }, "a key frame")?;
        }
        let [width, height] = self.size_px.map(|px| px as i32);
        let source = sys::SSourcePicture {
            iColorFormat: sys::videoFormatI420,
            iStride: [width, width / 2, width / 2, 0],
            // OpenH264 only reads them.
            pData: [
                picture.luma.as_ptr().cast_mut(),
                picture.blue.as_ptr().cast_mut(),
                picture.red.as_ptr().cast_mut(),
                null_mut(),
            ],
            iPicWidth: width,
            iPicHeight: height,
            ..Default::default()
        };
        // SAFETY: the encoder lives and is initialized; the planes have the size that is told, and
        // outlive the call; what is found is ours to fill.
        let code = unsafe { encode(self.raw, &raw const source, &raw mut *self.found) };
        told(code, "the picture")?;
        let is_made = matches!(
            self.found.eFrameType,
            sys::videoFrameTypeIDR | sys::videoFrameTypeP
        );
        if !is_made || (is_key && self.found.eFrameType != sys::videoFrameTypeIDR) {
            return Err(PictureError::FrameType(self.found.eFrameType));
        }
        let n_layers = self.found.iLayerNum.max(0) as usize;
        for layer in self.found.sLayerInfo.iter().take(n_layers) {
            let n_units = layer.iNalCount.max(0) as usize;
            if n_units == 0 || layer.pBsBuf.is_null() || layer.pNalLengthInByte.is_null() {
                continue;
            }
            // SAFETY: OpenH264 keeps a length for each unit of a layer until its next call.
            let lengths = unsafe { std::slice::from_raw_parts(layer.pNalLengthInByte, n_units) };
            let n_bytes = lengths.iter().map(|n| *n as usize).sum();
            // SAFETY: the units of a layer lie one after the other, until its next call.
            out.extend_from_slice(unsafe { std::slice::from_raw_parts(layer.pBsBuf, n_bytes) });
        }
        Ok(())
    }
}

impl Drop for H264 {
    fn drop(&mut self) {
        if let Some(uninitialize) = self.table().Uninitialize {
            // SAFETY: the encoder lives; one that was never initialized has nothing to give back.
            unsafe { uninitialize(self.raw) };
        }
        // SAFETY: nobody else has the encoder, and nothing uses it after this.
        unsafe { sys::source::APILoader::WelsDestroySVCEncoder(self.raw) };
    }
}

fn told(code: i32, what: &'static str) -> Result<(), PictureError> {
    match code {
        0 => Ok(()),
        code => Err(PictureError::Refused { what, code }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Types of the units of an access unit, after their start codes.
    fn units(stream: &[u8]) -> Vec<u8> {
        let starts = stream.windows(4).filter(|four| four[..3] == [0, 0, 1]);
        starts.map(|four| four[3] & 31).collect()
    }

    #[test]
    fn parameter_sets_stand_before_each_key_frame_and_nowhere_else() {
        let mut encoder = H264::new([64, 48], 23).unwrap();
        let mut picture = Planes::default();
        for number in 0..6u8 {
            let pixels: Vec<u8> = (0..64 * 48)
                .flat_map(|at| [number * 20, (at % 64) as u8, (at / 64) as u8, 255])
                .collect();
            picture.set_bgra([64, 48], 64 * 4, &pixels);
            let mut out = Vec::new();
            encoder.encode(&picture, number == 4, &mut out).unwrap();
            let expected: &[u8] = if number % 4 == 0 { &[7, 8, 5] } else { &[1] };
            assert_eq!(units(&out), expected, "picture {number}");
        }
    }

    #[test]
    fn colours_become_those_of_bt_601_and_an_odd_edge_is_left_out() {
        let mut picture = Planes::default();
        // White, black, red, blue, each two pixels wide, and one column and row more.
        let row: Vec<u8> = [[255; 3], [0; 3], [0, 0, 255], [255, 0, 0]]
            .iter()
            .flat_map(|bgr| [bgr[0], bgr[1], bgr[2], 255].repeat(2))
            .chain([9, 9, 9, 9])
            .collect();
        picture.set_bgra([9, 3], 36, &row.repeat(3));
        assert_eq!((picture.width, picture.height), (8, 2));
        assert_eq!(picture.luma[..8], [235, 235, 16, 16, 82, 82, 41, 41]);
        assert_eq!(picture.blue, [128, 128, 90, 240]);
        assert_eq!(picture.red, [128, 128, 240, 110]);
    }

    #[test]
    fn what_is_no_video_is_refused_with_a_sentence() {
        let refused = |size, qp| H264::new(size, qp).unwrap_err().to_string();
        assert!(refused([17, 15], 23).contains("not 17 × 15"));
        assert!(refused([5000, 100], 23).contains("3840"));
        assert!(refused([64, 64], 52).contains("not 52"));
    }
}
