//! Names of classes: what a program calls things, what a suite asks for, and CARLA's numbers.

use crate::suite::SuiteFault;
use schema_frames::About;
use schema_types::class::CLASSES;

/// A class that is scored: one of CARLA's, or several of them taken together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Number in the metrics: CARLA's, or one above all of them for a group.
    pub number: u32,
    /// Its name in reports.
    pub name: &'static str,
    /// CARLA's classes that belong to it.
    pub members: &'static [u8],
}

const PERSON: u8 = 12;
/// CARLA's class of whoever sits on a two-wheeler.
pub const RIDER: u8 = 13;

/// Classes of objects, and groups of them.
const OBJECTS: &[(u32, &str, &[u8])] = &[
    (12, "person", &[PERSON]),
    (14, "car", &[14]),
    (15, "truck", &[15]),
    (16, "bus", &[16]),
    (17, "train", &[17]),
    (18, "motorcycle", &[18]),
    (19, "bicycle", &[19]),
    (7, "traffic_light", &[7]),
    (8, "traffic_sign", &[8]),
    (100, "vehicle", &[14, 15, 16, 17, 18, 19]),
    (101, "object", &[PERSON, 14, 15, 16, 17, 18, 19]),
];

/// Other names of classes, without case and signs.
const SYNONYMS: &[(&str, u8)] = &[
    ("person", 12),
    ("people", 12),
    ("pedestrian", 12),
    ("walker", 12),
    ("humanpedestrianadult", 12),
    ("personsitting", 12),
    ("cyclist", 19),
    ("bike", 19),
    ("vehiclebicycle", 19),
    ("motorbike", 18),
    ("vehiclemotorcycle", 18),
    ("vehiclecar", 14),
    ("van", 14),
    ("lorry", 15),
    ("vehicletruck", 15),
    ("vehiclebusrigid", 16),
    ("tram", 17),
    ("trafficsign", 8),
    ("stopsign", 8),
    ("road", 1),
    ("drivablesurface", 1),
    ("driveablesurface", 1),
    ("sidewalk", 2),
    ("pavement", 2),
    ("building", 3),
    ("wall", 4),
    ("fence", 5),
    ("pole", 6),
    ("tree", 9),
    ("roadline", 24),
    ("lanemarking", 24),
];

fn plain(name: &str) -> String {
    let kept = name.chars().filter(|c| c.is_ascii_alphanumeric());
    kept.map(|c| c.to_ascii_lowercase()).collect()
}

/// CARLA's class with this name, or one of its other names; `None` if CARLA has none.
pub fn number_of(name: &str) -> Option<u8> {
    let wanted = plain(name);
    let of_carla = CLASSES.iter().position(|class| plain(class.name) == wanted);
    let other = || SYNONYMS.iter().find(|(other, _)| *other == wanted);
    let number = of_carla.map(|number| number as u8);
    number.or_else(|| other().map(|(_, number)| *number))
}

/// The targets that a task asks for; of none the usual ones: person, car, truck, bus, motorcycle and
/// bicycle.
///
/// # Errors
/// A sentence that names a class that cannot be asked for.
pub fn targets(asked: &[String]) -> Result<Vec<Target>, SuiteFault> {
    let usual = ["person", "car", "truck", "bus", "motorcycle", "bicycle"];
    let asked: Vec<&str> = match asked {
        [] => usual.to_vec(),
        asked => asked.iter().map(String::as_str).collect(),
    };
    let mut found: Vec<Target> = Vec::new();
    for name in asked {
        let wanted = plain(name);
        let number = number_of(name).map(u32::from);
        let row = OBJECTS
            .iter()
            .find(|(own, row, _)| plain(row) == wanted || Some(*own) == number);
        let Some((number, name, members)) = row else {
            let names: Vec<&str> = OBJECTS.iter().map(|(_, name, _)| *name).collect();
            return Err(format!(
                "class {name:?} is none that objects can have; choose among {}",
                names.join(", ")
            )
            .into());
        };
        let twice = |other: &Target| other.members.iter().any(|member| members.contains(member));
        if let Some(other) = found.iter().find(|other| twice(other)) {
            return Err(format!(
                "class {name:?} overlaps class {:?}; ask for one of them",
                other.name
            )
            .into());
        }
        found.push(Target {
            number: *number,
            name,
            members,
        });
    }
    Ok(found)
}

/// The target that a class of CARLA's belongs to.
pub fn target_of(targets: &[Target], class: u8) -> Option<u32> {
    let found = targets
        .iter()
        .find(|target| target.members.contains(&class));
    found.map(|target| target.number)
}

/// The target that a program's class belongs to: by the name in its topic's list, or CARLA's number;
/// `None` for classes that are not asked for. What a program calls `vehicle` or `object` belongs to
/// a target of this name only, and what it does not tell apart (no name, or Unlabeled) is an object.
pub fn program_target(targets: &[Target], about: &About, class: u32) -> Option<u32> {
    let has = |name: &str| targets.iter().find(|target| target.name == name);
    let carla = match about.classes.is_empty() {
        true => u8::try_from(class).ok().filter(|class| *class != 0),
        false => {
            let name = about.classes.get(class as usize)?;
            let group = has(&plain(name));
            if let Some(group) = group.filter(|group| group.members.len() > 1) {
                return Some(group.number);
            }
            match plain(name).as_str() {
                "vehicle" | "object" | "obstacle" | "cluster" => None,
                _ => Some(number_of(name)?),
            }
        }
    };
    match carla {
        Some(RIDER) => target_of(targets, PERSON),
        Some(class) => target_of(targets, class),
        None => has("object").map(|object| object.number),
    }
}

/// CARLA's number for each class number of a program's semantic image or cloud; 255 is no answer.
pub fn semantic_table(about: &About) -> [u8; 256] {
    std::array::from_fn(|class| match about.classes.get(class) {
        Some(name) => number_of(name).unwrap_or(255),
        None if about.classes.is_empty() && class < CLASSES.len() => class as u8,
        None => 255,
    })
}

/// Classes of pixels or points that a task asks for, by CARLA's numbers; of none all but Unlabeled.
///
/// # Errors
/// A sentence that names a class that CARLA has not.
pub fn semantic_targets(asked: &[String]) -> Result<Vec<u8>, SuiteFault> {
    if asked.is_empty() {
        return Ok((1..CLASSES.len() as u8).collect());
    }
    asked
        .iter()
        .map(|name| {
            number_of(name).ok_or_else(|| {
                let names: Vec<&str> = CLASSES.iter().map(|class| class.name).collect();
                format!(
                    "class {name:?} is none of CARLA's; choose among {}",
                    names.join(", ")
                )
                .into()
            })
        })
        .collect()
}

/// Name of a target or of CARLA's class, as reports spell it.
pub fn name_of(number: u32) -> String {
    let object = OBJECTS.iter().find(|(own, ..)| *own == number);
    match object {
        Some((_, name, _)) => (*name).into(),
        None => About::default().class_name(number),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn about(names: &[&str]) -> About {
        About {
            classes: names.iter().map(|name| name.to_string()).collect(),
            ..About::default()
        }
    }

    #[test]
    fn programs_may_use_their_own_names_in_their_own_order() {
        let usual = targets(&[]).expect("the usual classes");
        let own = about(&["Pedestrian", "chair", "CAR", "motorbike"]);
        let found: Vec<_> = (0..5)
            .map(|class| program_target(&usual, &own, class))
            .collect();
        assert_eq!(found, [Some(12), None, Some(14), Some(18), None]);
        assert_eq!(program_target(&usual, &About::default(), 16), Some(16));
        assert_eq!(program_target(&usual, &About::default(), 13), Some(12));
        assert_eq!(program_target(&usual, &About::default(), 9000), None);
    }

    #[test]
    fn groups_take_their_members_and_whoever_tells_no_classes_apart() {
        let object = targets(&["object".into()]).expect("a group");
        assert_eq!(target_of(&object, 14), Some(101));
        assert_eq!(program_target(&object, &about(&["cluster"]), 0), Some(101));
        assert_eq!(program_target(&object, &about(&["car"]), 0), Some(101));
        assert_eq!(program_target(&object, &About::default(), 0), Some(101));
        let vehicle = targets(&["vehicle".into(), "person".into()]).expect("two");
        assert_eq!(program_target(&vehicle, &about(&["Vehicle"]), 0), Some(100));
        assert_eq!(program_target(&vehicle, &about(&["object"]), 0), None);
        assert!(targets(&["vehicle".into(), "car".into()]).is_err());
        assert!(
            targets(&["chair".into()])
                .unwrap_err()
                .to_string()
                .contains("person")
        );
    }

    #[test]
    fn a_semantic_list_maps_names_and_leaves_strangers_without_an_answer() {
        let table = semantic_table(&about(&["road", "cat", "Sky"]));
        assert_eq!(table[..4], [1, 255, 11, 255]);
        let own = semantic_table(&About::default());
        assert_eq!((own[28], own[29]), (28, 255));
    }
}
