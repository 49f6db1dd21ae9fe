//! Announces a frame topic as a build of another version would: for trying what a reader says to
//! it.
//!
//! `cargo run --release -p schema_bus --example other_version -- DOMAIN TOPIC SCHEMA`; runs until
//! it is killed.

use std::error::Error;

use iceoryx2::prelude::*;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [domain, topic, schema] = words.as_slice() else {
        return Err("usage: other_version DOMAIN TOPIC SCHEMA".into());
    };
    let node = NodeBuilder::new().create::<ipc::Service>()?;
    let attributes = AttributeSpecifier::new().define(
        &schema_frames::SCHEMA_ATTRIBUTE.try_into()?,
        &schema.as_str().try_into()?,
    )?;
    let name = format!("{domain}/{topic}");
    let service = node
        .service_builder(&name.as_str().try_into()?)
        .publish_subscribe::<[u8]>()
        .create_with_attributes(&attributes)?;
    let _publisher = service
        .publisher_builder()
        .initial_max_slice_len(64)
        .create()?;
    println!("{name} announces schema {schema}");
    loop {
        std::thread::sleep(std::time::Duration::from_secs(1));
    }
}
