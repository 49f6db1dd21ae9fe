//! What crosses the link for one sample: an envelope beside the payload, and the payload in the
//! coding that the sender chose.
//!
//! The envelope is zenoh's attachment: 16 bytes, then the sample's user header as it is on the bus,
//! then the inputs of a result. The payload is the sample's own, or smaller by its [`Coding`].

use anyhow::{Context as _, bail, ensure};
use bytemuck::{Pod, Zeroable, bytes_of, pod_collect_to_vec, pod_read_unaligned};
use schema_frames::control::ControlHeader;
use schema_frames::{ActorRecord, SnapshotHeader, VehicleControlRecord};
use zenoh::bytes::ZBytes;

use crate::coding::{Coding, copy_to, decode};

/// "GBRG" read as a little-endian `u32`.
const MAGIC: u32 = u32::from_le_bytes(*b"GBRG");
/// Version of the envelope and of everything else that bridges tell each other.
pub const VERSION: u16 = 1;
/// Longest payload that is accepted, bytes: more than any frame has, and what zenoh accepts.
pub const MAX_PAYLOAD_BYTES: u64 = 1 << 30;

/// The first bytes of every envelope.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
struct Head {
    magic: u32,
    version: u16,
    coding: u8,
    reserved: u8,
    /// Bytes of the payload before it was coded.
    raw_bytes: u64,
}
const _: () = assert!(size_of::<Head>() == 16);

/// An envelope that was opened.
#[derive(Debug)]
pub struct Envelope {
    /// How the payload is coded.
    pub coding: Coding,
    /// Bytes of the payload once it is decoded.
    pub raw_bytes: usize,
    /// User header and what belongs to it.
    rest: Vec<u8>,
}

impl Envelope {
    /// Packs the user header of a sample whose payload has `raw_bytes` and is sent as `coding` says;
    /// `behind` are the inputs of a result.
    pub fn pack(header: &[u8], behind: &[u8], raw_bytes: usize, coding: Coding) -> Vec<u8> {
        let head = Head {
            magic: MAGIC,
            version: VERSION,
            coding: coding.number(),
            reserved: 0,
            raw_bytes: raw_bytes as u64,
        };
        [bytes_of(&head), header, behind].concat()
    }

    /// Opens what another bridge sent.
    ///
    /// # Errors
    /// A sentence for what no bridge of this version sends.
    pub fn open(attachment: Option<&ZBytes>) -> anyhow::Result<Envelope> {
        let bytes = attachment
            .context("a sample came without its envelope; its sender is no gantry-bridge")?
            .to_bytes();
        let head = bytes.get(..size_of::<Head>());
        let head: Head = pod_read_unaligned(head.context("an envelope is shorter than 16 bytes")?);
        ensure!(
            head.magic == MAGIC,
            "an envelope begins with {:#010x}, not with \"GBRG\"",
            head.magic
        );
        ensure!(
            head.version == VERSION,
            "the other bridge speaks version {}, this one {VERSION}; rebuild the older of the two",
            head.version
        );
        ensure!(
            head.raw_bytes <= MAX_PAYLOAD_BYTES,
            "a payload claims {} bytes; {MAX_PAYLOAD_BYTES} are allowed",
            head.raw_bytes
        );
        let Some(coding) = Coding::from_number(head.coding) else {
            bail!(
                "a payload is coded in way {}, which this bridge does not know; rebuild it",
                head.coding
            )
        };
        Ok(Envelope {
            coding,
            raw_bytes: head.raw_bytes as usize,
            rest: bytes[size_of::<Head>()..].to_vec(),
        })
    }

    /// The user header and what lies behind it.
    ///
    /// # Errors
    /// A sentence if the envelope is too short.
    pub fn header<H: Pod>(&self) -> anyhow::Result<(H, &[u8])> {
        let bytes = self.rest.get(..size_of::<H>());
        let bytes = bytes.with_context(|| {
            format!(
                "an envelope holds {} bytes of header, {} are needed",
                self.rest.len(),
                size_of::<H>()
            )
        })?;
        Ok((pod_read_unaligned(bytes), &self.rest[size_of::<H>()..]))
    }

    /// A payload that is no frame's, as it was on the other machine.
    ///
    /// # Errors
    /// A sentence if it cannot be decoded.
    pub fn plain(&self, payload: &ZBytes) -> anyhow::Result<Vec<u8>> {
        let mut bytes = vec![0; self.raw_bytes];
        decode(self.coding, None, payload, &mut bytes)?;
        Ok(bytes)
    }
}

/// Controls of a program of another machine.
#[derive(Debug)]
pub struct Controls {
    /// Name of the program there.
    pub writer: String,
    /// The tick that they are for.
    pub tick: u64,
    /// One record per vehicle.
    pub records: Vec<VehicleControlRecord>,
}

/// Reads controls, of at most `max_bytes`.
///
/// # Errors
/// A sentence for what no bridge sends.
pub fn controls(
    attachment: Option<&ZBytes>,
    payload: &ZBytes,
    max_bytes: usize,
) -> anyhow::Result<Controls> {
    let envelope = Envelope::open(attachment)?;
    let (header, _) = envelope.header::<ControlHeader>()?;
    let len = header.writer.iter().position(|byte| *byte == 0);
    let name = &header.writer[..len.unwrap_or(header.writer.len())];
    let record_bytes = size_of::<VehicleControlRecord>();
    ensure!(
        envelope.raw_bytes.is_multiple_of(record_bytes) && envelope.raw_bytes <= max_bytes,
        "controls have {} bytes; a multiple of {record_bytes} up to {max_bytes} is allowed",
        envelope.raw_bytes
    );
    let mut bytes = vec![0; envelope.raw_bytes];
    copy_to(payload, &mut bytes)?;
    Ok(Controls {
        writer: String::from_utf8_lossy(name).into_owned(),
        tick: header.tick,
        records: pod_collect_to_vec(&bytes),
    })
}

/// Reads a snapshot.
///
/// # Errors
/// A sentence for what is none.
pub fn snapshot(
    envelope: &Envelope,
    payload: &ZBytes,
) -> anyhow::Result<(SnapshotHeader, Vec<ActorRecord>)> {
    let (header, _) = envelope.header::<SnapshotHeader>()?;
    ensure!(
        envelope.raw_bytes == header.n_actors as usize * size_of::<ActorRecord>(),
        "a snapshot claims {} actors in {} bytes",
        header.n_actors,
        envelope.raw_bytes
    );
    let records: Vec<ActorRecord> = pod_collect_to_vec(&envelope.plain(payload)?);
    ensure!(
        records.is_sorted_by_key(|record| record.id),
        "a snapshot's actors are not in order"
    );
    Ok((header, records))
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_frames::{FrameHeader, Modality};

    #[test]
    fn a_header_comes_out_as_it_went_in() {
        let mut header = FrameHeader::new(Modality::Depth);
        (header.tick, header.seq) = (7, 9);
        let packed = Envelope::pack(bytes_of(&header), b"inputs", 1234, Coding::Lz4);
        let opened = Envelope::open(Some(&ZBytes::from(packed))).unwrap();
        assert_eq!((opened.coding, opened.raw_bytes), (Coding::Lz4, 1234));
        let (found, behind) = opened.header::<FrameHeader>().unwrap();
        assert_eq!(bytes_of(&found), bytes_of(&header));
        assert_eq!(behind, b"inputs");
    }

    #[test]
    fn foreign_envelopes_are_refused_with_a_sentence() {
        let good = Envelope::pack(&[0; 8], &[], 8, Coding::None);
        let changed = |at: usize, to: u8| {
            let mut bytes = good.clone();
            bytes[at] = to;
            Envelope::open(Some(&ZBytes::from(bytes)))
                .unwrap_err()
                .to_string()
        };
        assert!(changed(0, 0).contains("GBRG"));
        assert!(changed(4, 9).contains("version 9"));
        assert!(changed(6, 77).contains("way 77"));
        assert!(changed(15, 1).contains("are allowed"));
        assert!(Envelope::open(None).is_err());
        assert!(Envelope::open(Some(&ZBytes::from(vec![1, 2]))).is_err());
        let short = Envelope::open(Some(&ZBytes::from(good))).unwrap();
        assert!(short.header::<FrameHeader>().is_err());
    }
}
