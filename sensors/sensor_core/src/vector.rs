//! Runs loops that the compiler vectorises with the widest vector instructions of this processor.
//!
//! Programs are built for any processor of their architecture. Work given to [`vectorised`] is
//! compiled twice, and the copy that fits is run. Both copies do the same arithmetic in the same
//! order and fuse nothing, so results do not depend on the processor.

/// Work in plain arithmetic. Mark `run` and everything it calls `#[inline(always)]`: a function
/// that is not inlined is compiled without AVX2.
pub trait VectorWork {
    /// Its result.
    type Out;

    /// Does the work.
    fn run(self) -> Self::Out;
}

/// Does `work` with the widest vectors that this processor has.
#[inline]
pub fn vectorised<W: VectorWork>(work: W) -> W::Out {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[expect(
            unsafe_code,
            reason = "an instruction set is asked for before it is used"
        )]
        // SAFETY: AVX2 was just found on this processor.
        return unsafe { with_avx2(work) };
    }
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<W: VectorWork>(work: W) -> W::Out {
    work.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32]);

    impl VectorWork for Sum<'_> {
        type Out = f32;

        #[inline(always)]
        fn run(self) -> f32 {
            self.0
                .chunks_exact(8)
                .fold([0.0; 8], |sum: [f32; 8], x| {
                    std::array::from_fn(|i| sum[i] + x[i] * 3.0)
                })
                .iter()
                .sum()
        }
    }

    #[test]
    fn results_do_not_depend_on_the_instructions() {
        let mut rng = fastrand::Rng::with_seed(1);
        let numbers: Vec<f32> = (0..4096).map(|_| rng.f32() - 0.5).collect();
        assert_eq!(
            vectorised(Sum(&numbers)).to_bits(),
            Sum(&numbers).run().to_bits()
        );
    }
}
