//! CDR as ROS 2 uses it: little-endian, each number aligned to its own size, counted from the end of
//! the four bytes that say so.

/// A message under construction; [`Cdr::start`] begins the next one in the same memory.
#[derive(Clone, Debug, Default)]
pub struct Cdr {
    bytes: Vec<u8>,
}

/// CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

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

impl Cdr {
    /// Empty memory.
    pub fn new() -> Cdr {
        Cdr::default()
    }

    /// Begins a message.
    pub fn start(&mut self) -> &mut Self {
        self.bytes.clear();
        self.bytes.extend(ENCAPSULATION);
        self
    }

    /// The message.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    numbers! {
        u8: u8;
        i8: i8;
        u16: u16;
        u32: u32;
        i32: i32;
        u64: u64;
        f64: f64;
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
    pub fn sequence(&mut self, bytes: &[u8]) -> anyhow::Result<&mut Self> {
        let n_bytes = u32::try_from(bytes.len())
            .map_err(|_| anyhow::anyhow!("a ROS message holds less than 4 GiB of data"))?;
        self.u32(n_bytes);
        self.bytes.extend(bytes);
        Ok(self)
    }

    fn align(&mut self, n_bytes: usize) {
        let at = self.bytes.len() - ENCAPSULATION.len();
        let pad = at.next_multiple_of(n_bytes) - at;
        self.bytes.resize(self.bytes.len() + pad, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_from_the_end_of_the_encapsulation() {
        let mut cdr = Cdr::new();
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
        assert_eq!(cdr.start().i32(-1).bytes().len(), 8, "memory is used again");
    }

    #[test]
    fn a_sequence_has_its_length_and_a_text_ends_at_a_zero() {
        let mut cdr = Cdr::new();
        cdr.start().sequence(&[9, 8]).unwrap();
        assert_eq!(cdr.bytes()[4..], [2, 0, 0, 0, 9, 8]);
        cdr.start().text("a\0b");
        assert_eq!(cdr.bytes()[4..], [2, 0, 0, 0, b'a', 0]);
    }
}
