//! Writes HDF5 files: groups of numeric arrays, and columns that grow and are compressed.
//!
//! The bytes are those of the file format's first version (superblock 0, object headers 1, symbol
//! tables, B-trees 1), which every HDF5 library reads. Nothing in them depends on the time or the
//! machine. Only what event datasets need is here; there is no reading.

use std::io::{Seek, SeekFrom, Write};

use anyhow::ensure;
use flate2::Compression;
use flate2::write::ZlibEncoder;

/// An address that leads nowhere.
const UNDEFINED: u64 = u64::MAX;
/// Bytes of a superblock of version 0.
const SUPERBLOCK_BYTES: usize = 96;
/// Half of the entries that a leaf of a symbol table holds.
const LEAF_K: usize = 4;
/// Half of the children of a node of a group's B-tree.
const GROUP_K: usize = 16;
/// Half of the children of a node of a chunk index; superblock 0 has no field for it.
const CHUNK_K: usize = 32;
/// Elements of a chunk of a column.
const CHUNK_ITEMS: usize = 1 << 16;
/// zlib's level: past it files of events shrink by less than a hundredth.
const DEFLATE_LEVEL: u32 = 4;

/// Type of an array's numbers; all are little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// Unsigned, 8 bits.
    U8,
    /// Unsigned, 16 bits.
    U16,
    /// Unsigned, 32 bits.
    U32,
    /// Unsigned, 64 bits.
    U64,
    /// Signed, 64 bits.
    I64,
    /// IEEE 754, 32 bits.
    F32,
}

impl Number {
    /// Bytes of one.
    pub fn n_bytes(self) -> usize {
        match self {
            Number::U8 => 1,
            Number::U16 => 2,
            Number::U32 | Number::F32 => 4,
            Number::U64 | Number::I64 => 8,
        }
    }

    /// The body of a datatype message.
    fn message(self) -> Vec<u8> {
        let n_bytes = self.n_bytes() as u32;
        let mut body = Vec::with_capacity(24);
        if self == Number::F32 {
            // Class 1: implied leading mantissa bit, sign at bit 31.
            body.extend([0x11, 0x20, 31, 0]);
            body.extend(n_bytes.to_le_bytes());
            body.extend([0, 0, 32, 0, 23, 8, 0, 23]);
            body.extend(127u32.to_le_bytes());
        } else {
            let signed = if self == Number::I64 { 8 } else { 0 };
            body.extend([0x10, signed, 0, 0]);
            body.extend(n_bytes.to_le_bytes());
            body.extend([0, 0]);
            body.extend(((n_bytes * 8) as u16).to_le_bytes());
        }
        body
    }
}

/// An array that is in the file and waits for a name.
#[derive(Clone, Copy, Debug)]
pub struct Object(u64);

/// What a name in a group stands for.
#[derive(Debug)]
pub enum Entry {
    /// An array.
    Array(Object),
    /// A group of entries.
    Group(Vec<(&'static str, Entry)>),
}

/// A one-dimensional array that grows, cut into compressed chunks.
#[derive(Debug)]
pub struct Column {
    number: Number,
    n_items: u64,
    buffer: Vec<u8>,
    /// Address and bytes of each chunk.
    chunks: Vec<(u64, u32)>,
}

impl Column {
    /// An empty column.
    pub fn new(number: Number) -> Column {
        Column {
            number,
            n_items: 0,
            buffer: Vec::with_capacity(CHUNK_ITEMS * number.n_bytes()),
            chunks: Vec::new(),
        }
    }

    /// Elements appended so far.
    pub fn n_items(&self) -> u64 {
        self.n_items
    }
}

/// An HDF5 file under construction.
#[derive(Debug)]
pub struct Hdf5File<W> {
    out: W,
    at: u64,
}

impl<W: Write + Seek> Hdf5File<W> {
    /// Begins a file on an empty output.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn create(out: W) -> anyhow::Result<Self> {
        let mut made = Hdf5File { out, at: 0 };
        made.put(&[0; SUPERBLOCK_BYTES])?;
        Ok(made)
    }

    /// Appends the little-endian bytes of whole numbers to a column.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn append(&mut self, column: &mut Column, mut bytes: &[u8]) -> anyhow::Result<()> {
        let n_bytes = column.number.n_bytes();
        debug_assert!(bytes.len().is_multiple_of(n_bytes));
        column.n_items += (bytes.len() / n_bytes) as u64;
        while !bytes.is_empty() {
            let room = CHUNK_ITEMS * n_bytes - column.buffer.len();
            let (now, later) = bytes.split_at(room.min(bytes.len()));
            column.buffer.extend_from_slice(now);
            bytes = later;
            if column.buffer.len() == CHUNK_ITEMS * n_bytes {
                self.put_chunk(column)?;
            }
        }
        Ok(())
    }

    /// Ends a column.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn close(&mut self, mut column: Column) -> anyhow::Result<Object> {
        let n_bytes = column.number.n_bytes();
        if !column.buffer.is_empty() {
            // Chunks are whole; the elements past the end do not count.
            column.buffer.resize(CHUNK_ITEMS * n_bytes, 0);
            self.put_chunk(&mut column)?;
        }
        let index = self.put_chunk_index(&column.chunks)?;
        let mut layout = vec![3, 2, 2];
        layout.extend(index.to_le_bytes());
        layout.extend((CHUNK_ITEMS as u32).to_le_bytes());
        layout.extend((n_bytes as u32).to_le_bytes());
        let filters = [
            1,
            2,
            0,
            0,
            0,
            0,
            0,
            0, // two filters
            2,
            0,
            0,
            0,
            0,
            0,
            1,
            0,
            n_bytes as u8,
            0,
            0,
            0,
            0,
            0,
            0,
            0, // shuffle
            1,
            0,
            0,
            0,
            0,
            0,
            1,
            0,
            DEFLATE_LEVEL as u8,
            0,
            0,
            0,
            0,
            0,
            0,
            0, // deflate
        ];
        self.put_object(&[
            (0x01, dataspace(&[column.n_items])),
            (0x03, column.number.message()),
            (0x05, vec![2, 3, 2, 1, 0, 0, 0, 0]),
            (0x08, layout),
            (0x0b, filters.to_vec()),
        ])
    }

    /// Writes an array of any shape, uncompressed; `dims` is empty for one number.
    ///
    /// # Errors
    /// If `bytes` does not have the shape's length, or the disk refuses.
    pub fn array(&mut self, number: Number, dims: &[u64], bytes: &[u8]) -> anyhow::Result<Object> {
        let n_wanted = dims.iter().product::<u64>() * number.n_bytes() as u64;
        ensure!(
            bytes.len() as u64 == n_wanted,
            "an array of shape {dims:?} has {n_wanted} bytes, not {}",
            bytes.len()
        );
        let address = if bytes.is_empty() {
            UNDEFINED
        } else {
            self.put(bytes)?
        };
        let mut layout = vec![3, 1];
        layout.extend(address.to_le_bytes());
        layout.extend(n_wanted.to_le_bytes());
        self.put_object(&[
            (0x01, dataspace(dims)),
            (0x03, number.message()),
            (0x05, vec![2, 2, 2, 1, 0, 0, 0, 0]),
            (0x08, layout),
        ])
    }

    /// Names what was written, ends the file and hands back what was written to.
    ///
    /// # Errors
    /// If the disk refuses, or a group has more than eight entries.
    pub fn finish(mut self, root: Vec<(&'static str, Entry)>) -> anyhow::Result<W> {
        let (header, tree, heap) = self.put_group(root)?;
        let mut block = Vec::with_capacity(SUPERBLOCK_BYTES);
        block.extend(b"\x89HDF\r\n\x1a\n");
        block.extend([0, 0, 0, 0, 0, 8, 8, 0]);
        block.extend((LEAF_K as u16).to_le_bytes());
        block.extend((GROUP_K as u16).to_le_bytes());
        block.extend([0; 4]);
        for address in [0, UNDEFINED, self.at, UNDEFINED] {
            block.extend(address.to_le_bytes());
        }
        block.extend(symbol(0, header, Some((tree, heap))));
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&block)?;
        Ok(self.out)
    }

    /// Writes bytes at the next multiple of eight and returns their address.
    fn put(&mut self, bytes: &[u8]) -> anyhow::Result<u64> {
        let pad = self.at.next_multiple_of(8) - self.at;
        self.out.write_all(&[0; 8][..pad as usize])?;
        let address = self.at + pad;
        self.out.write_all(bytes)?;
        self.at = address + bytes.len() as u64;
        Ok(address)
    }

    fn put_chunk(&mut self, column: &mut Column) -> anyhow::Result<()> {
        let shuffled = shuffle(&column.buffer, column.number.n_bytes());
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(DEFLATE_LEVEL));
        encoder.write_all(&shuffled)?;
        let packed = encoder.finish()?;
        column.buffer.clear();
        let address = self.put(&packed)?;
        column.chunks.push((address, packed.len() as u32));
        Ok(())
    }

    /// Writes the B-tree over a column's chunks, and returns its root; an empty column has none.
    fn put_chunk_index(&mut self, chunks: &[(u64, u32)]) -> anyhow::Result<u64> {
        if chunks.is_empty() {
            return Ok(UNDEFINED);
        }
        // A node's key is that of its first chunk: bytes, filter mask, offset of the chunk.
        let key = |idx: usize| {
            let n_bytes = chunks.get(idx).map_or(0, |chunk| chunk.1);
            let mut key = Vec::with_capacity(24);
            key.extend(n_bytes.to_le_bytes());
            key.extend([0; 4]);
            key.extend(((idx * CHUNK_ITEMS) as u64).to_le_bytes());
            key.extend([0; 8]);
            key
        };
        // First chunk and address of each child of the level in hand.
        let mut children: Vec<(usize, u64)> = chunks
            .iter()
            .enumerate()
            .map(|(idx, it)| (idx, it.0))
            .collect();
        for level in 0u8.. {
            let node_bytes = 24 + (2 * CHUNK_K) * 32 + 24;
            let base = self.at.next_multiple_of(8);
            let n_nodes = children.len().div_ceil(2 * CHUNK_K);
            let place = |node: usize| base + (node * node_bytes) as u64;
            let mut parents = Vec::with_capacity(n_nodes);
            for (node, group) in children.chunks(2 * CHUNK_K).enumerate() {
                let after = children.get((node + 1) * 2 * CHUNK_K);
                let mut bytes = b"TREE".to_vec();
                bytes.extend([1, level]);
                bytes.extend((group.len() as u16).to_le_bytes());
                let left = if node == 0 {
                    UNDEFINED
                } else {
                    place(node - 1)
                };
                let right = if node + 1 == n_nodes {
                    UNDEFINED
                } else {
                    place(node + 1)
                };
                bytes.extend(left.to_le_bytes());
                bytes.extend(right.to_le_bytes());
                for (first, address) in group {
                    bytes.extend(key(*first));
                    bytes.extend(address.to_le_bytes());
                }
                bytes.extend(key(after.map_or(chunks.len(), |next| next.0)));
                bytes.resize(node_bytes, 0);
                parents.push((group[0].0, self.put(&bytes)?));
            }
            if n_nodes == 1 {
                return Ok(parents[0].1);
            }
            children = parents;
        }
        unreachable!("each level has a sixty-fourth of the nodes of the one below")
    }

    /// Writes an object header with these messages.
    fn put_object(&mut self, messages: &[(u16, Vec<u8>)]) -> anyhow::Result<Object> {
        let mut body = Vec::new();
        for (kind, data) in messages {
            let n_bytes = data.len().next_multiple_of(8);
            body.extend(kind.to_le_bytes());
            body.extend((n_bytes as u16).to_le_bytes());
            body.extend([0; 4]);
            body.extend(data);
            body.resize(body.len() + n_bytes - data.len(), 0);
        }
        let mut header = vec![1, 0];
        header.extend((messages.len() as u16).to_le_bytes());
        header.extend(1u32.to_le_bytes());
        header.extend((body.len() as u32).to_le_bytes());
        header.extend([0; 4]);
        header.extend(body);
        Ok(Object(self.put(&header)?))
    }

    /// Writes a group; returns the addresses of its header, B-tree and heap.
    fn put_group(
        &mut self,
        mut entries: Vec<(&'static str, Entry)>,
    ) -> anyhow::Result<(u64, u64, u64)> {
        ensure!(
            entries.len() <= 2 * LEAF_K,
            "a group holds {} entries, the limit is {}",
            entries.len(),
            2 * LEAF_K
        );
        entries.sort_by_key(|(name, _)| *name);
        let mut names = vec![0u8; 8];
        let mut leaf = b"SNOD\x01\0".to_vec();
        leaf.extend((entries.len() as u16).to_le_bytes());
        let mut last_name = 0;
        for (name, entry) in entries {
            last_name = names.len() as u64;
            names.extend(name.as_bytes());
            names.resize((names.len() + 1).next_multiple_of(8), 0);
            let (header, cached) = match entry {
                Entry::Array(object) => (object.0, None),
                Entry::Group(inside) => {
                    let (header, tree, heap) = self.put_group(inside)?;
                    (header, Some((tree, heap)))
                }
            };
            leaf.extend(symbol(last_name, header, cached));
        }
        leaf.resize(8 + 2 * LEAF_K * 40, 0);
        let names_at = self.put(&names)?;
        let mut heap = b"HEAP\0\0\0\0".to_vec();
        heap.extend((names.len() as u64).to_le_bytes());
        // 1: there is no free space.
        heap.extend(1u64.to_le_bytes());
        heap.extend(names_at.to_le_bytes());
        let heap = self.put(&heap)?;
        let leaf = self.put(&leaf)?;
        let mut tree = b"TREE\0\0\x01\0".to_vec();
        tree.extend(UNDEFINED.to_le_bytes());
        tree.extend(UNDEFINED.to_le_bytes());
        for value in [0, leaf, last_name] {
            tree.extend(value.to_le_bytes());
        }
        tree.resize(24 + 2 * GROUP_K * 16 + 8, 0);
        let tree = self.put(&tree)?;
        let table = [tree.to_le_bytes(), heap.to_le_bytes()].concat();
        let Object(header) = self.put_object(&[(0x11, table)])?;
        Ok((header, tree, heap))
    }
}

/// The body of a dataspace message; without dimensions it is a scalar.
fn dataspace(dims: &[u64]) -> Vec<u8> {
    let mut body = vec![1, dims.len() as u8, 0, 0, 0, 0, 0, 0];
    body.extend(dims.iter().flat_map(|dim| dim.to_le_bytes()));
    body
}

/// An entry of a symbol table; of a group with the addresses of its B-tree and heap.
fn symbol(name: u64, header: u64, cached: Option<(u64, u64)>) -> Vec<u8> {
    let mut entry = Vec::with_capacity(40);
    entry.extend(name.to_le_bytes());
    entry.extend(header.to_le_bytes());
    entry.extend(u32::from(cached.is_some()).to_le_bytes());
    entry.extend([0; 4]);
    let (tree, heap) = cached.unwrap_or((0, 0));
    entry.extend(tree.to_le_bytes());
    entry.extend(heap.to_le_bytes());
    entry
}

/// All first bytes, then all second bytes, and so on.
fn shuffle(bytes: &[u8], n_bytes: usize) -> Vec<u8> {
    if n_bytes == 1 {
        return bytes.to_vec();
    }
    let mut shuffled = Vec::with_capacity(bytes.len());
    for at in 0..n_bytes {
        shuffled.extend(bytes.iter().skip(at).step_by(n_bytes));
    }
    shuffled
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn bytes_of_a_number_are_brought_together() {
        assert_eq!(shuffle(&[1, 2, 3, 4, 5, 6], 2), [1, 3, 5, 2, 4, 6]);
        assert_eq!(shuffle(&[1, 2, 3], 1), [1, 2, 3]);
    }

    #[test]
    fn the_same_content_makes_the_same_file_and_the_end_is_where_it_says() {
        let write = || {
            let mut file = Hdf5File::create(Cursor::new(Vec::new())).unwrap();
            let mut column = Column::new(Number::U16);
            for start in 0..3u16 {
                let values: Vec<u8> = (0..50_000u16)
                    .flat_map(|it| (it ^ start).to_le_bytes())
                    .collect();
                file.append(&mut column, &values).unwrap();
            }
            assert_eq!(column.n_items(), 150_000);
            let x = file.close(column).unwrap();
            let offset = file.array(Number::I64, &[], &7i64.to_le_bytes()).unwrap();
            file.finish(vec![
                ("t_offset", Entry::Array(offset)),
                ("events", Entry::Group(vec![("x", Entry::Array(x))])),
            ])
            .unwrap()
            .into_inner()
        };
        let (a, b) = (write(), write());
        assert_eq!(a, b);
        assert_eq!(a[40..48], (a.len() as u64).to_le_bytes());
        let mut file = Hdf5File::create(Cursor::new(Vec::new())).unwrap();
        assert!(file.array(Number::F32, &[2, 2], &[0; 12]).is_err());
    }
}
