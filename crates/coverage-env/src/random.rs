//! Uniform draws from raw random bits.
//!
//! A seed must mean the same episodes for as long as the project lives. Generators such as ChaCha
//! are specified, sampling code of a library is not and changes between its versions; so the few
//! distributions that the project needs are here.

use rand::Rng;

/// A uniform integer in `0..n`, without bias; 0 if `n` is 0.
///
/// Lemire, "Fast Random Integer Generation in an Interval" (2019): the upper half of a 32 × 32 bit
/// product, rejecting the few products that would favour some results. Takes one 32-bit word from
/// `rng`, rarely more.
pub fn below(rng: &mut (impl Rng + ?Sized), n: u32) -> u32 {
    let mut product = u64::from(rng.next_u32()) * u64::from(n);
    // `product as u32` is the lower half. Only below `n` can it be one of those to reject, which
    // spares nearly every call the division.
    if (product as u32) < n {
        let rejected = n.wrapping_neg() % n;
        while (product as u32) < rejected {
            product = u64::from(rng.next_u32()) * u64::from(n);
        }
    }
    (product >> 32) as u32
}

/// A uniform multiple of 2⁻²⁴ in `[0, 1)`, from one 32-bit word.
pub fn unit_f32(rng: &mut (impl Rng + ?Sized)) -> f32 {
    (rng.next_u32() >> 8) as f32 * (1.0 / (1u32 << 24) as f32)
}

/// A uniform multiple of 2⁻⁵³ in `[0, 1)`, from one 64-bit word.
pub fn unit_f64(rng: &mut (impl Rng + ?Sized)) -> f64 {
    (rng.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Puts `items` into a uniformly random order (Fisher–Yates, from the back).
///
/// # Panics
/// If there are 2³² items or more.
pub fn shuffle<T>(rng: &mut (impl Rng + ?Sized), items: &mut [T]) {
    assert!(u32::try_from(items.len()).is_ok(), "too many items to shuffle");
    for last in (1..items.len()).rev() {
        items.swap(last, below(rng, last as u32 + 1) as usize);
    }
}

#[cfg(test)]
mod tests {
    use chacha20::ChaCha8Rng;
    use chacha20::rand_core::SeedableRng;

    use super::*;

    #[test]
    fn below_is_uniform_and_in_range() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut counts = [0u32; 6];
        for _ in 0..60_000 {
            counts[below(&mut rng, 6) as usize] += 1;
        }
        // Six standard deviations of a binomial(60 000, 1/6) are 548.
        assert!(counts.iter().all(|&count| count.abs_diff(10_000) < 548), "{counts:?}");
        assert_eq!(below(&mut rng, 1), 0);
        assert_eq!(below(&mut rng, 0), 0);
    }

    /// With n = 3·2³⁰, plain multiplication favours every third result by half.
    #[test]
    fn below_rejects_what_would_be_biased() {
        let n = 3 << 30;
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let thirds = (0..30_000).filter(|_| below(&mut rng, n) % 3 == 0).count();
        assert!(thirds.abs_diff(10_000) < 490, "{thirds}");
    }

    #[test]
    fn units_stay_below_one() {
        struct Ones;
        impl rand::TryRng for Ones {
            type Error = std::convert::Infallible;
            fn try_next_u32(&mut self) -> Result<u32, Self::Error> {
                Ok(u32::MAX)
            }
            fn try_next_u64(&mut self) -> Result<u64, Self::Error> {
                Ok(u64::MAX)
            }
            fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Self::Error> {
                bytes.fill(0xFF);
                Ok(())
            }
        }
        assert_eq!(unit_f32(&mut Ones), 1.0 - f32::EPSILON / 2.0);
        assert_eq!(unit_f64(&mut Ones), 1.0 - f64::EPSILON / 2.0);
    }

    /// A changed stream would silently change every experiment.
    #[test]
    fn streams_are_pinned() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let drawn: Vec<u32> = (0..8).map(|_| below(&mut rng, 100)).collect();
        let mut order: Vec<u8> = (0..8).collect();
        shuffle(&mut rng, &mut order);
        assert_eq!(drawn, [65, 70, 72, 46, 50, 69, 56, 6]);
        assert_eq!(order, [0, 5, 4, 7, 2, 3, 6, 1]);
    }
}
