//! What a result topic says about itself beyond its type: names of classes, fields of points, the
//! schema of bytes. It is JSON in the document `<topic>/about`.

use serde::{Deserialize, Serialize};

use crate::result::MAX_POINT_BYTES;
use crate::result_type::{ElementType, ResultType};

/// Last segment of the document that describes a result topic.
pub const ABOUT: &str = "about";

/// Description of a result topic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct About {
    /// Names of the classes that its records number, from 0; empty: CARLA's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub classes: Vec<String>,
    /// Fields of its points; empty: `x`, `y`, `z` and `intensity`, all `f32`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub fields: Vec<PointField>,
    /// Pairs of key points that a bone joins.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bones: Vec<[u32; 2]>,
    /// Schema of its bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub schema: Option<BytesSchema>,
    /// A sentence for people.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub note: String,
}

/// One field of a point.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointField {
    /// Name: `x`, `y`, `z` are metres in the result's space.
    pub name: String,
    /// Name of its [`ElementType`].
    #[serde(rename = "type")]
    pub element: String,
    /// Offset in the point, bytes.
    pub offset: u32,
}

/// What a topic's bytes are, as MCAP says it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BytesSchema {
    /// Name of the message type, for example `perception.Detections`.
    pub name: String,
    /// How a message is encoded: `protobuf`, `json`, `flatbuffer`, `cbor`, `msgpack`, `ros1`,
    /// `cdr`, or a name of the user's own.
    pub message_encoding: String,
    /// How the schema is written: `protobuf`, `jsonschema`, `flatbuffer`, `ros2msg`, or empty.
    pub schema_encoding: String,
    /// The schema as text.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// The schema as bytes in base64, where it is no text (protobuf's and flatbuffers').
    #[serde(skip_serializing_if = "String::is_empty")]
    pub base64: String,
}

/// Why an [`About`] does not fit its topic.
#[derive(Debug, thiserror::Error)]
pub enum AboutError {
    /// A field of a point that has none of the known types.
    #[error(
        "field {field:?} of a point has type {element:?}, but it must be one of {}",
        ElementType::ALL.iter().map(|it| it.name()).collect::<Vec<_>>().join(", ")
    )]
    Element {
        /// Its name.
        field: String,
        /// Its type.
        element: String,
    },
    /// A point of so many bytes.
    #[error("points of {0} bytes are too long; they may have {MAX_POINT_BYTES}")]
    PointBytes(usize),
    /// Point fields for a topic of this other type.
    #[error("a topic of {0} has no point fields")]
    NoPoints(&'static str),
    /// A schema for a topic of this other type.
    #[error("a topic of {0} has a fixed layout and takes no schema; make it one of bytes")]
    FixedLayout(&'static str),
    /// Bytes without a schema.
    #[error("a topic of bytes must name its schema and its message encoding, as MCAP does")]
    NoSchema,
    /// A schema that does not say what it is.
    #[error(
        "the schema of a topic of bytes needs a name and a message encoding (protobuf, json, flatbuffer, …)"
    )]
    Nameless,
}

impl About {
    /// Whether it says nothing, so that no document is needed.
    pub fn is_empty(&self) -> bool {
        *self == About::default()
    }

    /// Name of class `class`: of the topic's list, or CARLA's.
    pub fn class_name(&self, class: u32) -> String {
        let own = self.classes.get(class as usize).cloned();
        let known = || {
            schema_types::class::CLASSES
                .get(class as usize)
                .filter(|_| self.classes.is_empty())
                .map(|known| known.name.to_string())
        };
        own.or_else(known).unwrap_or_else(|| class.to_string())
    }

    /// The fields of its points, and the bytes of one point.
    pub fn point_fields(&self) -> (Vec<PointField>, usize) {
        if self.fields.is_empty() {
            let field = |(i, name): (usize, &&str)| PointField {
                name: name.to_string(),
                element: ElementType::F32.name().into(),
                offset: i as u32 * 4,
            };
            let usual = ["x", "y", "z", "intensity"];
            return (usual.iter().enumerate().map(field).collect(), 16);
        }
        let ends = self.fields.iter().map(|field| {
            let bytes = ElementType::from_name(&field.element).map_or(0, |of| of.element_bytes());
            field.offset as usize + bytes
        });
        let end = ends.max().unwrap_or(0);
        (self.fields.clone(), end)
    }

    /// Checks that it fits a topic of type `kind`.
    ///
    /// # Errors
    /// [`AboutError`].
    pub fn check(&self, kind: ResultType) -> Result<(), AboutError> {
        for field in &self.fields {
            if ElementType::from_name(&field.element).is_none() {
                return Err(AboutError::Element {
                    field: field.name.clone(),
                    element: field.element.clone(),
                });
            }
        }
        let (_, bytes) = self.point_fields();
        if bytes > MAX_POINT_BYTES {
            return Err(AboutError::PointBytes(bytes));
        }
        if !self.fields.is_empty() && kind != ResultType::Points {
            return Err(AboutError::NoPoints(kind.name()));
        }
        match &self.schema {
            Some(_) if kind != ResultType::Bytes => Err(AboutError::FixedLayout(kind.name())),
            None if kind == ResultType::Bytes => Err(AboutError::NoSchema),
            Some(schema) if schema.name.is_empty() || schema.message_encoding.is_empty() => {
                Err(AboutError::Nameless)
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_without_a_list_are_those_of_carla() {
        assert_eq!(About::default().class_name(14), "Car");
        let own = About {
            classes: vec!["person".into()],
            ..About::default()
        };
        assert_eq!(own.class_name(0), "person");
        assert_eq!(own.class_name(14), "14");
    }

    #[test]
    fn a_description_must_fit_its_type() {
        let none = About::default();
        assert!(none.is_empty() && none.check(ResultType::Boxes2d).is_ok());
        assert!(none.check(ResultType::Bytes).is_err());
        let mut points = About::default();
        points.fields.push(PointField {
            name: "x".into(),
            element: "float".into(),
            offset: 0,
        });
        assert!(
            points
                .check(ResultType::Points)
                .unwrap_err()
                .to_string()
                .contains("\"float\"")
        );
        points.fields[0].element = "f64".into();
        assert_eq!(points.point_fields().1, 8);
        assert!(points.check(ResultType::Points).is_ok());
        assert!(points.check(ResultType::Tracks).is_err());
    }
}
