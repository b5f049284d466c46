//! Clocks: dividers of the PLLs, and the frequencies that come out.
//!
//! An oscillator of 8 MHz on OSC_IN, since a frame is timed by it: the gate's delay has its error.

/// What feeds both PLLs, Hz.
pub const OSCILLATOR_HZ: u32 = 8_000_000;

/// Divider before, multiplier, and the dividers behind a PLL.
#[derive(Clone, Copy, Debug)]
pub struct Pll {
    /// M, 1 to 63.
    pub before: u32,
    /// N, 4 to 512.
    pub multiplier: u32,
    /// P, of the first PLL even.
    pub after: u32,
}

impl Pll {
    /// Of its oscillator, Hz.
    #[must_use]
    pub const fn vco_hz(self) -> u32 {
        OSCILLATOR_HZ / self.before * self.multiplier
    }

    /// Of output P, Hz.
    #[must_use]
    pub const fn output_hz(self) -> u32 {
        self.vco_hz() / self.after
    }
}

/// The core's: 480 MHz, the most there is; it needs voltage scale 0 and silicon revision V.
pub const CORE: Pll = Pll { before: 1, multiplier: 120, after: 2 };

/// The DAC buses': twice their clock, which is the least that they divide by.
pub const BUSES: Pll = Pll { before: 1, multiplier: 50, after: 4 };

/// Processor, Hz.
pub const CORE_HZ: u32 = CORE.output_hz();
/// AXI, AHB and the memories on them, Hz.
pub const AHB_HZ: u32 = CORE_HZ / 2;
/// Peripherals on APB, the link's UART among them, Hz.
pub const APB_HZ: u32 = AHB_HZ / 2;
/// Every timer, Hz: twice its APB. A tick is 4.17 ns.
pub const TIMER_HZ: u32 = 2 * APB_HZ;
/// Clock of the DAC buses, Hz: the most that an AD5370 takes.
pub const DAC_HZ: u32 = BUSES.output_hz() / 2;
/// The link's symbols per second.
pub const LINK_BAUD: u32 = 921_600;

#[cfg(test)]
mod tests {
    use super::*;

    /// Limits of RM0433, chapter 8, and of the data sheet for voltage scale 0.
    #[test]
    fn clocks_are_within_what_the_part_does() {
        for pll in [CORE, BUSES] {
            let input = OSCILLATOR_HZ / pll.before;
            assert!((2_000_000..=16_000_000).contains(&input), "wide VCO range");
            assert!((192_000_000..=960_000_000).contains(&pll.vco_hz()));
            assert!((1..=63).contains(&pll.before) && (4..=512).contains(&pll.multiplier));
        }
        assert_eq!(CORE.after % 2, 0, "P of PLL1 is even");
        assert_eq!(CORE_HZ, 480_000_000);
        assert_eq!([AHB_HZ, APB_HZ, TIMER_HZ], [240_000_000, 120_000_000, 240_000_000]);
        // At most 200 MHz for SPI1 to 3, and 50 MHz for an AD5370.
        assert_eq!([BUSES.output_hz(), DAC_HZ], [100_000_000, 50_000_000]);
    }

    /// A UART takes a few percent; both ends have an error.
    #[test]
    fn the_link_is_within_half_a_percent_of_its_rate() {
        let divider = (APB_HZ + LINK_BAUD / 2) / LINK_BAUD;
        let baud = f64::from(APB_HZ) / f64::from(divider);
        assert!((baud / f64::from(LINK_BAUD) - 1.0).abs() < 0.005, "{baud}");
    }
}
