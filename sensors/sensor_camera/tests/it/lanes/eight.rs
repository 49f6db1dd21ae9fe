//! Eight calls of a function at once, as words.

use sensor_core::vector_lanes::{Lanes, WordLanes};
use sensor_shade::packing::word;

pub struct Eight<'a> {
    /// Of each argument's words, one for each lane.
    pub words: &'a [[u32; 8]],
    /// Whether a lane runs: not 0.
    pub running: [u32; 8],
}

impl Eight<'_> {
    #[inline(always)]
    pub fn load<L: Lanes>(&self) -> (Vec<L::Words>, L::Mask) {
        let words = self.words.iter().map(<L::Words>::load).collect();
        let lanes = L::not(<L::Words>::load(&self.running).eq(word::<L>(0)));
        (words, lanes)
    }
}

#[inline(always)]
pub fn store<L: Lanes>(words: &[L::Words]) -> Vec<[u32; 8]> {
    words.iter().map(|x| x.store()).collect()
}
