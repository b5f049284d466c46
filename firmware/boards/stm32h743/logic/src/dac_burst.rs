//! A frame's words as one DMA transfer for each of three SPI buses, and the timer beside them.
//!
//! The bus ends every word with a pulse on its select line, by itself; a decoder hands that line to one
//! of two chips, as the steering line says. So a bus sends all words of its first chip, a few that
//! change nothing, and all words of its second; in the middle of those that change nothing a timer
//! turns the steering line over, and behind the last word it pulls LDAC. Nothing of it needs the
//! processor, and the outputs of all chips change at a fixed time after the start.
//!
//! ```text
//! bus       | words of chip 2b        | no operation | words of chip 2b + 1    |
//! steering  ________________________________/-----------------------------------\___
//! LDAC      ----------------------------------------------------------------\___/---
//! ```

use crate::ad5370;
use crate::clocks::{DAC_HZ, TIMER_HZ};
use crate::dac_bus::{CHIPS, SEGMENTS, place};
use splash_firmware::segments::ACTUATORS;

/// Buses: SPI1, SPI2, SPI3, those with words of more than 16 bits.
pub const BUSES: usize = 3;
/// Words that change nothing between the two chips of a bus.
pub const GUARD: usize = 8;
/// Most words of a chip.
const PER_CHIP: usize = SEGMENTS / CHIPS * ACTUATORS;
/// Most words of a bus.
pub const WORDS: usize = 2 * PER_CHIP + GUARD;

/// Clocks from the select line's edge to the first bit, beside the one that is always there.
pub const LEAD_CLOCKS: u32 = 1;
/// Clocks between words.
pub const IDLE_CLOCKS: u32 = 8;
/// Clocks from one word to the next.
const WORD_CLOCKS: u32 = LEAD_CLOCKS + ad5370::WORD_BITS + IDLE_CLOCKS;
/// The same if every place where the manual leaves a clock open takes it.
const LONGEST_WORD_CLOCKS: u32 = WORD_CLOCKS + 2;
/// From the start to the first word and for waits of the DMA that its FIFO does not hide, ns.
const SLACK_NS: u32 = 2_000;
/// For which LDAC is low, ns.
const LDAC_NS: u32 = 500;

/// Words of all buses, where the DMA reads them.
pub type Words = [[u32; WORDS]; BUSES];

/// What a transfer takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Words of each bus.
    pub words: u16,
    /// When the steering line goes high, ticks of the timer from the start.
    pub steer: u16,
    /// When LDAC goes low, ticks.
    pub ldac: u16,
    /// The last tick at which they are so.
    pub end: u16,
}

/// There is no channel for so many segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TooMany {
    /// How many there were.
    pub found: usize,
}

/// Ticks of the timer in so many clocks of a bus, as a fraction in MHz: 240 / 50.
const fn clocks_to_ticks(clocks: u32) -> u32 {
    const MHZ: u32 = 1_000_000;
    (clocks * (TIMER_HZ / MHZ)).div_ceil(DAC_HZ / MHZ)
}

const fn ns_to_ticks(ns: u32) -> u32 {
    (ns as u64 * TIMER_HZ as u64).div_ceil(1_000_000_000) as u32
}

/// [`SLACK_NS`], ticks.
const SLACK: u32 = ns_to_ticks(SLACK_NS);
/// From the last word to LDAC, ticks.
const BUSY: u32 = ns_to_ticks(ad5370::BUSY_NS);
/// For which LDAC is low, ticks.
const PULSE: u32 = ns_to_ticks(LDAC_NS);

impl Schedule {
    /// That of a frame of so many segments.
    ///
    /// # Errors
    /// [`TooMany`] if they have no channels.
    pub const fn new(segments: usize) -> Result<Self, TooMany> {
        if segments > SEGMENTS {
            return Err(TooMany { found: segments });
        }
        let per_chip = segments.div_ceil(CHIPS) * ACTUATORS;
        let words = 2 * per_chip + GUARD;
        // In the middle between the latest end of the first chip's words and the earliest start of the
        // second's.
        let first = clocks_to_ticks(per_chip as u32 * LONGEST_WORD_CLOCKS) + SLACK;
        let second = clocks_to_ticks((per_chip + GUARD) as u32 * WORD_CLOCKS);
        let steer = u32::midpoint(first, second);
        let sent = clocks_to_ticks(words as u32 * LONGEST_WORD_CLOCKS);
        let ldac = sent + SLACK + BUSY;
        let end = ldac + PULSE;
        // With all channels in use 16 000 ticks, 66 us.
        Ok(Self { words: words as u16, steer: steer as u16, ldac: ldac as u16, end: end as u16 })
    }

    /// From the start to the change of the outputs, ns: what the buses add to the latency.
    #[must_use]
    pub const fn latency_ns(self) -> u32 {
        (self.ldac as u64 * 1_000_000_000 / TIMER_HZ as u64) as u32
    }
}

/// Writes the words of a frame's codes, in the order of the subapertures.
///
/// # Errors
/// [`TooMany`] if they have no channels; nothing is written.
pub fn fill(codes: &[[u16; ACTUATORS]], words: &mut Words) -> Result<Schedule, TooMany> {
    let schedule = Schedule::new(codes.len())?;
    let per_chip = (usize::from(schedule.words) - GUARD) / 2;
    for bus in words.iter_mut() {
        // Places that the last, incomplete round of segments leaves.
        bus.fill(ad5370::NO_OPERATION);
    }
    for (segment, codes) in codes.iter().enumerate() {
        let (chip, first) = place(segment);
        let start = if chip % 2 == 0 { first } else { per_chip + GUARD + first };
        let words = words.get_mut(chip / 2).and_then(|bus| bus.get_mut(start..start + ACTUATORS));
        for (k, (word, &code)) in words.into_iter().flatten().zip(codes).enumerate() {
            *word = ad5370::write(first + k, code);
        }
    }
    Ok(schedule)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOCK_NS: f64 = 1e9 / DAC_HZ as f64;
    const TICK_NS: f64 = 1e9 / TIMER_HZ as f64;

    fn codes(segments: usize) -> Vec<[u16; ACTUATORS]> {
        (0..segments as u16).map(|s| [3 * s + 1, 3 * s + 2, 3 * s + 3]).collect()
    }

    /// Six chips, two on a bus behind a decoder, given the words one by one at their times.
    fn received(segments: usize, word_clocks: f64, start_ns: f64) -> [[u16; 40]; CHIPS] {
        let mut words = [[0; WORDS]; BUSES];
        let schedule = fill(&codes(segments), &mut words).expect("channels");
        let word_ns = word_clocks * CLOCK_NS;
        let steer_ns = f64::from(schedule.steer) * TICK_NS;
        let mut chips = [[0; 40]; CHIPS];
        for (bus, words) in words.iter().enumerate() {
            for (w, &word) in words[..schedule.words.into()].iter().enumerate() {
                let begins = start_ns + w as f64 * word_ns;
                let ends = begins + word_ns;
                if word == ad5370::NO_OPERATION {
                    continue;
                }
                assert!(ends < steer_ns || begins > steer_ns, "steered within word {w}");
                let chip = 2 * bus + usize::from(begins > steer_ns);
                let channel = (word >> 16 & 0x3F) as usize - 8;
                chips[chip][channel] = word as u16;
            }
            let last_ns = start_ns + f64::from(schedule.words) * word_ns;
            let ldac_ns = f64::from(schedule.ldac) * TICK_NS;
            assert!(ldac_ns >= last_ns + f64::from(ad5370::BUSY_NS), "LDAC before the last");
        }
        chips
    }

    #[test]
    fn every_chip_gets_its_codes_whatever_the_manual_leaves_open() {
        for segments in [1, 5, 6, 7, 32, 52, 64, SEGMENTS] {
            for word_clocks in WORD_CLOCKS..=LONGEST_WORD_CLOCKS {
                // The buses start with the timer, or are late by all that there is for it.
                for start_ns in [0.0, SLACK_NS.into()] {
                    let chips = received(segments, word_clocks.into(), start_ns);
                    let mut expected = [[0; 40]; CHIPS];
                    for (segment, codes) in codes(segments).iter().enumerate() {
                        let (chip, first) = place(segment);
                        expected[chip][first..first + 3].copy_from_slice(codes);
                    }
                    assert_eq!(chips, expected, "{segments} segments");
                }
            }
        }
    }

    #[test]
    fn words_are_as_far_apart_as_the_part_asks_for() {
        assert!(f64::from(WORD_CLOCKS) * CLOCK_NS >= f64::from(ad5370::CYCLE_NS));
        // The select line is high for at least all idle clocks but two.
        assert!(f64::from(IDLE_CLOCKS - 2) * CLOCK_NS >= f64::from(ad5370::SYNC_HIGH_NS));
        const { assert!(LDAC_NS >= ad5370::LDAC_NS) };
        const { assert!(IDLE_CLOCKS <= 15 && LEAD_CLOCKS <= 15, "fields of four bits") };
    }

    /// What README.md says of the default instrument and of the most there can be.
    #[test]
    fn buses_add_47_microseconds_for_52_segments() {
        let schedule = Schedule::new(52).expect("channels");
        assert_eq!(schedule.words, 2 * 27 + 8);
        assert_eq!(schedule.latency_ns(), 46_945);
        assert_eq!(Schedule::new(64).expect("channels").latency_ns(), 55_345);
        let most = Schedule::new(SEGMENTS).expect("channels");
        assert_eq!((most.words, most.latency_ns()), (86, 63_745));
        assert_eq!(Schedule::new(SEGMENTS + 1), Err(TooMany { found: 79 }));
    }

    #[test]
    fn too_many_segments_leave_the_words_as_they_were() {
        let mut words = [[7; WORDS]; BUSES];
        assert_eq!(fill(&codes(SEGMENTS + 1), &mut words), Err(TooMany { found: SEGMENTS + 1 }));
        assert_eq!(words, [[7; WORDS]; BUSES]);
    }
}
