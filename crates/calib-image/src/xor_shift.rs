//! Pseudo-random generator with the same sequence on every machine (Marsaglia 2003).

/// Generator, with its state; the state is not 0.
pub(crate) struct XorShift(pub(crate) u64);

impl XorShift {
    /// Returns a pseudo-random number below `count`.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    /// Returns an approximately normal number with standard deviation 1: the sum of twelve uniform numbers.
    pub(crate) fn normal(&mut self) -> f64 {
        let uniform = |_| (self.next() >> 11) as f64 / (1_u64 << 53) as f64;
        (0..12).map(uniform).sum::<f64>() - 6.0
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}
