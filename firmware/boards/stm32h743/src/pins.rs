//! The pins of `stm32h743_logic::pins`, written to their registers.

use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr};
use embassy_stm32::pac::{GPIOA, GPIOB, GPIOC, GPIOD, GPIOE, GPIOF, GPIOG};
use stm32h743_logic::pins::{Pin, WIRES};

/// The registers of a pin's port. The board's initialisation has clocked them all.
pub(crate) const fn port(pin: Pin) -> Gpio {
    match pin.port {
        'A' => GPIOA,
        'B' => GPIOB,
        'C' => GPIOC,
        'D' => GPIOD,
        'E' => GPIOE,
        'F' => GPIOF,
        _ => GPIOG,
    }
}

/// Gives each pin to its peripheral.
pub(crate) fn connect() {
    for wire in &WIRES {
        let (port, number) = (port(wire.pin), usize::from(wire.pin.number));
        port.afr(number / 8).modify(|w| w.set_afr(number % 8, wire.function));
        port.ospeedr().modify(|w| w.set_ospeedr(number, Ospeedr::VERY_HIGH_SPEED));
        port.moder().modify(|w| w.set_moder(number, Moder::ALTERNATE));
    }
}
