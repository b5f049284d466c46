//! Clocks: the dividers of `stm32h743_logic::clocks`, as the driver wants them.

use embassy_stm32::Config;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk,
    TimerPrescaler, VoltageScale, mux,
};
use embassy_stm32::time::Hertz;
use stm32h743_logic::clocks::{BUSES, CORE, OSCILLATOR_HZ};

/// 480 MHz from an oscillator of 8 MHz on OSC_IN.
pub(crate) fn config() -> Config {
    let mut config = Config::default();
    let rcc = &mut config.rcc;
    rcc.hse = Some(Hse { freq: Hertz(OSCILLATOR_HZ), mode: HseMode::Bypass });
    rcc.pll1 = Some(pll(&CORE));
    rcc.pll2 = Some(pll(&BUSES));
    rcc.sys = Sysclk::PLL1_P;
    rcc.d1c_pre = AHBPrescaler::DIV1;
    rcc.ahb_pre = AHBPrescaler::DIV2;
    rcc.apb1_pre = APBPrescaler::DIV2;
    rcc.apb2_pre = APBPrescaler::DIV2;
    rcc.apb3_pre = APBPrescaler::DIV2;
    rcc.apb4_pre = APBPrescaler::DIV2;
    rcc.timer_prescaler = TimerPrescaler::DefaultX2;
    rcc.voltage_scale = VoltageScale::Scale0;
    rcc.mux.spi123sel = mux::Saisel::PLL2_P;
    config
}

/// The driver counts dividers and multipliers from what their fields hold: one less.
fn pll(pll: &stm32h743_logic::clocks::Pll) -> Pll {
    Pll {
        source: PllSource::HSE,
        prediv: PllPreDiv::from_bits(pll.before as u8),
        mul: PllMul::from_bits((pll.multiplier - 1) as u16),
        fracn: None,
        divp: Some(PllDiv::from_bits((pll.after - 1) as u8)),
        divq: None,
        divr: None,
    }
}
