//! Names of the fields at which two records differ, from the tables of the contract.

use schema_frames::layout::{Field, Layout, all};
use schema_frames::{ActorKind, Modality};

/// The layout of this name.
pub fn layout(name: &str) -> Option<Layout> {
    all().into_iter().find(|layout| layout.name == name)
}

/// Name of the layout of a list's elements; `None` for images.
pub fn element_of(modality: Modality) -> Option<&'static str> {
    Some(match modality {
        Modality::Dvs => "DvsEvent",
        Modality::Lidar => "LidarPoint",
        Modality::SemanticLidar => "SemanticLidarPoint",
        Modality::LidarReturns => "LidarReturn",
        Modality::Radar => "RadarDetection",
        Modality::Imu => "ImuSample",
        Modality::Gnss => "GnssSample",
        Modality::Collision => "CollisionEvent",
        Modality::LaneInvasion => "LaneCrossing",
        Modality::Obstacle => "ObstacleEvent",
        _ => return None,
    })
}

/// Name of the layout of an actor's part by its kind.
pub fn part_of(kind: u16) -> Option<&'static str> {
    Some(match ActorKind::from_code(kind)? {
        ActorKind::Vehicle => "VehiclePart",
        ActorKind::Walker => "WalkerPart",
        ActorKind::TrafficLight => "TrafficLightPart",
        ActorKind::TrafficSign => "TrafficSignPart",
        _ => return None,
    })
}

/// The first field in which two records of a layout differ: its name and both values.
pub fn first_difference(layout: &Layout, a: &[u8], b: &[u8]) -> Option<(String, String, String)> {
    layout.fields.iter().find_map(|field| {
        let range = field.offset..field.offset + field.size;
        let (a, b) = (a.get(range.clone())?, b.get(range)?);
        (a != b).then(|| (field.name.to_owned(), value(field, a), value(field, b)))
    })
}

/// A field's bytes as text.
fn value(field: &Field, bytes: &[u8]) -> String {
    let kind = field.kind.trim_start_matches('[');
    let kind = kind.split(';').next().unwrap_or(kind).trim();
    numbers(kind, bytes)
}

/// Little-endian numbers of a type as text; several in brackets.
pub fn numbers(kind: &str, bytes: &[u8]) -> String {
    let size = match kind {
        "u8" | "i8" => 1,
        "u16" | "i16" => 2,
        "u32" | "i32" | "f32" => 4,
        _ => 8,
    };
    let one = |word: &[u8]| {
        let mut wide = [0; 8];
        wide[..word.len()].copy_from_slice(word);
        let bits = u64::from_le_bytes(wide);
        match kind {
            "f32" => format!("{:?}", f32::from_bits(bits as u32)),
            "f64" | "Pose" => format!("{:?}", f64::from_bits(bits)),
            "i8" => format!("{}", bits as u8 as i8),
            "i16" => format!("{}", bits as u16 as i16),
            "i32" => format!("{}", bits as u32 as i32),
            _ => format!("{bits}"),
        }
    };
    let all: Vec<String> = bytes.chunks(size).map(one).collect();
    match &all[..] {
        [only] => only.clone(),
        several if several.len() <= 16 => format!("[{}]", several.join(", ")),
        several => format!("[{}, …]", several[..8].join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::FrameHeader;

    #[test]
    fn the_field_that_differs_is_named_with_both_values() {
        let a = FrameHeader::new(Modality::Depth);
        let mut b = a;
        b.range_limit_m = 2.5;
        b.seq = 9;
        let layout = layout("FrameHeader").unwrap();
        let (a, b) = (bytemuck::bytes_of(&a), bytemuck::bytes_of(&b));
        assert_eq!(
            first_difference(&layout, a, b).unwrap(),
            ("seq".into(), "0".into(), "9".into())
        );
        assert_eq!(first_difference(&layout, a, a), None);
        assert_eq!(numbers("f32", &1.5f32.to_le_bytes()), "1.5");
        assert_eq!(numbers("u8", &[1, 2, 3]), "[1, 2, 3]");
    }

    #[test]
    fn every_list_and_part_has_a_layout() {
        for modality in Modality::ALL {
            let Some(name) = element_of(*modality) else {
                assert!(modality.is_image());
                continue;
            };
            assert_eq!(layout(name).unwrap().size, modality.element_bytes());
        }
        for kind in 0..9 {
            assert!(part_of(kind).is_none_or(|name| layout(name).unwrap().size == 96));
        }
    }
}
