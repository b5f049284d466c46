//! The DACs: SPI1 to SPI3 and their DMA, and TIM4, which steers the select lines and pulls LDAC.
//!
//! What goes out, and when, is in `stm32h743_logic::dac_burst`.
#![allow(unsafe_code, reason = "the section of what the frames' exception calls")]

use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::spi::Spi;
use embassy_stm32::pac::spi::vals::{Comm, Cpha, Fthlv, Master, Mbr, Ssom};
use embassy_stm32::pac::timer::vals::{OcmGp, Urs};
use embassy_stm32::pac::{DMA1, DMAMUX1, RCC, SPI1, SPI2, SPI3, TIM4};
use splash_firmware::segments::ACTUATORS;
use stm32h743_logic::ad5370::WORD_BITS;
use stm32h743_logic::dac_burst::{self, BUSES, IDLE_CLOCKS, LEAD_CLOCKS, Schedule, TooMany, Words};
use stm32h743_logic::dac_bus::DacBus;
use stm32h743_logic::requests::DACS;

const SPIS: [Spi; BUSES] = [SPI1, SPI2, SPI3];
/// Channel 1, of the steering line; channel 2, of LDAC.
const STEER: usize = 0;
const LDAC: usize = 1;

/// Why codes were not taken.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Refused {
    /// There is no channel for so many segments.
    TooMany,
    /// The transfer before is not over: a bus or its DMA hangs, or frames come too fast.
    Busy,
}

impl From<TooMany> for Refused {
    fn from(_: TooMany) -> Self {
        Self::TooMany
    }
}

/// DACs on three buses; a transfer goes on by itself.
pub(crate) struct DmaDacs {
    words: &'static mut Words,
    /// A transfer was started.
    started: bool,
}

impl DmaDacs {
    /// Sets buses and timer up: select lines and LDAC are high, the steering line is low.
    pub(crate) fn new(words: &'static mut Words) -> Self {
        RCC.ahb1enr().modify(|w| w.set_dma1en(true));
        RCC.apb1lenr().modify(|w| {
            w.set_tim4en(true);
            w.set_spi2en(true);
            w.set_spi3en(true);
        });
        RCC.apb2enr().modify(|w| w.set_spi1en(true));
        let _ = RCC.apb2enr().read();
        for ((spi, words), stream) in SPIS.iter().zip(words.iter()).zip(&DACS) {
            spi.cfg1().write(|w| {
                w.set_dsize((WORD_BITS - 1) as u8);
                w.set_fthlv(Fthlv::ONE_FRAME);
                w.set_mbr(Mbr::DIV2);
            });
            // SPI mode 1, and the select line by itself: a pulse between words.
            spi.cfg2().write(|w| {
                w.set_master(Master::MASTER);
                w.set_comm(Comm::TRANSMITTER);
                w.set_cpha(Cpha::SECOND_EDGE);
                w.set_ssoe(true);
                w.set_ssom(Ssom::NOT_ASSERTED);
                w.set_mssi(LEAD_CLOCKS as u8);
                w.set_midi(IDLE_CLOCKS as u8);
                w.set_afcntr(true);
            });
            let number = usize::from(stream.stream);
            DMAMUX1.ccr(number).write(|w| w.set_dmareq_id(stream.request));
            let st = DMA1.st(number);
            st.par().write_value(spi.txdr32().as_ptr().addr() as u32);
            st.m0ar().write_value(words.as_ptr().expose_provenance() as u32);
            st.cr().write(|w| {
                w.set_dir(Dir::MEMORY_TO_PERIPHERAL);
                w.set_psize(Size::BITS32);
                w.set_msize(Size::BITS32);
                w.set_minc(true);
                w.set_pl(Pl::HIGH);
            });
        }
        TIM4.cr1().write(|w| {
            w.set_opm(true);
            w.set_urs(Urs::COUNTER_ONLY);
        });
        TIM4.ccmr_output(0).modify(|w| {
            w.set_ocm(STEER, OcmGp::PWM_MODE2);
            w.set_ocm(LDAC, OcmGp::PWM_MODE2);
        });
        // A compare value that is not reached: lines are as they are at rest before the first frame.
        TIM4.ccr(STEER).write(|w| w.set_ccr(u16::MAX));
        TIM4.ccr(LDAC).write(|w| w.set_ccr(u16::MAX));
        TIM4.ccer().modify(|w| {
            w.set_ccp(LDAC, true);
            w.set_cce(STEER, true);
            w.set_cce(LDAC, true);
        });
        Self { words, started: false }
    }

    #[inline(always)]
    fn is_busy(&self) -> bool {
        self.started && (TIM4.cr1().read().cen() || SPIS.iter().any(|spi| !spi.sr().read().eot()))
    }

    #[inline(always)]
    fn start(&mut self, schedule: &Schedule) {
        TIM4.ccr(STEER).write(|w| w.set_ccr(schedule.steer));
        TIM4.ccr(LDAC).write(|w| w.set_ccr(schedule.ldac));
        TIM4.arr().write(|w| w.set_arr(schedule.end));
        // The words are in memory, which is not cached, before a DMA may look for them.
        cortex_m::asm::dsb();
        for (spi, stream) in SPIS.iter().zip(&DACS) {
            let number = usize::from(stream.stream);
            spi.cr1().modify(|w| w.set_spe(false));
            spi.cfg1().modify(|w| w.set_txdmaen(false));
            spi.ifcr().write(|w| {
                w.set_eotc(true);
                w.set_txtfc(true);
            });
            DMA1.ifcr(number / 4).write(|w| {
                w.set_tcif(number % 4, true);
                w.set_htif(number % 4, true);
                w.set_teif(number % 4, true);
                w.set_dmeif(number % 4, true);
                w.set_feif(number % 4, true);
            });
            let st = DMA1.st(number);
            st.ndtr().write(|w| w.set_ndt(schedule.words));
            st.cr().modify(|w| w.set_en(true));
            spi.cfg1().modify(|w| w.set_txdmaen(true));
            spi.cr2().write(|w| w.set_tsize(schedule.words));
            spi.cr1().modify(|w| w.set_spe(true));
        }
        for spi in &SPIS {
            spi.cr1().modify(|w| w.set_cstart(true));
        }
        TIM4.cr1().modify(|w| w.set_cen(true));
        self.started = true;
    }
}

impl DacBus for DmaDacs {
    type Error = Refused;

    #[unsafe(link_section = ".itcm.dacs")]
    fn update(&mut self, codes: &[[u16; ACTUATORS]]) -> Result<(), Refused> {
        if self.is_busy() {
            return Err(Refused::Busy);
        }
        let schedule = dac_burst::fill(codes, self.words)?;
        self.start(&schedule);
        Ok(())
    }
}
