//! What is on which pin of the STM32H743ZI, 144 pins: one table, which the board writes to its
//! registers and a test compares with the manufacturer's.

/// A pin: port and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// 'A' to 'G'.
    pub port: char,
    /// 0 to 15.
    pub number: u8,
}

/// A pin that belongs to a peripheral.
#[derive(Clone, Copy, Debug)]
pub struct Wire {
    /// The pin.
    pub pin: Pin,
    /// The number of its alternate function.
    pub function: u8,
    /// The peripheral.
    pub peripheral: &'static str,
    /// Its signal.
    pub signal: &'static str,
}

const fn pin(port: char, number: u8) -> Pin {
    Pin { port, number }
}

const fn wire(pin: Pin, function: u8, peripheral: &'static str, signal: &'static str) -> Wire {
    Wire { pin, function, peripheral, signal }
}

/// The detector's, the timers' and the DAC buses' pins. The link's are the UART driver's.
pub const WIRES: [Wire; 32] = [
    wire(pin('A', 6), 13, "DCMI", "PIXCLK"),
    wire(pin('A', 4), 13, "DCMI", "HSYNC"),
    wire(pin('G', 9), 13, "DCMI", "VSYNC"),
    wire(pin('C', 6), 13, "DCMI", "D0"),
    wire(pin('C', 7), 13, "DCMI", "D1"),
    wire(pin('C', 8), 13, "DCMI", "D2"),
    wire(pin('C', 9), 13, "DCMI", "D3"),
    wire(pin('E', 4), 13, "DCMI", "D4"),
    wire(pin('D', 3), 13, "DCMI", "D5"),
    wire(pin('E', 5), 13, "DCMI", "D6"),
    wire(pin('E', 6), 13, "DCMI", "D7"),
    wire(pin('C', 10), 13, "DCMI", "D8"),
    wire(pin('C', 12), 13, "DCMI", "D9"),
    wire(pin('D', 6), 13, "DCMI", "D10"),
    wire(pin('D', 2), 13, "DCMI", "D11"),
    wire(pin('G', 6), 13, "DCMI", "D12"),
    wire(pin('G', 7), 13, "DCMI", "D13"),
    // The laser's sync, once for the gate and once to be counted; VSYNC once more, to stamp it.
    wire(pin('A', 0), 1, "TIM2", "CH1"),
    wire(pin('B', 10), 1, "TIM2", "CH3"),
    wire(pin('A', 1), 2, "TIM5", "CH2"),
    wire(pin('A', 2), 2, "TIM5", "CH3"),
    wire(pin('A', 5), 5, "SPI1", "SCK"),
    wire(pin('A', 7), 5, "SPI1", "MOSI"),
    wire(pin('G', 10), 5, "SPI1", "NSS"),
    wire(pin('B', 13), 5, "SPI2", "SCK"),
    wire(pin('B', 15), 5, "SPI2", "MOSI"),
    wire(pin('B', 12), 5, "SPI2", "NSS"),
    wire(pin('B', 3), 6, "SPI3", "SCK"),
    wire(pin('B', 2), 7, "SPI3", "MOSI"),
    wire(pin('A', 15), 6, "SPI3", "NSS"),
    wire(pin('D', 12), 2, "TIM4", "CH1"),
    wire(pin('D', 13), 2, "TIM4", "CH2"),
];

/// Low while the laser's chain is open: it is pulled down.
pub const LASER_CLOSED: Pin = pin('E', 7);
/// Low while the high voltage's chain is open: it is pulled down.
pub const HIGH_VOLTAGE_CLOSED: Pin = pin('E', 8);
/// High to enable the laser.
pub const LASER_ENABLE: Pin = pin('E', 9);
/// High to enable the high voltage.
pub const HIGH_VOLTAGE_ENABLE: Pin = pin('E', 10);
/// The link: USART3's TX and RX.
pub const LINK: [Pin; 2] = [pin('D', 8), pin('D', 9)];

#[cfg(test)]
mod tests {
    use super::*;
    use stm32_metapac::metadata::METADATA;

    fn is_there(wire: &Wire) -> bool {
        let name = format!("P{}{}", wire.pin.port, wire.pin.number);
        let mut found = METADATA.peripherals.iter().filter(|p| p.name == wire.peripheral);
        let pins = found.next().expect(wire.peripheral).pins;
        pins.iter().any(|p| p.pin == name && p.signal == wire.signal && p.af == Some(wire.function))
    }

    #[test]
    fn every_wire_is_in_the_manufacturers_table() {
        for wire in &WIRES {
            assert!(is_there(wire), "{wire:?}");
        }
        let [tx, rx] = LINK;
        assert!(is_there(&Wire { pin: tx, function: 7, peripheral: "USART3", signal: "TX" }));
        assert!(is_there(&Wire { pin: rx, function: 7, peripheral: "USART3", signal: "RX" }));
    }

    #[test]
    fn no_pin_is_used_twice_and_those_of_the_debugger_are_left() {
        let discrete = [LASER_CLOSED, HIGH_VOLTAGE_CLOSED, LASER_ENABLE, HIGH_VOLTAGE_ENABLE];
        let pins = WIRES.iter().map(|wire| wire.pin).chain(discrete).chain(LINK);
        let pins = pins.collect::<Vec<_>>();
        for (i, pin) in pins.iter().enumerate() {
            assert!(!pins[..i].contains(pin), "{pin:?} twice");
        }
        // SWDIO and SWCLK.
        assert!(!pins.contains(&pin('A', 13)) && !pins.contains(&pin('A', 14)));
    }

    #[test]
    fn the_readme_wires_them_so() {
        let readme = include_str!("../../README.md");
        for wire in &WIRES {
            let line = format!("P{}{} | AF{}", wire.pin.port, wire.pin.number, wire.function);
            let row = readme.lines().find(|row| row.contains(&line));
            let row = row.unwrap_or_else(|| panic!("README.md has no {line}"));
            assert!(row.contains(&format!("{}_{}", wire.peripheral, wire.signal)), "{row}");
        }
    }
}
