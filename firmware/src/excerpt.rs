//! A part of a configuration's image, without the rest in memory: what a read-back is made of.

use crate::config::Config;

/// Keeps those bytes of a stream that lie in a range.
struct Excerpt<'b> {
    /// Bytes that are still to be passed over.
    skip: usize,
    buffer: &'b mut [u8],
    kept: usize,
}

impl Excerpt<'_> {
    fn take(&mut self, bytes: &[u8]) {
        let skipped = self.skip.min(bytes.len());
        self.skip -= skipped;
        let room = self.buffer.get_mut(self.kept..).unwrap_or_default();
        let mut kept = 0;
        for (place, &byte) in room.iter_mut().zip(bytes.iter().skip(skipped)) {
            *place = byte;
            kept += 1;
        }
        self.kept += kept;
    }
}

impl<const M: usize, const P: usize, const B: usize, const K: usize> Config<M, P, B, K> {
    /// The bytes of this configuration's image from `offset` on: as many as `buffer` takes, fewer at
    /// its end, none behind it. Takes the time of a whole image.
    pub fn excerpt<'b>(&self, offset: usize, buffer: &'b mut [u8]) -> &'b [u8] {
        let mut excerpt = Excerpt { skip: offset, buffer, kept: 0 };
        self.save(&mut |bytes| excerpt.take(bytes));
        let Excerpt { buffer, kept, .. } = excerpt;
        buffer.get(..kept).unwrap_or_default()
    }

    /// Length of this configuration's image, bytes; 0 before the first build.
    #[must_use]
    pub fn image_bytes(&self) -> usize {
        let mut length = 0;
        self.save(&mut |bytes| length += bytes.len());
        length
    }

    /// The checksum at the end of this configuration's image, by which two configurations are told
    /// apart; 0 before the first build. Takes the time of a whole image.
    #[must_use]
    pub fn hash(&self) -> u32 {
        let mut last = [0; 4];
        // The checksum is written last and at once.
        self.save(&mut |bytes| last = bytes.last_chunk().copied().unwrap_or(last));
        u32::from_le_bytes(last)
    }
}
