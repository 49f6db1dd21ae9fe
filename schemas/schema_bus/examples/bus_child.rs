//! The process that this crate's tests kill: `bus_child ROOT PREFIX ROLE` publishes and holds a loan,
//! or reads and holds frames, until it is killed.

use std::error::Error;
use std::time::Duration;

use schema_bus::{Bus, BusOptions, FrameTopic, names};

const FRAME_BYTES: usize = 16 * 8 * 4;
const SPEC: FrameTopic = FrameTopic {
    max_payload_bytes: FRAME_BYTES,
    frames_in_flight: 2,
    max_readers: 4,
    buffer: 2,
    borrowed: 3,
};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [root, prefix, role] = &words[..] else {
        return Err("usage: bus_child ROOT PREFIX ROLE".into());
    };
    let options = BusOptions {
        iceoryx_root: Some(root.into()),
        prefix: Some(prefix.clone()),
    };
    let bus = Bus::open_with("d", "child", &options)?;
    match role.as_str() {
        "read" => {
            let mut reader = bus.frame_reader("ego/front/rgb")?;
            let mut held = Vec::new();
            loop {
                if held.len() < 3 {
                    held.extend(reader.next()?);
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        "info" => {
            let _info = bus.document_publisher(names::WORLD_INFO)?;
            std::thread::sleep(Duration::from_secs(60));
            Ok(())
        }
        "publish" => publish(&bus),
        // Its connection is between two ports of its own.
        "both" => {
            let publisher = bus.frame_publisher("ego/front/rgb", SPEC)?;
            let mut reader = bus.frame_reader("ego/front/rgb")?;
            loop {
                publisher.loan(FRAME_BYTES)?.send()?;
                drop(reader.next()?);
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        _ => Err(format!("there is no role {role:?}; roles: read, info, publish, both").into()),
    }
}

/// Every frame is filled with the last byte of its number.
fn publish(bus: &Bus) -> Result<(), Box<dyn Error>> {
    let publisher = bus.frame_publisher("ego/front/rgb", SPEC)?;
    let _loan = publisher.loan(FRAME_BYTES)?;
    for seq in 1.. {
        let mut loan = publisher.loan(FRAME_BYTES)?;
        loan.payload_mut().fill(seq as u8);
        let header = loan.header_mut();
        header.set_image(16, 8);
        (header.epoch, header.seq, header.tick) = (1, seq, seq);
        loan.send()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(())
}
