//! nuScenes' map mask: where cars drive and people walk, from above, ten pixels a metre.

use schema_roads::{LaneKind, RoadMap};

use crate::picture;
use crate::truth::camera::{convex, rows};

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
        if map.is_none() || !(low[0] < high[0]) {
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
