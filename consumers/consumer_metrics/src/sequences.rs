//! What is kept of drives, one after another: identities and worlds hold within each.

/// Those that are over, and the one that is going on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sequences<T> {
    ended: Vec<T>,
    current: Option<T>,
}

impl<T: Clone + Default> Sequences<T> {
    /// The one that is going on; begins one if there is none.
    pub(crate) fn current(&mut self) -> &mut T {
        self.current.get_or_insert_default()
    }

    /// Ends the one that is going on.
    pub(crate) fn end(&mut self) {
        self.ended.extend(self.current.take());
    }

    /// Adds another's behind this one's; all are over then.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.end();
        self.ended.extend(other.iter().cloned());
    }

    /// All, in order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        self.ended.iter().chain(&self.current)
    }
}
