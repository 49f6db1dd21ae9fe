//! Numbers, texts and records one after the other, read back with a check of every length.

use anyhow::{Context as _, bail};

/// Bytes that are being written.
#[derive(Default)]
pub struct Writer(pub Vec<u8>);

impl Writer {
    pub fn put<T: bytemuck::NoUninit>(&mut self, value: T) {
        self.0.extend_from_slice(bytemuck::bytes_of(&value));
    }

    pub fn put_len(&mut self, len: usize) {
        self.put(len as u64);
    }

    pub fn put_all<T: bytemuck::NoUninit>(&mut self, values: &[T]) {
        self.put_len(values.len());
        self.0.extend_from_slice(bytemuck::cast_slice(values));
    }

    pub fn put_text(&mut self, text: &str) {
        self.put_all(text.as_bytes());
    }
}

/// Bytes that are being read.
pub struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    pub fn take(&mut self, n_bytes: usize) -> anyhow::Result<&'a [u8]> {
        let (taken, rest) = self
            .0
            .split_at_checked(n_bytes)
            .context("it ends too early")?;
        self.0 = rest;
        Ok(taken)
    }

    pub fn get<T: bytemuck::AnyBitPattern>(&mut self) -> anyhow::Result<T> {
        Ok(bytemuck::pod_read_unaligned(self.take(size_of::<T>())?))
    }

    pub fn get_len(&mut self) -> anyhow::Result<usize> {
        Ok(usize::try_from(self.get::<u64>()?)?)
    }

    /// So many records.
    pub fn get_n<T: bytemuck::AnyBitPattern>(&mut self, n: usize) -> anyhow::Result<Vec<T>> {
        let n_bytes = n.checked_mul(size_of::<T>()).context("it is too long")?;
        let bytes = self.take(n_bytes)?;
        let records = bytes.chunks_exact(size_of::<T>().max(1));
        Ok(records.map(bytemuck::pod_read_unaligned).collect())
    }

    pub fn get_all<T: bytemuck::AnyBitPattern>(&mut self) -> anyhow::Result<Vec<T>> {
        let n = self.get_len()?;
        self.get_n(n)
    }

    pub fn get_text(&mut self) -> anyhow::Result<String> {
        let n = self.get_len()?;
        Ok(std::str::from_utf8(self.take(n)?)?.to_owned())
    }

    /// An error if anything is left.
    pub fn end(&self) -> anyhow::Result<()> {
        if !self.0.is_empty() {
            bail!("{} bytes are left over", self.0.len());
        }
        Ok(())
    }
}
