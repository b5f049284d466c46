//! Time since the start in 64 bits, from a count of 32.

/// Extends a counter that wraps; it must be looked at twice in a turn of it.
#[derive(Debug, Default)]
pub struct Time {
    latest: u64,
}

impl Time {
    /// Nothing counted.
    #[must_use]
    pub const fn new() -> Self {
        Self { latest: 0 }
    }

    /// The time at which the counter was `count`: at most half a turn from the latest that was asked
    /// for, before it or behind it.
    pub const fn at(&mut self, count: u32) -> u64 {
        let step = count.wrapping_sub(self.latest as u32) as i32;
        let time = self.latest.wrapping_add_signed(step as i64);
        if step > 0 {
            self.latest = time;
        }
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_counted_and_what_was_a_little_before_is_before() {
        let mut time = Time::new();
        for now in (0..20_000_000_000u64).step_by(1_234_567_891) {
            assert_eq!(time.at(now as u32), now);
            let before = now.saturating_sub(1000);
            assert_eq!(time.at(before as u32), before);
        }
    }
}
