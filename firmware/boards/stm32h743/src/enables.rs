//! Interlock inputs and enables: four pins. Each step of what they do is in
//! `splash_firmware::interlock`.

use crate::pins::port;
use embassy_stm32::pac::gpio::vals::{Idr, Moder, Pupdr};
use splash_firmware::interlock::{Inputs, Outputs};
use stm32h743_logic::pins::{
    HIGH_VOLTAGE_CLOSED, HIGH_VOLTAGE_ENABLE, LASER_CLOSED, LASER_ENABLE, Pin,
};

/// Takes both enables down and makes the pins what they are.
pub(crate) fn down() {
    off();
    for pin in [LASER_ENABLE, HIGH_VOLTAGE_ENABLE] {
        port(pin).moder().modify(|w| w.set_moder(pin.number.into(), Moder::OUTPUT));
    }
    for pin in [LASER_CLOSED, HIGH_VOLTAGE_CLOSED] {
        port(pin).pupdr().modify(|w| w.set_pupdr(pin.number.into(), Pupdr::PULL_DOWN));
        port(pin).moder().modify(|w| w.set_moder(pin.number.into(), Moder::INPUT));
    }
}

/// Sets both enables.
pub(crate) fn set(outputs: Outputs) {
    let Outputs { high_voltage, laser } = outputs;
    for (pin, up) in [(LASER_ENABLE, laser), (HIGH_VOLTAGE_ENABLE, high_voltage)] {
        port(pin).bsrr().write(|w| {
            w.set_bs(pin.number.into(), up);
            w.set_br(pin.number.into(), !up);
        });
    }
}

/// Takes the laser's enable down, and leaves the high voltage as it is.
pub(crate) fn laser_off() {
    port(LASER_ENABLE).bsrr().write(|w| w.set_br(LASER_ENABLE.number.into(), true));
}

/// Takes both enables down.
pub(crate) fn off() {
    set(Outputs { high_voltage: false, laser: false });
}

/// Reads both chains.
pub(crate) fn inputs() -> Inputs {
    let closed = |pin: Pin| port(pin).idr().read().idr(pin.number.into()) == Idr::HIGH;
    Inputs { laser_permit: closed(LASER_CLOSED), high_voltage_ready: closed(HIGH_VOLTAGE_CLOSED) }
}
