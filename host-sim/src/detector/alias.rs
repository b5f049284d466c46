//! Tables from which a Poisson deviate of a fixed mean is drawn by one look-up (Walker's alias method).

/// A table of `N` columns of equal probability (a power of two), each shared by two counts: its own below a
/// threshold, another above it.
#[derive(Debug)]
pub(super) struct Alias<const N: usize> {
    /// Count of column 0.
    first: u32,
    columns: [Column; N],
}

/// The other count's column in the lowest bits, above them the share of the column's own: four bytes, so
/// that what is used often stays in the nearest cache.
#[derive(Debug, Clone, Copy)]
struct Column(u32);

impl<const N: usize> Alias<N> {
    /// Bits that choose a column; the others, 32 - `INDEX_BITS`, choose between its two counts.
    const INDEX_BITS: u32 = N.trailing_zeros();

    /// Vose's construction for the Poisson distribution of `mean`, cut at the `N` counts about it.
    /// Probabilities are resolved to 2^-32.
    pub(super) fn new(mean: f64) -> Self {
        let unit = f64::from(1_u32 << (32 - Self::INDEX_BITS));
        let first = (mean - N as f64 / 2.0).max(0.0) as u32;
        let mut heights = heights::<N>(mean, first);
        // What no other column tops up keeps its own count.
        let mut columns = std::array::from_fn(|own| Column(own as u32));
        let (mut low, mut high): (Vec<_>, Vec<_>) = (0..N).partition(|&i| heights[i] < 1.0);
        while let (Some(from), Some(&to)) = (high.last().copied(), low.last()) {
            low.pop();
            let share = (heights[to] * unit).round().min(unit - 1.0);
            columns[to] = Column((share as u32) << Self::INDEX_BITS | from as u32);
            heights[from] -= 1.0 - heights[to];
            if heights[from] < 1.0 {
                high.pop();
                low.push(from);
            }
        }
        Self { first, columns }
    }

    /// Count of column 0; 0 for means below `N` / 2.
    pub(super) fn first(&self) -> u32 {
        self.first
    }

    /// The count above [`Alias::first`] for 32 random bits: the top ones choose the column, the rest the side.
    #[inline(always)]
    pub(super) fn draw(&self, bits: u32) -> u32 {
        let index = (bits >> (32 - Self::INDEX_BITS)) as usize % N;
        let column = self.columns[index].0;
        let other = column % N as u32;
        // A branch here would go either way at random.
        let own = bits << Self::INDEX_BITS < column - other;
        std::hint::select_unpredictable(own, index as u32, other)
    }
}

/// `N` times the probabilities of the counts from `first` on, from the most likely one outwards, where none
/// is too small for a double.
fn heights<const N: usize>(mean: f64, first: u32) -> [f64; N] {
    let mut heights = [0.0; N];
    let mode = mean as usize - first as usize;
    let count = |k: usize| f64::from(first) + k as f64;
    heights[mode] = 1.0;
    for k in mode + 1..N {
        heights[k] = heights[k - 1] * mean / count(k);
    }
    for k in (0..mode).rev() {
        heights[k] = heights[k + 1] * count(k + 1) / mean;
    }
    let scale = N as f64 / heights.iter().sum::<f64>();
    heights.map(|height| height * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_the_distribution() {
        for mean in [0.0, 1.0 / 16.0, 3.9375] {
            probabilities_match(&Alias::<32>::new(mean), mean);
        }
        for mean in [0.0, 4.0, 124.0] {
            probabilities_match(&Alias::<256>::new(mean), mean);
        }
        for mean in [128.0, 1024.0, 3968.0] {
            probabilities_match(&Alias::<1024>::new(mean), mean);
        }
    }

    /// Adds up the columns' shares and compares them with exp(-m) m^k / k!; at each edge of a column's two
    /// shares a draw gives the count of that side.
    fn probabilities_match<const N: usize>(table: &Alias<N>, mean: f64) {
        let unit = f64::from(u32::MAX / N as u32 + 1);
        let mut found = [0.0; N];
        for (own, column) in table.columns.iter().enumerate() {
            let (share, other) = (column.0 / N as u32, column.0 % N as u32);
            found[own] += f64::from(share) / unit / N as f64;
            found[other as usize] += (1.0 - f64::from(share) / unit) / N as f64;
            let bits = (own as u32) << (32 - N.trailing_zeros()) | share;
            assert_eq!(table.draw(bits), other);
            if share > 0 {
                assert_eq!(table.draw(bits - 1), own as u32);
            }
        }
        let ln_mean = if mean > 0.0 { mean.ln() } else { f64::MIN };
        for (k, found) in found.iter().enumerate() {
            let count = f64::from(table.first) + k as f64;
            let likely = if count > 0.0 { count * ln_mean } else { 0.0 };
            let expected = (likely - mean - libm::lgamma(count + 1.0)).exp();
            assert!((found - expected).abs() < 1e-9, "mean {mean}: P({count}) {found} {expected}");
        }
    }
}
