//! Reads a checkpoint's body with a bounded stack: the engine's format lets a shape hold shapes, so
//! bytes nested a million times would otherwise end the process.

use postcard::de_flavors::{Flavor, Slice};
use postcard::{Deserializer, Error, Result};
use serde::Deserialize;

/// Stack that reading may take, bytes. A real world takes a few kilobytes.
const MAX_STACK_BYTES: usize = 1 << 20;

/// The value that the bytes hold.
///
/// # Errors
/// If they cannot be read, or are nested too deeply.
pub(super) fn read<'de, T: Deserialize<'de>>(bytes: &'de [u8]) -> Result<T> {
    T::deserialize(&mut Deserializer::from_flavor(Bounded {
        source: Slice::new(bytes),
        begin: stack_address(),
    }))
}

/// Where the stack is now, about.
#[inline(never)]
fn stack_address() -> usize {
    let here = 0u8;
    std::ptr::from_ref(std::hint::black_box(&here)).addr()
}

/// Bytes that are not handed out once the stack has grown too far.
struct Bounded<'de> {
    source: Slice<'de>,
    begin: usize,
}

impl Bounded<'_> {
    fn check(&self) -> Result<()> {
        match self.begin.abs_diff(stack_address()) > MAX_STACK_BYTES {
            true => Err(Error::DeserializeUnexpectedEnd),
            false => Ok(()),
        }
    }
}

impl<'de> Flavor<'de> for Bounded<'de> {
    type Remainder = &'de [u8];
    type Source = &'de [u8];

    #[inline]
    fn pop(&mut self) -> Result<u8> {
        self.check()?;
        self.source.pop()
    }

    #[inline]
    fn size_hint(&self) -> Option<usize> {
        self.source.size_hint()
    }

    #[inline]
    fn try_take_n(&mut self, n: usize) -> Result<&'de [u8]> {
        self.source.try_take_n(n)
    }

    fn finalize(self) -> Result<&'de [u8]> {
        self.source.finalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Holds itself, as a compound shape of the engine does.
    #[derive(Debug, Deserialize)]
    struct Nested {
        #[expect(dead_code, reason = "only its depth matters")]
        inner: Vec<Nested>,
    }

    #[test]
    fn deep_nesting_is_an_error_and_not_the_end_of_the_process() {
        assert!(read::<Nested>(&[1, 1, 1, 0]).is_ok());
        // Each byte is a list of one: ten million levels.
        assert!(read::<Nested>(&vec![1; 10_000_000]).is_err());
    }
}
