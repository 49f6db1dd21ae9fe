//! Colour images as the input of a network: in planes or pixels, with the wanted order of colours and
//! type of numbers, in one pass over the image.

use half::{bf16, f16};

/// Images of a camera, one below the other, whose pixels are B G R A.
#[derive(Clone, Copy, Debug)]
pub struct Images<'a> {
    /// Their bytes, with whatever pads the rows.
    pub bytes: &'a [u8],
    /// Pixels per row.
    pub width: usize,
    /// Rows of each image.
    pub height: usize,
    /// Number of images.
    pub n: usize,
    /// Bytes from one row to the next.
    pub row_stride: usize,
}

/// How the tensor holds them.
#[derive(Clone, Copy, Debug)]
pub struct Form<'a> {
    /// Whether each colour has a plane of its own; otherwise each pixel has all its colours.
    pub is_planar: bool,
    /// Byte of a pixel that each colour of the tensor is: `[2, 1, 0]` is R G B. At most 4.
    pub order: &'a [usize],
    /// What a byte is multiplied by in a tensor of floating-point numbers.
    pub scale: f32,
}

/// The tensor's numbers, to be written.
#[derive(Debug)]
pub enum Numbers<'a> {
    /// Bytes as they are.
    U8(&'a mut [u8]),
    /// Scaled, 16 bits.
    F16(&'a mut [f16]),
    /// Scaled, the upper 16 bits of 32.
    Bf16(&'a mut [bf16]),
    /// Scaled, 32 bits.
    F32(&'a mut [f32]),
}

impl<'a> Numbers<'a> {
    /// Memory as numbers of the named type; `None` for another name, and memory that is not aligned.
    pub fn of(dtype: &str, memory: &'a mut [u8]) -> Option<Numbers<'a>> {
        match dtype {
            "uint8" => Some(Numbers::U8(memory)),
            "float16" => {
                let bits: &mut [u16] = bytemuck::try_cast_slice_mut(memory).ok()?;
                Some(Numbers::F16(
                    half::slice::HalfBitsSliceExt::reinterpret_cast_mut(bits),
                ))
            }
            "bfloat16" => {
                let bits: &mut [u16] = bytemuck::try_cast_slice_mut(memory).ok()?;
                Some(Numbers::Bf16(
                    half::slice::HalfBitsSliceExt::reinterpret_cast_mut(bits),
                ))
            }
            "float32" => bytemuck::try_cast_slice_mut(memory).ok().map(Numbers::F32),
            _ => None,
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Numbers::U8(all) => all.len(),
            Numbers::F16(all) => all.len(),
            Numbers::Bf16(all) => all.len(),
            Numbers::F32(all) => all.len(),
        }
    }
}

impl Images<'_> {
    /// Numbers of a tensor of them with so many colours.
    pub fn n_numbers(&self, n_colours: usize) -> usize {
        self.n * self.height * self.width * n_colours
    }

    fn row(&self, image: usize, y: usize) -> &[[u8; 4]] {
        let start = (image * self.height + y) * self.row_stride;
        self.bytes[start..start + 4 * self.width].as_chunks().0
    }

    /// Writes them. `out` has [`Images::n_numbers`] numbers.
    ///
    /// # Panics
    /// If it has another number of them, or the images reach beyond their bytes.
    pub fn write(&self, form: Form<'_>, out: Numbers<'_>) {
        match out {
            Numbers::U8(out) => self.write_by(form, out, |byte| byte),
            Numbers::F32(out) => self.write_by(form, out, |byte| f32::from(byte) * form.scale),
            Numbers::F16(out) => {
                // Rounding to 16 bits takes longer than looking one of 256 up.
                let all: [f16; 256] =
                    std::array::from_fn(|byte| f16::from_f32(byte as f32 * form.scale));
                self.write_by(form, out, |byte| all[usize::from(byte)]);
            }
            Numbers::Bf16(out) => {
                let all: [bf16; 256] =
                    std::array::from_fn(|byte| bf16::from_f32(byte as f32 * form.scale));
                self.write_by(form, out, |byte| all[usize::from(byte)]);
            }
        }
    }

    fn write_by<T>(&self, form: Form<'_>, out: &mut [T], number: impl Fn(u8) -> T + Copy) {
        assert_eq!(
            out.len(),
            self.n_numbers(form.order.len()),
            "its length was checked"
        );
        if self.width == 0 || form.order.is_empty() {
            return;
        }
        for (i, image) in out
            .chunks_exact_mut((self.n_numbers(form.order.len()) / self.n).max(1))
            .enumerate()
        {
            match form.is_planar {
                true => self.write_planes(i, form.order, image, number),
                false => self.write_pixels(i, form.order, image, number),
            }
        }
    }

    fn write_planes<T>(
        &self,
        image: usize,
        order: &[usize],
        out: &mut [T],
        number: impl Fn(u8) -> T + Copy,
    ) {
        for y in 0..self.height {
            let row = self.row(image, y);
            for (colour, byte) in order.iter().enumerate() {
                let start = (colour * self.height + y) * self.width;
                let line = &mut out[start..start + self.width];
                // A constant place in the pixel lets the compiler do several pixels at once.
                match byte {
                    0 => line_of::<0, T>(row, line, number),
                    1 => line_of::<1, T>(row, line, number),
                    2 => line_of::<2, T>(row, line, number),
                    _ => line_of::<3, T>(row, line, number),
                }
            }
        }
    }

    fn write_pixels<T>(
        &self,
        image: usize,
        order: &[usize],
        out: &mut [T],
        number: impl Fn(u8) -> T + Copy,
    ) {
        let n_colours = order.len();
        for (y, line) in out.chunks_exact_mut(self.width * n_colours).enumerate() {
            let row = self.row(image, y);
            for (out, pixel) in line.chunks_exact_mut(n_colours).zip(row) {
                for (out, byte) in out.iter_mut().zip(order) {
                    *out = number(pixel[byte & 3]);
                }
            }
        }
    }
}

fn line_of<const BYTE: usize, T>(row: &[[u8; 4]], line: &mut [T], number: impl Fn(u8) -> T) {
    for (out, pixel) in line.iter_mut().zip(row) {
        *out = number(pixel[BYTE]);
    }
}
