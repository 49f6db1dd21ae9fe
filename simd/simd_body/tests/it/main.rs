//! Tests of `simd_body`: one program for all of them, so that it is linked once.

mod doors;
mod outfits;
mod vehicles;
