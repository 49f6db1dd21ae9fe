//! Images of numbers, tight.

/// An image, tight.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels<T> {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row after row.
    pub values: Vec<T>,
}

impl<T> Pixels<T> {
    /// The values if the image has this size; a result of another size answers no pixel.
    pub fn of_size(&self, width: u32, height: u32) -> Option<&[T]> {
        (self.width == width && self.height == height).then_some(&self.values[..])
    }
}
