//! The range gate (TIM2) and the count of laser pulses with the stamp of VSYNC (TIM5).
//!
//! Both run without the processor. TIM2 counts from the laser's sync once, and drives the gate; TIM5 counts
//! the same sync, and copies its count at the rising edge of VSYNC.

use embassy_stm32::pac::timer::vals::{CcmrInputCcs, OcmGp, Sms, Ts, Urs};
use embassy_stm32::pac::{RCC, TIM2, TIM5};
use stm32h743_logic::gate::GateTimer;

/// Channel 3, of the gate and of VSYNC's stamp for the interrupts.
const CH3: usize = 2;
/// Channel 4, which stamps VSYNC once more: reading a stamp takes it away.
const CH4: usize = 3;
/// Channel 2, of the pulses.
const CH2: usize = 1;

/// Starts the count, and makes the gate ready: it stays shut until [`set`].
pub(crate) fn start() {
    RCC.apb1lenr().modify(|w| {
        w.set_tim2en(true);
        w.set_tim5en(true);
    });
    // Reads wait for the bus, and with it for the clock.
    let _ = RCC.apb1lenr().read();
    TIM2.cr1().write(|w| {
        w.set_opm(true);
        w.set_arpe(true);
        w.set_urs(Urs::COUNTER_ONLY);
    });
    TIM2.ccmr_output(1).modify(|w| {
        w.set_ocm(CH3 % 2, OcmGp::PWM_MODE2);
        w.set_ocpe(CH3 % 2, true);
    });
    TIM5.ccmr_input(0).modify(|w| w.set_ccs(CH2 % 2, CcmrInputCcs::TI4));
    // Channel 3 from its own input, channel 4 from that of channel 3: the two settings' names are those
    // of channel 4.
    TIM5.ccmr_input(1).modify(|w| {
        w.set_ccs(CH3 % 2, CcmrInputCcs::TI4);
        w.set_ccs(CH4 % 2, CcmrInputCcs::TI3);
    });
    TIM5.smcr().modify(|w| {
        w.set_ts(Ts::TI2FP2);
        w.set_sms(Sms::EXT_CLOCK_MODE);
    });
    TIM5.ccer().modify(|w| {
        w.set_cce(CH3, true);
        w.set_cce(CH4, true);
    });
    TIM5.cr1().modify(|w| w.set_cen(true));
}

/// Opens the gate so from the next pulse on: a pulse that is in flight keeps the gate it has.
pub(crate) fn set(gate: GateTimer) {
    TIM2.ccr(CH3).write_value(gate.compare);
    TIM2.arr().write_value(gate.reload);
    if !TIM2.ccer().read().cce(CH3) {
        TIM2.egr().write(|w| w.set_ug(true));
        TIM2.ccer().modify(|w| w.set_cce(CH3, true));
        TIM2.smcr().modify(|w| {
            w.set_ts(Ts::TI1FP1);
            w.set_sms(Sms::TRIGGER_MODE);
        });
    }
}

/// The count of pulses when the last frame began.
pub(crate) fn stamp() -> u32 {
    TIM5.ccr(CH4).read()
}

/// The same, if a frame began since this was last called.
#[inline(always)]
pub(crate) fn take_stamp() -> Option<u32> {
    // Reading the capture register clears its flag.
    TIM5.sr().read().ccif(CH3).then(|| TIM5.ccr(CH3).read())
}
