//! CDR as ROS 2 writes it: little-endian, every value at a multiple of its size, counted from behind
//! the four bytes that say so.

/// First bytes of every message: plain CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Writes one message.
#[derive(Debug)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// A message of about `capacity` bytes.
    pub fn new(capacity: usize) -> Writer {
        let mut bytes = Vec::with_capacity(capacity + 64);
        bytes.extend(ENCAPSULATION);
        Writer { bytes }
    }

    /// The whole message.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    fn align(&mut self, to: usize) {
        let at = self.bytes.len() - ENCAPSULATION.len();
        let padding = at.next_multiple_of(to) - at;
        self.bytes.extend(&[0; 8][..padding]);
    }

    /// An octet, or a small number.
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// 0 or 1.
    pub fn bool(&mut self, value: bool) {
        self.u8(value.into());
    }

    /// Unsigned, 16 bits.
    pub fn u16(&mut self, value: u16) {
        self.align(2);
        self.bytes.extend(value.to_le_bytes());
    }

    /// Unsigned, 32 bits.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    /// Signed, 32 bits.
    pub fn i32(&mut self, value: i32) {
        self.u32(value as u32);
    }

    /// Single precision.
    pub fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    /// Double precision.
    pub fn f64(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
    }

    /// An array of a fixed number of doubles.
    pub fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.f64(*value);
        }
    }

    /// Text: its length with the zero at its end, and that zero.
    pub fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    /// A sequence of octets.
    pub fn octets(&mut self, octets: &[u8]) {
        self.u32(octets.len() as u32);
        self.bytes.extend(octets);
    }

    /// A sequence of octets that `fill` appends, `n_octets` of them.
    pub fn octets_by(&mut self, n_octets: usize, fill: impl FnOnce(&mut Vec<u8>)) {
        self.u32(n_octets as u32);
        let end = self.bytes.len() + n_octets;
        self.bytes.reserve(n_octets);
        fill(&mut self.bytes);
        self.bytes.resize(end, 0);
    }
}

/// Reads one message; any bytes are safe to pass.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Begins to read; `None` unless it is plain CDR, little-endian.
    pub fn new(message: &'a [u8]) -> Option<Reader<'a>> {
        match message {
            [0, 1, _, _, bytes @ ..] => Some(Reader { bytes, at: 0 }),
            _ => None,
        }
    }

    fn take(&mut self, n: usize, align: usize) -> Option<&'a [u8]> {
        let at = self.at.next_multiple_of(align);
        let end = at.checked_add(n)?;
        let taken = self.bytes.get(at..end)?;
        self.at = end;
        Some(taken)
    }

    /// 0 or 1; anything else counts as 1.
    pub fn bool(&mut self) -> Option<bool> {
        Some(self.take(1, 1)?[0] != 0)
    }

    /// Unsigned, 32 bits.
    pub fn u32(&mut self) -> Option<u32> {
        let bytes = self.take(4, 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }

    /// Signed, 32 bits.
    pub fn i32(&mut self) -> Option<i32> {
        self.u32().map(|bits| bits as i32)
    }

    /// Single precision.
    pub fn f32(&mut self) -> Option<f32> {
        self.u32().map(f32::from_bits)
    }

    /// Text, passed over.
    pub fn skip_string(&mut self) -> Option<()> {
        let n = self.u32()? as usize;
        self.take(n, 1).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_at_multiples_of_their_size() {
        let mut writer = Writer::new(0);
        writer.u8(7);
        writer.u16(0x0102);
        writer.string("ab");
        writer.f64(1.0);
        writer.octets(&[9, 9]);
        let expected = [
            &[0, 1, 0, 0][..],
            &[7, 0, 2, 1],
            &[3, 0, 0, 0, b'a', b'b', 0],
            &[0; 5],
            &[0, 0, 0, 0, 0, 0, 0xf0, 0x3f],
            &[2, 0, 0, 0, 9, 9],
        ]
        .concat();
        assert_eq!(writer.finish(), expected);
    }

    #[test]
    fn short_messages_are_no_messages() {
        assert!(Reader::new(&[0, 0, 0, 0]).is_none() && Reader::new(&[]).is_none());
        let mut reader = Reader::new(&[0, 1, 0, 0, 1]).unwrap();
        assert_eq!((reader.bool(), reader.u32()), (Some(true), None));
        let mut reader = Reader::new(&[0, 1, 0, 0, 255, 255, 255, 255]).unwrap();
        assert!(reader.skip_string().is_none());
    }
}
