//! Colours of objects, classes and events: the same wherever they are shown.

use std::collections::BTreeMap;

use schema_frames::About;
use schema_types::class::CLASSES;
use schema_types::noise::mix;

/// Brightness of the darkest colour of a label, of 255.
const LEAST_LUMA: f32 = 130.0;
/// Colours that a picture of numbers can have.
const MAX_COLOURS: usize = 256;

/// Colours of a picture of events: nothing, darker, brighter.
pub const EVENTS: [[u8; 3]; 3] = [[24; 3], [70, 130, 255], [255, 70, 60]];

/// The colour of an object, bright enough for text on a dark ground. Neighbouring ids differ; the
/// background, id 0, is black.
pub fn object(id: u32) -> [u8; 3] {
    if id == 0 {
        return [0; 3];
    }
    let bits = mix(id as u64);
    let hue = (bits & 0xffff) as f32 / 65_536.0;
    let saturation = 0.55 + 0.45 * ((bits >> 16) & 0xff) as f32 / 255.0;
    let value = 0.60 + 0.40 * ((bits >> 24) & 0xff) as f32 / 255.0;
    legible(hsv(hue, saturation, value))
}

/// The colour of a class as CARLA has it; of a number that it has not, that of an object.
pub fn class(number: u32) -> [u8; 3] {
    let known = CLASSES.get(number as usize);
    known.map_or_else(|| object(number.saturating_add(1)), |info| info.rgb)
}

/// The colour of a class of a topic, which may have classes of its own, on a dark ground.
pub fn class_of(about: &About, number: u32) -> [u8; 3] {
    match about.classes.is_empty() {
        true => legible(class(number)),
        false => object(number.saturating_add(1)),
    }
}

/// A colour as bright as text on a dark ground must be: darker ones are mixed with white.
pub fn legible(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(f32::from);
    let luma = 0.299 * r + 0.587 * g + 0.114 * b;
    let white = ((LEAST_LUMA - luma) / (255.0 - luma)).max(0.0);
    rgb.map(|c| (c as f32 + (255.0 - c as f32) * white).round() as u8)
}

/// Hue, saturation and value, each 0..=1, as sRGB bytes.
pub fn hsv(hue: f32, saturation: f32, value: f32) -> [u8; 3] {
    let channel = |shift: f32| {
        let k = (shift + hue * 6.0) % 6.0;
        let share = k.min(4.0 - k).clamp(0.0, 1.0);
        ((value - value * saturation * share) * 255.0).round() as u8
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

/// The colours of a picture whose pixels are numbers of objects' colours. With more objects than
/// colours some share one.
#[derive(Clone, Debug)]
pub struct ObjectColours {
    colours: Vec<[u8; 3]>,
    numbers: BTreeMap<u32, u8>,
    last: (u32, u8),
}

impl Default for ObjectColours {
    fn default() -> Self {
        ObjectColours {
            colours: vec![object(0)],
            numbers: BTreeMap::from([(0, 0)]),
            last: (0, 0),
        }
    }
}

impl ObjectColours {
    /// Number of the colour of an object; that of the background is 0.
    pub fn number_of(&mut self, id: u32) -> u8 {
        if self.last.0 == id {
            return self.last.1;
        }
        let ObjectColours {
            colours, numbers, ..
        } = self;
        let number = *numbers.entry(id).or_insert_with(|| {
            if colours.len() < MAX_COLOURS {
                colours.push(object(id));
                (colours.len() - 1) as u8
            } else {
                1 + (id % 255) as u8
            }
        });
        self.last = (id, number);
        number
    }

    /// The colours by number.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_ids_look_different_and_the_background_is_black() {
        assert_eq!(object(0), [0; 3]);
        let distance = |a: [u8; 3], b: [u8; 3]| {
            a.iter()
                .zip(b)
                .map(|(a, b)| a.abs_diff(b) as u32)
                .sum::<u32>()
        };
        let close = (1..1000)
            .filter(|id| distance(object(*id), object(id + 1)) < 40)
            .count();
        assert!(
            close < 60,
            "{close} of 999 neighbours are hard to tell apart"
        );
    }

    #[test]
    fn dark_colours_become_legible_and_bright_ones_stay() {
        // CARLA's blue of cars.
        assert_eq!(legible([0, 0, 142]), [122, 122, 196]);
        assert_eq!(legible([0; 3]), [130; 3]);
        for bright in [[255, 255, 255], [250, 170, 30]] {
            assert_eq!(legible(bright), bright);
        }
    }

    #[test]
    fn classes_have_their_colours_unless_the_topic_has_its_own() {
        let mut about = About::default();
        assert_eq!(class(14), [0, 0, 142]);
        assert_eq!(class_of(&about, 14), legible([0, 0, 142]));
        assert_eq!(class(200), object(201));
        about.classes = vec!["cone".into()];
        assert_eq!(class_of(&about, 0), object(1));
    }

    #[test]
    fn each_object_of_a_picture_has_its_colour_and_beyond_256_they_share() {
        let mut picture = ObjectColours::default();
        let numbers = [0, 7, 9, 7, 0].map(|id| picture.number_of(id));
        assert_eq!(numbers, [0, 1, 2, 1, 0]);
        assert_eq!(picture.colours(), [[0; 3], object(7), object(9)]);
        assert!((1..=600).all(|id| picture.number_of(id) != 0));
        assert_eq!(picture.colours().len(), 256);
    }
}
