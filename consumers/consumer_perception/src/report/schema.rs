//! The JSON schema of `report.json`: made from the types and their comments. The file
//! `launch/bench/report.schema.json` is this text.

use schemars::generate::SchemaSettings;

use super::types::Report;

/// The schema, draft 2020-12. It allows no key that the types do not have.
pub fn text() -> String {
    let settings = SchemaSettings::draft2020_12()
        .with_transform(schemars::transform::RecursiveTransform(close));
    let mut schema = settings.into_generator().into_root_schema_for::<Report>();
    schema.insert(
        "title".into(),
        "Report of Gantry's perception benchmark".into(),
    );
    let mut text = serde_json::to_string_pretty(&schema).expect("a schema is plain data");
    text.push('\n');
    text
}

/// Objects with named fields have no others.
fn close(schema: &mut schemars::Schema) {
    if schema.get("properties").is_some() && schema.get("additionalProperties").is_none() {
        schema.insert("additionalProperties".into(), false.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_in_the_repository_is_the_schema_of_the_types() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../launch/bench/report.schema.json");
        if std::env::var_os("GANTRY_BLESS").is_some() {
            std::fs::write(&path, text()).unwrap();
        }
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            found == text(),
            "launch/bench/report.schema.json differs from the types; write it with `gantry bench show --schema`"
        );
    }
}
