//! Descriptions of keys: the documentation of the Rust fields that they are read into.

use std::collections::BTreeMap;
use std::path::Path;

use syn::{Attribute, Expr, Fields, Item, Lit, Meta, Type};

/// Sources whose types a launch file is read into, from the root of the repository.
const SOURCES: [&str; 19] = [
    "launch/launch_spec/src/batch.rs",
    "launch/launch_spec/src/model.rs",
    "launch/launch_spec/src/process.rs",
    "launch/launch_spec/src/topic.rs",
    "schemas/schema_frames/src/document.rs",
    "sensors/sensor_spec/src/blur.rs",
    "sensors/sensor_spec/src/camera.rs",
    "sensors/sensor_spec/src/dvs.rs",
    "sensors/sensor_spec/src/events.rs",
    "sensors/sensor_spec/src/film.rs",
    "sensors/sensor_spec/src/gnss.rs",
    "sensors/sensor_spec/src/imu.rs",
    "sensors/sensor_spec/src/lens.rs",
    "sensors/sensor_spec/src/lidar.rs",
    "sensors/sensor_spec/src/mount.rs",
    "sensors/sensor_spec/src/optics.rs",
    "sensors/sensor_spec/src/radar.rs",
    "sensors/sensor_spec/src/sensor.rs",
    "schemas/schema_frames/src/attachment.rs",
];

/// Documentation and type of each field and variant by (type, name).
pub struct Descriptions(BTreeMap<(String, String), (String, String)>);

impl Descriptions {
    pub fn read() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut known = BTreeMap::new();
        for source in SOURCES {
            let text = std::fs::read_to_string(root.join(source))
                .unwrap_or_else(|error| panic!("{source}: {error}"));
            let file = syn::parse_file(&text).unwrap_or_else(|error| panic!("{source}: {error}"));
            for item in file.items {
                match item {
                    Item::Struct(of) => {
                        for field in of.fields {
                            let name = field.ident.as_ref().map(ToString::to_string);
                            let entry = (documentation(&field.attrs), last_word(&field.ty));
                            known.insert((of.ident.to_string(), name.unwrap_or_default()), entry);
                        }
                    }
                    Item::Enum(of) => {
                        for variant in of.variants {
                            let inside = match &variant.fields {
                                Fields::Unnamed(fields) => last_word(&fields.unnamed[0].ty),
                                _ => String::new(),
                            };
                            let entry = (documentation(&variant.attrs), inside);
                            known.insert((of.ident.to_string(), variant.ident.to_string()), entry);
                        }
                    }
                    _ => {}
                }
            }
        }
        Descriptions(known)
    }

    /// What the key is.
    ///
    /// # Panics
    /// If nothing describes it.
    pub fn of(&self, of: &str, key: &str) -> String {
        let (text, _) = self.entry(of, key);
        assert!(!text.is_empty(), "{of}::{key} has no documentation");
        text.clone()
    }

    /// The struct that a key's table is read into.
    pub fn type_of(&self, of: &str, key: &str) -> String {
        self.entry(of, key).1.clone()
    }

    /// The struct of a kind of sensor.
    pub fn struct_of_kind(&self, kind: &str) -> String {
        self.type_of("SensorSpec", &camel(kind))
    }

    fn entry(&self, of: &str, key: &str) -> &(String, String) {
        self.0
            .get(&(of.to_owned(), key.to_owned()))
            .unwrap_or_else(|| panic!("no source has {of}::{key}"))
    }
}

/// `lane_invasion` as Rust writes variants.
pub fn camel(word: &str) -> String {
    word.split('_')
        .map(|part| part[..1].to_uppercase() + &part[1..])
        .collect()
}

/// Text of the `///` lines, without the brackets of links.
fn documentation(attributes: &[Attribute]) -> String {
    let lines = attributes.iter().filter_map(|attribute| {
        let Meta::NameValue(pair) = &attribute.meta else {
            return None;
        };
        match &pair.value {
            Expr::Lit(literal) if pair.path.is_ident("doc") => match &literal.lit {
                Lit::Str(text) => Some(text.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        }
    });
    let text = lines.collect::<Vec<_>>().join(" ");
    text.replace("[`", "`").replace("`]", "`")
}

/// Last word of a type: `Ready` of `Option<Ready>`.
fn last_word(of: &Type) -> String {
    match of {
        Type::Path(path) => {
            let last = path.path.segments.last().expect("a path has segments");
            match &last.arguments {
                syn::PathArguments::AngleBracketed(inside) => inside
                    .args
                    .iter()
                    .find_map(|argument| match argument {
                        syn::GenericArgument::Type(of) => Some(last_word(of)),
                        _ => None,
                    })
                    .unwrap_or_default(),
                _ => last.ident.to_string(),
            }
        }
        _ => String::new(),
    }
}
