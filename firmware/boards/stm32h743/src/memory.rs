//! What lies outside DTCM: calibration banks and the detector's ring in AXI SRAM, words for the DACs and
//! the link's bytes in SRAM1; and in DTCM the last words, which a reset leaves alone. Nothing but the
//! banks is initialised at start.
#![allow(unsafe_code, reason = "statics that a DMA shares, in sections that nobody initialises")]

use crate::geometry::{B, M, P};
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};
use splash_firmware::config::Config;
use splash_firmware::last_words::{LastWords, Words as Said};
use static_cell::ConstStaticCell;
use stm32h743_logic::dac_burst::{BUSES, WORDS, Words};
use stm32h743_logic::shape::{LINE_BYTES, RING_BYTES, Shape};

/// Bytes of the link that may come while the main loop is elsewhere: 22 ms.
pub(crate) const LINK_BYTES: usize = 2048;

/// Memory that is used once, aligned as the cache needs it.
#[repr(C, align(32))]
struct Place<T>(UnsafeCell<MaybeUninit<T>>);

// SAFETY: `take` gives each place away once.
unsafe impl<T: Send> Sync for Place<T> {}

impl<T> Place<T> {
    const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }
}

/// memory.x finds it by its name.
static BANKS: [ConstStaticCell<Config<M, P, B>>; 2] =
    [const { ConstStaticCell::new(Config::new()) }; 2];
#[unsafe(link_section = ".axisram.ring")]
static RING: Place<[u8; RING_BYTES]> = Place::new();
#[unsafe(link_section = ".sram123.words")]
static DAC_WORDS: Place<Words> = Place::new();
#[unsafe(link_section = ".sram123.link")]
static LINK_RING: Place<[u8; LINK_BYTES]> = Place::new();

#[unsafe(link_section = ".uninit.words")]
static LAST_WORDS: Place<LastWords> = Place::new();

/// The last words: of the program before this one at the start, and of this one at its end.
///
/// # Safety
/// Nobody else has them: [`take`] at the start, and what ends the program.
pub(crate) unsafe fn last_words() -> &'static mut LastWords {
    // SAFETY: words and bytes, of which any value is valid; as the caller says, there is no other
    // reference.
    unsafe { (*LAST_WORDS.0.get()).assume_init_mut() }
}

/// All of it.
pub(crate) struct Memory {
    /// The calibration banks: without subapertures.
    pub(crate) banks: [&'static mut Config<M, P, B>; 2],
    /// The detector's ring.
    pub(crate) ring: RowRing,
    /// Words for the DACs.
    pub(crate) words: &'static mut Words,
    /// The link's ring.
    pub(crate) link: LinkRing,
    /// Last words of the program before this start.
    pub(crate) said: Option<Said>,
}

/// Gives all of it away, once, after SRAM1 is clocked.
pub(crate) fn take() -> Option<Memory> {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    if TAKEN.swap(true, Ordering::Relaxed) {
        return None;
    }
    // SAFETY: TAKEN lets this run once, so that there is one reference.
    let words = unsafe { &mut *DAC_WORDS.0.get() };
    Some(Memory {
        banks: BANKS.each_ref().map(ConstStaticCell::take),
        ring: RowRing { memory: RING.0.get().cast() },
        words: words.write([[0; WORDS]; BUSES]),
        link: LinkRing { memory: LINK_RING.0.get().cast() },
        // SAFETY: this program has not ended, and TAKEN lets this run once.
        said: unsafe { last_words() }.take(),
    })
}

/// The detector's blocks, written by the DMA.
pub(crate) struct RowRing {
    memory: *mut u8,
}

// SAFETY: the memory is this value's alone, whoever has it.
unsafe impl Send for RowRing {}

impl RowRing {
    /// Where the DMA finds it.
    pub(crate) fn address(&self) -> u32 {
        self.memory.expose_provenance() as u32
    }

    /// The pixels of a block that the DMA has filled, and does not fill again before it is given back.
    #[inline(always)]
    pub(crate) fn pixels(&mut self, shape: &Shape, slot: u16) -> &[u16] {
        let (bytes, offset) = (shape.stride(), shape.offset(slot));
        if offset + bytes > RING_BYTES {
            return &[];
        }
        // SAFETY: inside the ring, and aligned: a block begins at a multiple of 32 bytes.
        unsafe {
            let first = self.memory.add(offset);
            invalidate(first, bytes);
            core::slice::from_raw_parts(first.cast(), shape.pixels())
        }
    }
}

/// Forgets what the data cache has of these bytes: older than what the DMA has written.
///
/// # Safety
/// `first` and `bytes` are multiples of a cache line, and nothing there was written by the processor.
#[inline(always)]
unsafe fn invalidate(first: *mut u8, bytes: usize) {
    const DCIMVAC: *mut u32 = 0xE000_EF5C as *mut u32;
    cortex_m::asm::dsb();
    for line in (0..bytes).step_by(LINE_BYTES) {
        // SAFETY: the register of the Armv7-M architecture that forgets one line; as the caller says, it
        // holds nothing that memory has not.
        unsafe { DCIMVAC.write_volatile(first.addr() as u32 + line as u32) };
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// The link's bytes, written by the DMA.
pub(crate) struct LinkRing {
    memory: *mut u8,
}

impl LinkRing {
    /// Where the DMA finds it.
    pub(crate) fn address(&self) -> u32 {
        self.memory.expose_provenance() as u32
    }

    /// A byte of it.
    pub(crate) fn read(&self, place: usize) -> u8 {
        if place >= LINK_BYTES {
            return 0;
        }
        // SAFETY: inside the ring; the DMA writes whole bytes, and the memory is not cached.
        unsafe { self.memory.add(place).read_volatile() }
    }
}
