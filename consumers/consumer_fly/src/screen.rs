//! Where the spectator's image is shown, and where keys and mouse come from.

use crate::input::Input;

/// An image of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'p> {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Bytes from row to row.
    pub stride_bytes: usize,
    /// Blue, green, red and one more byte per pixel.
    pub bgra: &'p [u8],
}

impl Picture<'_> {
    /// A row's pixels; `None` if the bytes do not hold it.
    pub fn row(&self, y: u32) -> Option<&[[u8; 4]]> {
        let from = self.stride_bytes * y as usize;
        let row = self.bgra.get(from..from + 4 * self.width_px as usize)?;
        Some(row.as_chunks().0)
    }
}

/// A screen with keys and a mouse.
pub trait Screen {
    /// What keys and mouse asked for since the last call; does not wait.
    ///
    /// # Errors
    /// If the screen is gone.
    fn poll(&mut self) -> anyhow::Result<Vec<Input>>;

    /// Shows an image.
    ///
    /// # Errors
    /// If the screen is gone.
    fn show(&mut self, picture: &Picture<'_>) -> anyhow::Result<()>;

    /// Shows a line of text beside the image.
    ///
    /// # Errors
    /// If the screen is gone.
    fn say(&mut self, line: &str) -> anyhow::Result<()>;
}
