//! Finds cars in an image of class numbers. It stands in for a detector of yours: the simulator
//! labels every pixel, so that its boxes are exact.

use consumer_kit::schema_frames::Box2d;
use consumer_kit::schema_types::Class;

/// Narrower groups of columns are no car, pixels.
const MIN_WIDTH_PX: usize = 4;

/// A box round each group of neighbouring columns with pixels of cars. Cars that cover one another
/// share a box.
pub fn cars(rows: &[&[u8]]) -> Vec<Box2d> {
    let width = rows.first().map_or(0, |row| row.len());
    let has_car = |x: usize| rows.iter().any(|row| row[x] == Class::CAR.0);
    let mut boxes = Vec::new();
    let mut first = None;
    for x in 0..=width {
        match (x < width && has_car(x), first) {
            (true, None) => first = Some(x),
            (false, Some(left)) => {
                if x - left >= MIN_WIDTH_PX {
                    boxes.push(box_round(rows, left, x));
                }
                first = None;
            }
            _ => {}
        }
    }
    boxes
}

/// The box round the pixels of cars in the columns `left..right`.
fn box_round(rows: &[&[u8]], left: usize, right: usize) -> Box2d {
    let is_car = |row: &&[u8]| row[left..right].contains(&Class::CAR.0);
    let top = rows.iter().position(is_car).unwrap_or(0);
    let bottom = rows.iter().rposition(is_car).unwrap_or(top) + 1;
    Box2d {
        min_px: [left as f32, top as f32],
        max_px: [right as f32, bottom as f32],
        score: 1.0,
        class: u32::from(Class::CAR.0),
        id: 0,
        reserved: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_cars_side_by_side_get_a_box_each_and_a_lamp_gets_none() {
        let mut image = vec![[0_u8; 20]; 10];
        for row in &mut image[2..6] {
            row[1..7].fill(Class::CAR.0);
        }
        for row in &mut image[4..9] {
            row[10..15].fill(Class::CAR.0);
        }
        image[5][18] = Class::CAR.0;
        let rows: Vec<&[u8]> = image.iter().map(|row| row.as_slice()).collect();
        let corners: Vec<_> = cars(&rows)
            .iter()
            .map(|it| (it.min_px, it.max_px))
            .collect();
        assert_eq!(
            corners,
            [([1.0, 2.0], [7.0, 6.0]), ([10.0, 4.0], [15.0, 9.0])]
        );
    }

    #[test]
    fn an_image_without_pixels_has_no_cars() {
        assert!(cars(&[]).is_empty());
    }
}
