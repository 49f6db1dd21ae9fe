//! nuScenes' map mask: where cars drive and people walk, from above, ten pixels a metre.

use schema_roads::{LaneKind, RoadMap};

use crate::picture;
use consumer_truth::camera::{convex, rows};

/// Pixels per metre, as the devkit assumes.
const PIXELS_PER_M: f64 = 10.0;
/// Largest side of a mask, metres; larger maps get a mask of this size round their middle.
const MAX_SIDE_M: f64 = 4000.0;
/// Ground that is shown round the lanes, metres.
const MARGIN_M: f64 = 20.0;

/// A mask and where it lies.
pub struct MapMask {
    map: Option<RoadMap>,
    origin_m: [f64; 2],
    size_m: [f64; 2],
}

impl MapMask {
    /// The mask of an OpenDRIVE text; blank if there is none or it cannot be read.
    pub fn of(opendrive: Option<&str>) -> MapMask {
        let map = opendrive.and_then(|text| RoadMap::parse(text).ok());
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for lane in map
            .iter()
            .flat_map(|map| map.lanes().iter().map(move |lane| (map, lane)))
        {
            let (map, lane) = lane;
            for point in map.centreline(lane.key, 10.0) {
                for axis in 0..2 {
                    low[axis] = low[axis].min(point[axis] - MARGIN_M);
                    high[axis] = high[axis].max(point[axis] + MARGIN_M);
                }
            }
        }
        let blank = MapMask {
            map: None,
            origin_m: [0.0; 2],
            size_m: [1.0; 2],
        };
        if map.is_none() || low[0] >= high[0] {
            return blank;
        }
        let mut mask = MapMask { map, ..blank };
        for axis in 0..2 {
            let (from, to) = (low[axis].floor(), high[axis].ceil());
            let size = (to - from).min(MAX_SIDE_M);
            mask.origin_m[axis] = ((from + to - size) / 2.0).floor();
            mask.size_m[axis] = size;
        }
        mask
    }

    /// Whether there is no map.
    pub fn is_blank(&self) -> bool {
        self.map.is_none()
    }

    /// World coordinates of the lower left corner, metres.
    pub fn origin_m(&self) -> [f64; 2] {
        self.origin_m
    }

    /// The mask: 255 where lanes for vehicles, parking and walking are, 0 elsewhere.
    ///
    /// # Errors
    /// If the encoder refuses.
    pub fn png(&self) -> anyhow::Result<Vec<u8>> {
        let [width, height] = self.size_m.map(|size| (size * PIXELS_PER_M).round() as u32);
        let mut pixels = vec![0u8; width as usize * height as usize];
        let at = |point: &[f64; 3]| {
            [
                (point[0] - self.origin_m[0]) * PIXELS_PER_M,
                f64::from(height) - (point[1] - self.origin_m[1]) * PIXELS_PER_M,
            ]
        };
        let shown = |kind: LaneKind| {
            use LaneKind::{Biking, Bus, Kerb, Parking, Shoulder, Sidewalk, Stop, Taxi};
            kind.is_drivable()
                || matches!(
                    kind,
                    Biking | Bus | Kerb | Parking | Shoulder | Sidewalk | Stop | Taxi
                )
        };
        if let Some(map) = &self.map {
            for lane in map.lanes().iter().filter(|lane| shown(lane.kind)) {
                let (left, right) = map.boundaries(lane.key, 1.0);
                for (left, right) in left.windows(2).zip(right.windows(2)) {
                    let piece = convex([&left[0], &left[1], &right[0], &right[1]].map(at).to_vec());
                    for (row, from, to) in rows(&piece, width, height) {
                        let start = row as usize * width as usize;
                        pixels[start + from as usize..start + to as usize].fill(255);
                    }
                }
            }
        }
        picture::gray8(&pixels, width, height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_map_that_can_be_read_the_mask_is_blank_and_an_image_all_the_same() {
        for text in [None, Some(""), Some("<OpenDRIVE/>"), Some("no map")] {
            let mask = MapMask::of(text);
            assert!(mask.is_blank(), "{text:?}");
            assert_eq!(mask.origin_m(), [0.0, 0.0]);
            assert!(mask.png().expect("a small image").starts_with(b"\x89PNG"));
        }
    }

    #[test]
    fn a_straight_road_is_a_bar_in_its_place() {
        let text = r#"<OpenDRIVE><header revMajor="1" revMinor="6"/><road id="1" length="100" junction="-1">
            <planView><geometry s="0" x="50" y="-30" hdg="0" length="100"><line/></geometry></planView>
            <lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>
            <lane id="-1" type="driving"><width sOffset="0" a="4" b="0" c="0" d="0"/></lane></right>
            </laneSection></lanes></road></OpenDRIVE>"#;
        let mask = MapMask::of(Some(text));
        // The lane's middle runs from (50, −32) to (150, −32), with a margin of 20 m all round.
        assert_eq!(mask.origin_m(), [30.0, -52.0]);
        let png = mask.png().expect("an image");
        let mut reader = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("it has a size")];
        let info = reader.next_frame(&mut pixels).expect("pixels");
        assert_eq!((info.width, info.height), (1400, 400));
        let n_shown = pixels.iter().filter(|pixel| **pixel == 255).count();
        assert!((n_shown as i64 - 1000 * 40).abs() < 2000, "{n_shown}");
        // Row 0 is the north: the lane lies between y = −34 and y = −30.
        assert_eq!(pixels[200 * 1400 + 700], 255);
        assert_eq!(pixels[100 * 1400 + 700], 0);
    }
}
