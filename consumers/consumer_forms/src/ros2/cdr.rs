//! CDR as ROS 2 uses it: little-endian, each number aligned to its own size, counted from the end of
//! the four bytes that say so.

/// First bytes of every message: plain CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A sequence has more elements than CDR can count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a ROS message holds less than 4 GiB of data")]
pub struct TooLong;

/// A message under construction; [`Writer::start`] begins the next one in the same memory.
#[derive(Clone, Debug, Default)]
pub struct Writer {
    bytes: Vec<u8>,
}

macro_rules! numbers {
    ($($name:ident: $number:ty;)*) => {
        $(#[doc = concat!("Writes a `", stringify!($number), "`.")]
        pub fn $name(&mut self, value: $number) -> &mut Self {
            self.align(size_of::<$number>());
            self.bytes.extend(value.to_le_bytes());
            self
        })*
    };
}

impl Writer {
    /// Begins a message in the memory of the one before.
    pub fn start(&mut self) -> &mut Self {
        self.bytes.clear();
        self.bytes.extend(ENCAPSULATION);
        self
    }

    /// The message.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The message with its memory.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    numbers! {
        u8: u8;
        i8: i8;
        u16: u16;
        u32: u32;
        i32: i32;
        u64: u64;
        f32: f32;
        f64: f64;
    }

    /// Writes 0 or 1.
    pub fn bool(&mut self, value: bool) -> &mut Self {
        self.u8(value.into())
    }

    /// Writes several `f64` without a length: an array of fixed size.
    pub fn f64s(&mut self, values: &[f64]) -> &mut Self {
        for value in values {
            self.f64(*value);
        }
        self
    }

    /// Writes a text: its length with the closing zero, and its bytes. A zero within ends it, since
    /// ROS texts are C strings.
    pub fn text(&mut self, text: &str) -> &mut Self {
        let text = text.split('\0').next().unwrap_or_default();
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
        self
    }

    /// Writes a sequence of bytes.
    ///
    /// # Errors
    /// If there are more than 2³² − 1.
    pub fn sequence(&mut self, bytes: &[u8]) -> Result<&mut Self, TooLong> {
        self.sequence_by(bytes.len(), |out| out.extend(bytes))
    }

    /// Writes a sequence of `n_bytes` bytes that `fill` appends. If it appends fewer, zeros follow,
    /// and what is beyond is left out.
    ///
    /// # Errors
    /// If there are more than 2³² − 1.
    pub fn sequence_by(
        &mut self,
        n_bytes: usize,
        fill: impl FnOnce(&mut Vec<u8>),
    ) -> Result<&mut Self, TooLong> {
        self.u32(u32::try_from(n_bytes).map_err(|_| TooLong)?);
        let end = self.bytes.len() + n_bytes;
        self.bytes.reserve(n_bytes);
        fill(&mut self.bytes);
        self.bytes.resize(end, 0);
        Ok(self)
    }

    fn align(&mut self, n_bytes: usize) {
        let at = self.bytes.len() - ENCAPSULATION.len();
        let pad = at.next_multiple_of(n_bytes) - at;
        self.bytes.resize(self.bytes.len() + pad, 0);
    }
}

/// The reason why bytes are no message that can be read. Each reads well behind "a message is left
/// out:".
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// Another encapsulation.
    #[error("its CDR is not little-endian")]
    Encapsulation,
    /// A value lies beyond the end.
    #[error("it ends early")]
    Short,
    /// An image whose pixels have their bytes the other way round.
    #[error("its pixels are big-endian")]
    BigEndianPixels,
    /// A cloud whose points have their bytes the other way round.
    #[error("its points are big-endian")]
    BigEndianPoints,
    /// More fields than any cloud has.
    #[error("its points have {0} fields")]
    ManyFields(u32),
}

/// Reads values one after another; any bytes are safe to pass.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Begins to read.
    ///
    /// # Errors
    /// [`ReadError::Encapsulation`] unless it is plain CDR, little-endian.
    pub fn new(message: &'a [u8]) -> Result<Reader<'a>, ReadError> {
        match message {
            [0, 1, _, _, bytes @ ..] => Ok(Reader { bytes, at: 0 }),
            _ => Err(ReadError::Encapsulation),
        }
    }

    fn take(&mut self, n: usize, align: usize) -> Result<&'a [u8], ReadError> {
        let at = self.at.next_multiple_of(align);
        let end = at.checked_add(n).ok_or(ReadError::Short)?;
        let taken = self.bytes.get(at..end).ok_or(ReadError::Short)?;
        self.at = end;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        let bytes = self.take(N, N)?;
        bytes.try_into().map_err(|_| ReadError::Short)
    }

    /// Reads an octet.
    ///
    /// # Errors
    /// [`ReadError::Short`], as from all below.
    pub fn u8(&mut self) -> Result<u8, ReadError> {
        self.number().map(u8::from_le_bytes)
    }

    /// Reads 0 or 1; anything else counts as 1.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn bool(&mut self) -> Result<bool, ReadError> {
        Ok(self.u8()? != 0)
    }

    /// Reads a `u16`.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn u16(&mut self) -> Result<u16, ReadError> {
        self.number().map(u16::from_le_bytes)
    }

    /// Reads a `u32`.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn u32(&mut self) -> Result<u32, ReadError> {
        self.number().map(u32::from_le_bytes)
    }

    /// Reads an `i32`.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn i32(&mut self) -> Result<i32, ReadError> {
        self.number().map(i32::from_le_bytes)
    }

    /// Reads an `f32`.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn f32(&mut self) -> Result<f32, ReadError> {
        self.number().map(f32::from_le_bytes)
    }

    /// Reads an `f64`.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn f64(&mut self) -> Result<f64, ReadError> {
        self.number().map(f64::from_le_bytes)
    }

    /// Reads an array of fixed size.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], ReadError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Reads a sequence of bytes.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn sequence(&mut self) -> Result<&'a [u8], ReadError> {
        let n = self.u32()? as usize;
        self.take(n, 1)
    }

    /// Reads a text with its closing zero. What is not UTF-8 is replaced.
    ///
    /// # Errors
    /// [`ReadError::Short`].
    pub fn text(&mut self) -> Result<String, ReadError> {
        let bytes = self.sequence()?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Ok(String::from_utf8_lossy(text).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_from_the_end_of_the_encapsulation() {
        let mut cdr = Writer::default();
        cdr.start().u8(1).u32(2).text("ab").u8(3).f64(1.0).u16(7);
        let wanted = [
            &[0, 1, 0, 0][..],
            &[1, 0, 0, 0, 2, 0, 0, 0],
            &[3, 0, 0, 0, b'a', b'b', 0, 3],
            &1f64.to_le_bytes(),
            &[7, 0],
        ]
        .concat();
        assert_eq!(cdr.bytes(), wanted);
        let mut reader = Reader::new(cdr.bytes()).unwrap();
        assert_eq!((reader.u8(), reader.u32()), (Ok(1), Ok(2)));
        assert_eq!((reader.text(), reader.u8()), (Ok("ab".to_owned()), Ok(3)));
        assert_eq!((reader.f64(), reader.u16()), (Ok(1.0), Ok(7)));
        assert_eq!(reader.bool(), Err(ReadError::Short));
        assert_eq!(cdr.start().i32(-1).bytes().len(), 8, "memory is used again");
    }

    #[test]
    fn a_sequence_has_its_length_and_a_text_ends_at_a_zero() {
        let mut cdr = Writer::default();
        cdr.start().sequence(&[9, 8]).unwrap();
        assert_eq!(cdr.bytes()[4..], [2, 0, 0, 0, 9, 8]);
        cdr.start().sequence_by(3, |out| out.push(5)).unwrap();
        assert_eq!(cdr.bytes()[4..], [3, 0, 0, 0, 5, 0, 0]);
        cdr.start().text("a\0b");
        assert_eq!(cdr.bytes()[4..], [2, 0, 0, 0, b'a', 0]);
    }

    #[test]
    fn short_messages_are_no_messages() {
        for bytes in [&[0, 0, 0, 0][..], &[]] {
            assert_eq!(Reader::new(bytes).unwrap_err(), ReadError::Encapsulation);
        }
        let mut reader = Reader::new(&[0, 1, 0, 0, 1]).unwrap();
        assert_eq!(
            (reader.bool(), reader.u32()),
            (Ok(true), Err(ReadError::Short))
        );
        let mut reader = Reader::new(&[0, 1, 0, 0, 255, 255, 255, 255]).unwrap();
        assert_eq!(reader.text(), Err(ReadError::Short));
    }
}
