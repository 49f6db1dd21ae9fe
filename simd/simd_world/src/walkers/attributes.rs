//! Which attributes of a walker a spawn may set, and to what.

use std::collections::BTreeMap;

use super::model::WalkerModel;
use crate::errors::{self, BadAttribute};

/// The model's attributes with the `given` ones in their place.
///
/// # Errors
/// A given attribute that the model does not have, or that may not differ.
pub(crate) fn checked_attributes(
    model: &WalkerModel,
    given: &BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>, BadAttribute> {
    errors::checked_attributes(model.attributes(), given, refusal)
}

/// What is allowed instead of a value.
fn refusal(name: &str, value: &str, known: &BTreeMap<String, String>) -> Option<String> {
    let Some(is) = known.get(name) else {
        return Some(format!(
            "this walker has only {}",
            known.keys().cloned().collect::<Vec<_>>().join(", ")
        ));
    };
    match name {
        "is_invincible" | "use_wheelchair" if value != "true" && value != "false" => {
            Some("it must be true or false".to_owned())
        }
        // CARLA's scripts only read the speed; how fast a walker goes follows from its control.
        "is_invincible" | "use_wheelchair" | "speed" => None,
        _ if is == value => None,
        _ => Some(format!("it is fixed at {is:?}")),
    }
}
