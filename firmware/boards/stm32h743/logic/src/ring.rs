//! The detector's blocks as the DMA fills them: a ring of more blocks than the two that the DMA knows.
//!
//! The DMA fills two buffers in turn. Whenever one is full, its address register is free until the other
//! one is: it is aimed at the next block of the ring. So the DMA never stops, and blocks that were not
//! read yet are not overwritten as long as there are others.

use crate::shape::Shape;

/// Blocks of the detector, as far as the DMA has come.
#[derive(Debug)]
pub struct Ring {
    shape: Shape,
    /// The slot that is filled next to be complete.
    filling: u16,
    /// Whether the second of the two buffers is being filled.
    second: bool,
}

/// A block is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Complete {
    /// The slot it is in.
    pub slot: u16,
    /// The slot to aim the free address register at.
    pub next: u16,
    /// Whether that is the register of the second buffer.
    pub second: bool,
}

/// Blocks were lost: the ring must be started again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The interrupt came more than a block late: the DMA has gone on where it was aimed before.
    Late,
    /// No block is free: the frames take longer than they may.
    Full,
    /// The camera interface lost pixels: the DMA did not take them in time.
    Overrun,
    /// A block came where another one was due: rows are missing, or too many.
    Astray,
}

impl Ring {
    /// A ring at its start: the DMA's first buffer is slot 0, its second one slot 1.
    #[must_use]
    pub const fn new(shape: Shape) -> Self {
        Self { shape, filling: 0, second: false }
    }

    /// The blocks.
    #[must_use]
    pub const fn shape(&self) -> &Shape {
        &self.shape
    }

    /// A buffer is full. `second`: the DMA now fills the second one. `waiting`: blocks that were
    /// complete before and are not yet given back.
    ///
    /// # Errors
    /// [`Fault::Late`], [`Fault::Full`].
    pub fn complete(&mut self, second: bool, waiting: usize) -> Result<Complete, Fault> {
        if second == self.second {
            return Err(Fault::Late);
        }
        // This one, the one being filled and the one to be aimed at.
        if waiting + 3 > usize::from(self.shape.slots) {
            return Err(Fault::Full);
        }
        let after = |slot: u16, n: u16| {
            let slot = slot + n;
            if slot < self.shape.slots { slot } else { slot - self.shape.slots }
        };
        let slot = self.filling;
        let complete = Complete { slot, next: after(slot, 2), second: self.second };
        self.filling = after(slot, 1);
        self.second = second;
        Ok(complete)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    fn shape(slots: u16) -> Shape {
        Shape { width: 128, rows: 8, blocks: 16, slots, bits: 12 }
    }

    /// A DMA that writes the number of its block into the slot it is aimed at.
    struct Dma {
        memory: Vec<u32>,
        aim: [u16; 2],
        second: bool,
        written: u32,
    }

    impl Dma {
        fn new(slots: u16) -> Self {
            Self { memory: vec![u32::MAX; slots.into()], aim: [0, 1], second: false, written: 0 }
        }

        fn block(&mut self) {
            let slot = self.aim[usize::from(self.second)];
            self.memory[usize::from(slot)] = self.written;
            self.written += 1;
            self.second = !self.second;
        }
    }

    #[test]
    fn blocks_are_read_as_they_were_written_with_any_backlog_that_fits() {
        for slots in [3, 4, 5, 32] {
            for backlog in 0..usize::from(slots) - 2 {
                let (mut dma, mut ring) = (Dma::new(slots), Ring::new(shape(slots)));
                let mut waiting = VecDeque::new();
                for number in 0..500 {
                    dma.block();
                    let complete = ring.complete(dma.second, waiting.len()).expect("room");
                    dma.aim[usize::from(complete.second)] = complete.next;
                    waiting.push_back((number, complete.slot));
                    if waiting.len() > backlog {
                        let (number, slot) = waiting.pop_front().expect("one");
                        assert_eq!(dma.memory[usize::from(slot)], number);
                    }
                }
            }
        }
    }

    #[test]
    fn a_full_ring_is_told_before_a_block_is_overwritten() {
        let mut ring = Ring::new(shape(5));
        let mut second = false;
        for waiting in 0..3 {
            second = !second;
            assert!(ring.complete(second, waiting).is_ok(), "{waiting}");
        }
        assert_eq!(ring.complete(!second, 3), Err(Fault::Full));
    }

    #[test]
    fn an_interrupt_that_comes_a_block_late_is_told() {
        let (mut dma, mut ring) = (Dma::new(8), Ring::new(shape(8)));
        dma.block();
        dma.block();
        assert_eq!(ring.complete(dma.second, 0), Err(Fault::Late));
    }
}
