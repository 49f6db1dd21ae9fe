//! Which attributes of a walker a spawn may set, and to what.

use std::collections::BTreeMap;

use super::model::WalkerModel;
use crate::errors::BadAttribute;

/// The model's attributes with the `given` ones in their place.
///
/// # Errors
/// A given attribute that the model does not have, or that may not differ.
pub(crate) fn checked_attributes(
    model: &WalkerModel,
    given: &BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>, BadAttribute> {
    let mut attributes = model.attributes();
    for (name, value) in given {
        check(name, value, &attributes)?;
        attributes.insert(name.clone(), value.clone());
    }
    Ok(attributes)
}

fn check(name: &str, value: &str, known: &BTreeMap<String, String>) -> Result<(), BadAttribute> {
    let refuse = |allowed: String| BadAttribute {
        name: name.to_owned(),
        value: value.to_owned(),
        allowed,
    };
    let Some(is) = known.get(name) else {
        return Err(refuse(format!(
            "this walker has only {}",
            known.keys().cloned().collect::<Vec<_>>().join(", ")
        )));
    };
    match name {
        "is_invincible" | "use_wheelchair" if value != "true" && value != "false" => {
            Err(refuse("it must be true or false".to_owned()))
        }
        // CARLA's scripts only read the speed; how fast a walker goes follows from its control.
        "is_invincible" | "use_wheelchair" | "speed" => Ok(()),
        _ if is == value => Ok(()),
        _ => Err(refuse(format!("it is fixed at {is:?}"))),
    }
}
