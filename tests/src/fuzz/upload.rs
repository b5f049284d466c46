//! Configuration images, damaged on purpose, with checksums that are right all the same.

use super::Bytes;
use crate::instrument::Instrument;
use splash_firmware::config::Config;
use splash_firmware::pipeline::Pipeline;
use std::sync::OnceLock;

const CELLS: usize = 36;
const PIXELS: usize = CELLS * 16;
/// Larger frames would take all the time.
const MOST_PIXELS: usize = 1 << 16;

type Bank = Config<CELLS, PIXELS, PIXELS>;

/// An image is refused, and leaves no subapertures; or it is taken, is saved as bytes that are taken
/// again and saved as the same ones, and a loop runs on it.
pub(super) fn run(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let mut image = good().to_vec();
    let (choice, keep) = (bytes.u8(), bytes.u16());
    match choice & 3 {
        // Bytes that have nothing to do with an image.
        0 => image = bytes.rest().to_vec(),
        1 => image.truncate(usize::from(keep) % image.len()),
        _ => {}
    }
    while !bytes.is_empty() && !image.is_empty() {
        let (place, value) = (usize::from(bytes.u16()), bytes.u8());
        // The records come first and are short: half of the changes go there.
        let within = if place & 1 == 0 { image.len().min(2048) } else { image.len() };
        let length = image.len();
        image[(place >> 1) % within.min(length)] = value;
    }
    if choice & 4 == 0 {
        repair(&mut image);
    }
    let mut bank = Box::new(Bank::new());
    if load(&mut bank, &image).is_err() {
        assert_eq!(bank.subapertures(), 0, "a refused image leaves nothing");
        return;
    }
    let saved = save(&bank);
    let mut again = Box::new(Bank::new());
    load(&mut again, &saved).expect("what was saved is taken");
    assert!(save(&again) == saved, "and saved again is the same");
    close(&bank);
}

/// Two frames, dark and bright.
fn close(bank: &Bank) {
    let (width, height) = (usize::from(bank.width()), usize::from(bank.height()));
    if width * height > MOST_PIXELS {
        return;
    }
    let mut pipeline = Box::new(Pipeline::<CELLS, PIXELS>::new());
    pipeline.reset(bank);
    for (number, level) in [(0, 0), (1, ((1u32 << bank.bits()) - 1) as u16), (2, 7)] {
        pipeline.begin(bank, number);
        for _ in 0..height {
            pipeline.push_row(bank, &vec![level; width]).expect("a row of the detector");
        }
        pipeline.finish(bank);
    }
}

fn good() -> &'static [u8] {
    static IMAGE: OnceLock<Vec<u8>> = OnceLock::new();
    IMAGE.get_or_init(|| save(&Instrument::circle(6, 4).config::<CELLS, PIXELS, PIXELS>()))
}

/// The right checksum at the end.
fn repair(image: &mut [u8]) {
    if let Some((body, checksum)) = image.split_last_chunk_mut::<4>() {
        *checksum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(body).to_le_bytes();
    }
}

fn save(bank: &Bank) -> Vec<u8> {
    let mut bytes = Vec::new();
    bank.save(&mut |piece| bytes.extend_from_slice(piece));
    bytes
}

fn load(bank: &mut Bank, image: &[u8]) -> Result<(), splash_firmware::image::ImageError> {
    let mut rest = image;
    bank.load(&mut |out| match rest.split_at_checked(out.len()) {
        Some((piece, after)) => {
            out.copy_from_slice(piece);
            rest = after;
            true
        }
        None => false,
    })
}
