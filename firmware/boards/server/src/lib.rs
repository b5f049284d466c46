//! What the boards have in common: the loop in which the emulated ones serve host-sim over a link.
//!
//! A board implements [`Port`] and calls [`serve`]. Detector rows, DACs and marks have their own
//! ways in and out, as on a real board; configuration, reports and telemetry go over the
//! [link](splash_firmware::link).
//!
//! A board whose frames come by themselves has a loop of its own, and takes from here the [`Link`]
//! with its [`receive`], [`Pieces`] and [`Outbox`].

#![no_std]

mod image;
mod no_flash;
mod outbox;
pub mod parameters;
mod server;

pub use image::{Left, Pieces};
pub use no_flash::NoFlash;
pub use outbox::Outbox;
pub use server::{PERMITTED, controller, identity, receive, serve};

use embedded_storage::nor_flash::NorFlash;
use splash_firmware::link::Stack;

/// A stream of bytes to and from a PC.
pub trait Link {
    /// Why a transfer failed: the other end is gone.
    type Error;

    /// Fills `bytes` from the link; blocks.
    ///
    /// # Errors
    /// If the link ends before.
    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Self::Error>;

    /// Sends all of `bytes` on the link; blocks.
    ///
    /// # Errors
    /// If the link has ended.
    fn send(&mut self, bytes: &[u8]) -> Result<(), Self::Error>;
}

impl<T: Port> Link for T {
    type Error = T::Error;

    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Self::Error> {
        Port::receive(self, bytes)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), Self::Error> {
        Port::send(self, bytes)
    }
}

/// What an emulated board gives to the server.
pub trait Port {
    /// Why a transfer failed: the other end is gone.
    type Error;

    /// Where configurations are stored: [`NoFlash`] if nowhere.
    type Flash: NorFlash;

    /// Fills `bytes` from the link; blocks.
    ///
    /// # Errors
    /// If the link ends before.
    fn receive(&mut self, bytes: &mut [u8]) -> Result<(), Self::Error>;

    /// Sends all of `bytes` on the link; blocks.
    ///
    /// # Errors
    /// If the link has ended.
    fn send(&mut self, bytes: &[u8]) -> Result<(), Self::Error>;

    /// Begins a frame of `pixels` pixels in rows of `width`, 1 to 4096. What is left of the frame
    /// before is given up.
    ///
    /// # Errors
    /// If there is no detector any more.
    fn expose(&mut self, pixels: usize, width: usize) -> Result<(), Self::Error>;

    /// The next rows of the frame, valid until the next call, or `None` behind the last; blocks. As
    /// many whole rows as the board takes at once, or what is left of a last row that is cut short.
    ///
    /// # Errors
    /// If the detector ends before.
    fn rows(&mut self) -> Result<Option<&[u16]>, Self::Error>;

    /// Hands the codes of a frame, in subaperture order, to the DACs.
    ///
    /// # Errors
    /// If nothing takes them any more.
    fn actuate(&mut self, codes: &[[u16; 3]]) -> Result<(), Self::Error>;

    /// How deep the stack went since the start.
    fn stack(&self) -> Stack;

    /// Where configurations are stored.
    fn flash(&mut self) -> Option<&mut Self::Flash> {
        None
    }

    /// Marks this moment for the counter outside: instructions or cycles. Without a receiver, since
    /// rows are borrowed from the port while the time of `push_rows` is taken.
    fn mark();
}
