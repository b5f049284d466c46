//! The controller's end of the link, and what comes over it: bytes in, banks and flash behind.

use super::{Bank, CELLS, PIXELS};
use crate::error::Error;
use crate::link::frames;
use crate::nor_flash::Nor;
use crate::reconstructor::Reconstructor;
use rand::{Rng, RngExt};
use rand_xoshiro::Xoshiro256PlusPlus;
use splash_firmware::banks::Banks;
use splash_firmware::calibration::Step;
use splash_firmware::link::{Message, Receiver, Request, Response, WIRE, encode};
use splash_firmware::mirror::Serials;
use splash_firmware::mode::{Mode, Refusal};
use splash_firmware::spec::Map;
use splash_server::parameters;

/// Pages of the flash: two images and their headers.
const PAGES: usize = 64;
/// Gains of the configurations that take turns.
const GAINS: [f64; 3] = [0.5, 0.4, 0.3];

/// The link, and the flash.
pub(super) struct Desk {
    receiver: Receiver,
    pub(super) flash: Nor<32>,
    /// Images of configurations, calibrated, and their hashes.
    images: Vec<(Vec<u8>, u32)>,
    /// Messages that were refused or could not be read.
    pub(super) refused: u64,
}

impl Desk {
    /// A link that is quiet, and a flash with nothing in it.
    ///
    /// # Errors
    /// [`Error::Config`] for an instrument that the firmware refuses.
    pub(super) fn new(reconstructor: &Reconstructor, seed: u64) -> Result<Self, Error> {
        let mut images = Vec::new();
        for gain in GAINS {
            let mut spec = reconstructor.spec();
            spec.control.gain = Map::Uniform(gain);
            let mut bank = Box::new(Bank::new());
            bank.build(&spec)?;
            bank.set_calibrated(&Step::ALL, u16::MAX);
            let mut image = Vec::new();
            bank.save(&mut |bytes| image.extend_from_slice(bytes));
            images.push((image, bank.hash()));
        }
        let flash = Nor::new(PAGES, seed, true);
        Ok(Self { receiver: Receiver::new(), flash, images, refused: 0 })
    }

    /// Bytes come over the link; what they ask of banks and flash is done, as far as `mode` allows it.
    pub(super) fn receive(
        &mut self,
        bytes: &[u8],
        banks: &mut Banks<'_, CELLS, PIXELS, PIXELS>,
        mode: Mode,
    ) {
        let serials = match mode {
            Mode::Safe | Mode::Standby => Ok(Serials::default()),
            mode => Err(Refusal::WrongMode { mode }.into()),
        };
        for &byte in bytes {
            match self.receiver.push::<Request>(byte) {
                Some(Ok(message)) => {
                    let answer = parameters::draft(&mut banks.draft, &message.body).or_else(|| {
                        let flash = Some(&mut self.flash);
                        parameters::stored(flash, banks, &message.body, serials)
                    });
                    self.refused += u64::from(matches!(answer, Some(Response::Refused(_))));
                }
                Some(Err(_)) => self.refused += 1,
                None => {}
            }
        }
    }

    /// Any bytes, ended.
    pub(super) fn garbage(random: &mut Xoshiro256PlusPlus) -> Vec<u8> {
        let mut bytes = vec![0; random.random_range(1..600)];
        random.fill_bytes(&mut bytes);
        bytes.push(0);
        bytes
    }

    /// One of the configurations, its image and hash.
    pub(super) fn image(&self, random: &mut Xoshiro256PlusPlus) -> (Vec<u8>, u32) {
        self.images[random.random_range(0..self.images.len())].clone()
    }

    /// Whether a hash is that of one of them.
    pub(super) fn knows(&self, hash: u32) -> bool {
        self.images.iter().any(|(_, known)| *known == hash)
    }
}

/// A request on the wire.
pub(super) fn wire(body: Request) -> Vec<u8> {
    let mut wire = [0; WIRE];
    let message = Message { sequence: 1, body };
    encode(&message, &mut wire).expect("requests fit").to_vec()
}

/// An upload on the wire, message by message; the last one is the switch.
pub(super) fn upload(image: &[u8]) -> Vec<Vec<u8>> {
    frames::upload(image).chain([Request::Switch]).map(wire).collect()
}
