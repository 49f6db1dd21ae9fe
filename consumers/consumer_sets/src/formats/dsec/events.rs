//! `events.h5` of a camera: events in columns, and where each millisecond begins.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use anyhow::ensure;
use schema_frames::DvsEvent;

use super::hdf5::{Column, Entry, Hdf5File, Number};
use crate::formats::evt3::micros;
use crate::tree::PartFile;
use consumer_truth::ticks::TickFrame;

/// A file of events that grows.
#[derive(Debug)]
pub struct EventFile {
    file: Hdf5File<PartFile>,
    /// p, t, x, y; then class and object of each event.
    columns: [Column; 6],
    ms_to_idx: Column,
    offset_micros: u64,
}

impl EventFile {
    /// Begins a file whose times count from `offset_micros`, microseconds since the simulator's
    /// start.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn begin(part: PartFile, offset_micros: u64) -> anyhow::Result<EventFile> {
        use Number::{U8, U16, U32, U64};
        Ok(EventFile {
            file: Hdf5File::create(part)?,
            columns: [U8, U32, U16, U16, U8, U32].map(Column::new),
            ms_to_idx: Column::new(U64),
            offset_micros,
        })
    }

    /// Events written so far.
    pub fn n_events(&self) -> u64 {
        self.columns[0].n_items()
    }

    /// Appends the events of a frame.
    ///
    /// # Errors
    /// If the disk refuses, or if an event comes more than 71 minutes after the first: the format's
    /// times have 32 bits.
    pub fn append(&mut self, frame: &TickFrame) -> anyhow::Result<()> {
        let events = frame.elements::<DvsEvent>();
        let mut bytes: [Vec<u8>; 6] = Default::default();
        let mut starts = Vec::new();
        for (at, event) in events.iter().enumerate() {
            let micros = micros(&frame.header, event).saturating_sub(self.offset_micros);
            let short = u32::try_from(micros);
            ensure!(
                short.is_ok(),
                "dsec holds 71 minutes of events, and this one comes {} s after the first; export parts with --from and --to",
                micros / 1_000_000
            );
            // Each millisecond begins at the first event that is not before it.
            let n_begun = (starts.len() / 8) as u64;
            let n_started = self.ms_to_idx.n_items().saturating_add(n_begun);
            let first = self.n_events().saturating_add(at as u64);
            for _ in n_started..(micros / 1000).saturating_add(1) {
                starts.extend(first.to_le_bytes());
            }
            bytes[0].push(event.polarity.min(1));
            bytes[1].extend(short.unwrap_or_default().to_le_bytes());
            bytes[2].extend(event.x_px.to_le_bytes());
            bytes[3].extend(event.y_px.to_le_bytes());
            bytes[4].push(event.class);
            bytes[5].extend(event.object_id.to_le_bytes());
        }
        for (column, bytes) in self.columns.iter_mut().zip(&bytes) {
            self.file.append(column, bytes)?;
        }
        self.file.append(&mut self.ms_to_idx, &starts)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn finish(self) -> anyhow::Result<()> {
        let EventFile {
            mut file,
            columns,
            ms_to_idx,
            offset_micros,
        } = self;
        let mut arrays = Vec::with_capacity(columns.len());
        for column in columns {
            arrays.push(Entry::Array(file.close(column)?));
        }
        let ms_to_idx = file.close(ms_to_idx)?;
        let offset = (offset_micros as i64).to_le_bytes();
        let t_offset = file.array(Number::I64, &[], &offset)?;
        let mut named = ["p", "t", "x", "y", "class", "object_id"]
            .into_iter()
            .zip(arrays);
        let events = named.by_ref().take(4).collect();
        let labels = named.collect();
        let part = file.finish(vec![
            ("events", Entry::Group(events)),
            ("labels", Entry::Group(labels)),
            ("ms_to_idx", Entry::Array(ms_to_idx)),
            ("t_offset", Entry::Array(t_offset)),
        ])?;
        part.finish()
    }
}

/// Writes `rectify_map.h5`: where each pixel lies without distortion, which is where it is.
///
/// # Errors
/// If the disk refuses.
pub fn write_rectify_map(part: PartFile, (width, height): (u32, u32)) -> anyhow::Result<()> {
    let mut file = Hdf5File::create(part)?;
    let mut map = Vec::new();
    for y in 0..height {
        for x in 0..width {
            map.extend((x as f32).to_le_bytes());
            map.extend((y as f32).to_le_bytes());
        }
    }
    let dims = [u64::from(height), u64::from(width), 2];
    let map = file.array(Number::F32, &dims, &map)?;
    file.finish(vec![("rectify_map", Entry::Array(map))])?
        .finish()
}
