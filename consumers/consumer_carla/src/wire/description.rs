//! Descriptions of actors: a blueprint's id and attributes.

use crate::wire::lenient;

/// One attribute of an actor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attribute {
    /// Name.
    pub name: String,
    /// CARLA's number of its type: 1 bool, 2 int, 3 float, 4 text, 5 colour.
    pub kind: u8,
    /// Value as text.
    pub value: String,
}

/// What to spawn: a type and its attributes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// Catalogue id.
    pub type_id: String,
    /// Attributes by name.
    pub attributes: Vec<Attribute>,
}

impl Description {
    /// Memory that it takes, about.
    pub fn n_bytes(&self) -> usize {
        let attribute = |it: &Attribute| size_of::<Attribute>() + it.name.len() + it.value.len();
        let attributes: usize = self.attributes.iter().map(attribute).sum();
        size_of::<Description>() + self.type_id.len() + attributes
    }

    /// Value of an attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find(|attribute| attribute.name == name)
            .map(|attribute| attribute.value.as_str())
    }
}

/// The attributes of a sensor, by name, with values read leniently.
pub struct Attributes<'d>(&'d Description);

impl<'d> Attributes<'d> {
    /// The attributes of a description.
    pub fn of(description: &'d Description) -> Self {
        Attributes(description)
    }

    /// A text as it was sent.
    pub fn text(&self, name: &str) -> Option<&'d str> {
        self.0.attribute(name)
    }

    /// `true` or `false` in any case, or a number; else `default`.
    pub fn flag(&self, name: &str, default: bool) -> bool {
        match self.text(name).map(str::to_lowercase).as_deref() {
            Some("true" | "1") => true,
            Some("false" | "0") => false,
            _ => default,
        }
    }

    /// A number, or `default` where the client sent none.
    pub fn float(&self, name: &str, default: f64) -> f64 {
        self.0.attribute(name).map_or(default, lenient::float)
    }

    /// A bool, or `default`.
    pub fn bool(&self, name: &str, default: bool) -> bool {
        self.0.attribute(name).map_or(default, lenient::bool)
    }

    /// The seed of the sensor's noise; a negative one wraps around.
    pub fn seed(&self) -> u64 {
        self.0.attribute("noise_seed").map_or(0, lenient::int) as u64
    }

    /// An integer, or `default`; clamped to 32 bits, so that the simulator's own check refuses it
    /// with its own message.
    pub fn int(&self, name: &str, default: i64) -> i64 {
        self.0
            .attribute(name)
            .map_or(default, lenient::int)
            .clamp(i32::MIN.into(), u32::MAX.into())
    }
}
