//! What is on the disk while a recording is written.

use std::cell::RefCell;
use std::io::{self, BufWriter, Cursor, Seek, SeekFrom, Write};
use std::rc::Rc;

use schema_recording::walk::{RecordWalk, for_each_in_chunk};
use schema_recording::write::{ChunkCompression, options};

/// A file that keeps what is in it after every write.
#[derive(Default)]
struct Disk {
    file: Cursor<Vec<u8>>,
    states: Rc<RefCell<Vec<Vec<u8>>>>,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.states.borrow_mut().push(self.file.get_ref().clone());
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// Chunks of a file that may be cut off: those that can be read, and the damaged ones.
fn chunks(file: &[u8]) -> (usize, usize) {
    let Ok(mut walk) = RecordWalk::new(file, file.len() as u64) else {
        return (0, 0);
    };
    let (mut n_whole, mut n_damaged) = (0, 0);
    while let Some((opcode, body)) = walk.next_record() {
        if opcode == mcap::records::op::CHUNK {
            match for_each_in_chunk(&body, &mut |_| Ok(())) {
                Ok(()) => n_whole += 1,
                Err(_) => n_damaged += 1,
            }
        }
    }
    (n_whole, n_damaged)
}

#[test]
fn a_recording_that_is_cut_off_after_any_write_has_no_damaged_chunk() {
    for compression in [
        ChunkCompression::None,
        ChunkCompression::Lz4,
        ChunkCompression::Zstd,
    ] {
        let disk = Disk::default();
        let states = disk.states.clone();
        let mut writer = options(compression)
            .create(BufWriter::with_capacity(1 << 12, disk))
            .unwrap();
        let schema = writer.add_schema("bytes", "", &[]).unwrap();
        let topic = writer
            .add_channel(schema, "topic", "raw", &Default::default())
            .unwrap();
        for n in 0..30_u8 {
            let header = mcap::records::MessageHeader {
                channel_id: topic,
                sequence: n.into(),
                log_time: n.into(),
                publish_time: n.into(),
            };
            // Half of it does not get shorter.
            let message: Vec<u8> = (0..3000_u32)
                .map(|at| ((at.wrapping_mul(2_654_435_761) >> 24) as u8 * (at % 2) as u8) ^ n)
                .collect();
            writer.write_to_known_channel(&header, &message).unwrap();
            if n % 10 == 9 {
                writer.flush().unwrap();
            }
        }
        writer.finish().unwrap();
        let states = states.borrow();
        assert!(states.len() > 6, "{} writes", states.len());
        let mut n_before = 0;
        for (n, state) in states.iter().enumerate() {
            let (n_whole, n_damaged) = chunks(state);
            assert_eq!(n_damaged, 0, "{compression:?}, after write {n}");
            assert!(n_whole >= n_before, "{compression:?}, after write {n}");
            n_before = n_whole;
        }
        assert_eq!(n_before, 3);
    }
}
