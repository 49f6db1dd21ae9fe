//! Uniforms and lists of shaders as words.

use sensor_core::vector_lanes::{Lanes, WordLanes};

/// A number that is the same in every lane.
#[inline(always)]
pub fn number<L: Lanes>(word: u32) -> L {
    L::splat(f32::from_bits(word))
}

/// Words at these places and `further` behind them. Beyond the end it is the last word.
///
/// Neighbours mostly read the same place, and one word in all lanes costs a fraction of eight.
#[inline(always)]
pub fn words_at<L: Lanes>(memory: &[u32], places: L::Words, further: u32) -> L::Words {
    let first = places.first();
    if L::bits(places.eq(<L::Words>::splat(first))) == 255 {
        let last = memory.len().saturating_sub(1);
        let place = last.min(first.wrapping_add(further) as usize);
        return <L::Words>::splat(memory.get(place).copied().unwrap_or(0));
    }
    <L::Words>::gather(memory, places.add(<L::Words>::splat(further)))
}

/// Numbers at these places and `further` behind them. Beyond the end it is the last word's.
#[inline(always)]
pub fn numbers_at<L: Lanes>(memory: &[u32], places: L::Words, further: u32) -> L {
    words_at::<L>(memory, places, further).to_numbers()
}
