//! Which vehicles to drive.

use std::str::FromStr;

use schema_frames::ActorList;

/// Roles and ids, joined.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    ego: bool,
    others: bool,
    ids: Vec<u32>,
}

impl FromStr for Selection {
    type Err = String;

    fn from_str(text: &str) -> Result<Selection, String> {
        let mut selection = Selection::default();
        for word in text.split(',').map(str::trim) {
            match word {
                "ego" => selection.ego = true,
                "others" => selection.others = true,
                "all" => (selection.ego, selection.others) = (true, true),
                _ => match word.parse::<u32>() {
                    Ok(id) if id > 0 => selection.ids.push(id),
                    _ => {
                        return Err(format!(
                            "{word:?} is none of ego, others, all and an actor id above 0"
                        ));
                    }
                },
            }
        }
        Ok(selection)
    }
}

impl std::fmt::Display for Selection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let roles = match (self.ego, self.others) {
            (true, true) => Some("all"),
            (true, false) => Some("ego"),
            (false, true) => Some("others"),
            (false, false) => None,
        };
        let ids = self.ids.iter().map(u32::to_string);
        f.write_str(
            &roles
                .map(str::to_owned)
                .into_iter()
                .chain(ids)
                .collect::<Vec<_>>()
                .join("-"),
        )
    }
}

impl Selection {
    /// All roles.
    pub fn all() -> Selection {
        Selection {
            ego: true,
            others: true,
            ids: Vec::new(),
        }
    }

    /// Ids of the selected vehicles that are there, rising.
    pub fn choose(&self, actors: &ActorList) -> Vec<u32> {
        let wanted = |role: &str, id: u32| match role {
            "ego_vehicle" | "hero" => self.ego || self.ids.contains(&id),
            "autopilot" => self.others || self.ids.contains(&id),
            _ => self.ids.contains(&id),
        };
        let vehicles = actors.actors.iter().filter(|a| a.kind == "vehicle");
        vehicles
            .filter(|a| wanted(&a.role, a.id))
            .map(|a| a.id)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_and_ids_are_read_and_written() {
        let selection: Selection = "others, 24,31".parse().unwrap();
        assert_eq!(
            selection,
            Selection {
                ego: false,
                others: true,
                ids: vec![24, 31]
            }
        );
        assert_eq!(selection.to_string(), "others-24-31");
        assert!(
            "everyone"
                .parse::<Selection>()
                .unwrap_err()
                .contains("everyone")
        );
        assert!("0".parse::<Selection>().is_err());
    }
}
