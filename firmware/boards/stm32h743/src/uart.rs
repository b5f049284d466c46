//! The link: USART3, its bytes written by DMA1 stream 4 in a circle; what is sent is sent by waiting.

use crate::memory::{LINK_BYTES, LinkRing};
use embassy_stm32::Peri;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::dma::vals::{Dir, Size};
use embassy_stm32::pac::{DMA1, DMAMUX1, RCC, USART3};
use embassy_stm32::peripherals;
use embassy_stm32::usart::{Config, Uart};
use stm32h743_logic::byte_ring::ByteRing;
use stm32h743_logic::clocks::LINK_BAUD;
use stm32h743_logic::requests::LINK;

const STREAM: usize = LINK.stream as usize;

/// Both directions of the link.
pub(crate) struct Link {
    uart: Uart<'static, Blocking>,
    bytes: LinkRing,
    ring: ByteRing<LINK_BYTES>,
}

impl Link {
    /// 921 600 baud, eight bits, no parity, one stop bit.
    pub(crate) fn new(
        usart: Peri<'static, peripherals::USART3>,
        tx: Peri<'static, peripherals::PD8>,
        rx: Peri<'static, peripherals::PD9>,
        bytes: LinkRing,
    ) -> Self {
        let mut config = Config::default();
        config.baudrate = LINK_BAUD;
        let Ok(uart) = Uart::new_blocking(usart, rx, tx, config) else { crate::stop::halt() };
        RCC.ahb1enr().modify(|w| w.set_dma1en(true));
        let _ = RCC.ahb1enr().read();
        DMAMUX1.ccr(STREAM).write(|w| w.set_dmareq_id(LINK.request));
        let stream = DMA1.st(STREAM);
        stream.par().write_value(USART3.rdr().as_ptr().addr() as u32);
        stream.m0ar().write_value(bytes.address());
        stream.ndtr().write(|w| w.set_ndt(LINK_BYTES as u16));
        stream.cr().write(|w| {
            w.set_dir(Dir::PERIPHERAL_TO_MEMORY);
            w.set_psize(Size::BITS8);
            w.set_msize(Size::BITS8);
            w.set_minc(true);
            w.set_circ(true);
        });
        stream.cr().modify(|w| w.set_en(true));
        USART3.cr3().modify(|w| w.set_dmar(true));
        Self { uart, bytes, ring: ByteRing::new() }
    }

    /// The next byte, if it has come.
    pub(crate) fn next(&mut self) -> Option<u8> {
        let left = DMA1.st(STREAM).ndtr().read().ndt();
        self.ring.next(left).map(|place| self.bytes.read(place))
    }

    /// Sends bytes; they take 11 us each.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        // A blocking transmitter has no errors.
        let _ = self.uart.blocking_write(bytes);
    }
}
