//! CARLA's classes as DSEC's semantic labels number them: 19 classes (Cityscapes' training numbers)
//! and 11.

/// A pixel that counts for nothing.
const IGNORED: u8 = 255;

/// Number among the 19 classes by CARLA's number.
const OF_19: [u8; 29] = [
    IGNORED, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9,
    10, // unlabelled, road … vegetation, terrain, sky
    11, 12, 13, 14, 15, 16, 17, 18, // pedestrian, rider, car … bicycle
    IGNORED, IGNORED, IGNORED, IGNORED, 0, IGNORED, IGNORED, IGNORED,
    4, // road lines, guard rail
];

/// Number among the 11 classes by number among the 19: background, building, fence, person, pole,
/// road, sidewalk, vegetation, car, wall, traffic sign.
const OF_11: [u8; 19] = [5, 6, 1, 9, 2, 4, 10, 10, 7, 7, 0, 3, 3, 8, 8, 8, 8, 8, 8];

/// Number among the 19 classes.
pub fn of_19(class: u8) -> u8 {
    OF_19.get(class as usize).copied().unwrap_or(IGNORED)
}

/// Number among the 11 classes.
pub fn of_11(class: u8) -> u8 {
    OF_11.get(of_19(class) as usize).copied().unwrap_or(IGNORED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_types::Class;

    #[test]
    fn classes_have_the_numbers_of_the_format() {
        for (class, of19, of11) in [
            (Class::ROADS, 0, 5),
            (Class::ROAD_LINES, 0, 5),
            (Class::SIDEWALKS, 1, 6),
            (Class::BUILDINGS, 2, 1),
            (Class::WALLS, 3, 9),
            (Class::FENCES, 4, 2),
            (Class::POLES, 5, 4),
            (Class::TRAFFIC_LIGHT, 6, 10),
            (Class::TRAFFIC_SIGNS, 7, 10),
            (Class::VEGETATION, 8, 7),
            (Class::SKY, 10, 0),
            (Class::PEDESTRIANS, 11, 3),
            (Class::RIDER, 12, 3),
            (Class::CAR, 13, 8),
            (Class::BICYCLE, 18, 8),
            (Class::WATER, IGNORED, IGNORED),
        ] {
            assert_eq!((of_19(class.0), of_11(class.0)), (of19, of11), "{class:?}");
        }
        assert_eq!(of_19(200), IGNORED);
    }
}
