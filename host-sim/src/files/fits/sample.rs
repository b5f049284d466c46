/// A number type that FITS arrays hold.
pub trait Sample: Copy + Default + sealed::Sealed {
    /// BITPIX of the stored numbers.
    const BITPIX: i64;
    /// BZERO, for the unsigned type that FITS has no native form of.
    const BZERO: Option<i64> = None;
    /// Bytes of a stored number.
    const BYTES: usize = (Self::BITPIX.unsigned_abs() / 8) as usize;
    /// Appends numbers as stored: big-endian, BZERO subtracted.
    fn encode(numbers: &[Self], bytes: &mut Vec<u8>);
    /// Reads numbers as stored; the shorter of the two slices ends it.
    fn decode(bytes: &[u8], numbers: &mut [Self]);
}

mod sealed {
    pub trait Sealed {}
}

macro_rules! sample {
    ($type:ty, $bitpix:expr, $bzero:expr, $stored:ty, $to:expr, $from:expr) => {
        impl sealed::Sealed for $type {}
        impl Sample for $type {
            const BITPIX: i64 = $bitpix;
            const BZERO: Option<i64> = $bzero;
            fn encode(numbers: &[Self], bytes: &mut Vec<u8>) {
                let to: fn(Self) -> $stored = $to;
                let start = bytes.len();
                bytes.resize(start + numbers.len() * Self::BYTES, 0);
                for (stored, &number) in bytes[start..].as_chunks_mut().0.iter_mut().zip(numbers) {
                    *stored = to(number).to_be_bytes();
                }
            }
            fn decode(bytes: &[u8], numbers: &mut [Self]) {
                let from: fn($stored) -> Self = $from;
                let stored = bytes.as_chunks().0;
                for (number, &stored) in numbers.iter_mut().zip(stored) {
                    *number = from(<$stored>::from_be_bytes(stored));
                }
            }
        }
    };
}

sample!(u8, 8, None, u8, |n| n, |n| n);
// Adding 32768 to a 16-bit number flips its top bit.
sample!(u16, 16, Some(32768), u16, |n| n ^ 0x8000, |n| n ^ 0x8000);
sample!(i32, 32, None, i32, |n| n, |n| n);
sample!(f32, -32, None, f32, |n| n, |n| n);
sample!(f64, -64, None, f64, |n| n, |n| n);
