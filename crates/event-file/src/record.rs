//! TensorFlow's record format: how messages follow one another in a file.
//!
//! | bytes | what |
//! |---|---|
//! | 8 | length of the message, little-endian |
//! | 4 | [`masked_crc32c`] of those 8 bytes |
//! | length | the message |
//! | 4 | [`masked_crc32c`] of the message |
//!
//! Source: `tensorflow/core/lib/io/record_writer.h`.

/// The CRC-32C (Castagnoli) of `bytes`, rotated and shifted, so that a checksum of data that holds checksums is no weaker.
pub fn masked_crc32c(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// A message as a whole record.
pub fn frame(message: &[u8]) -> Vec<u8> {
    let length = (message.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(message.len() + 16);
    record.extend(length);
    record.extend(masked_crc32c(&length).to_le_bytes());
    record.extend(message);
    record.extend(masked_crc32c(message).to_le_bytes());
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From RFC 3720, appendix B.4.
    #[test]
    fn the_polynomial_is_castagnolis() {
        assert_eq!(crc32c::crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c::crc32c(&[0xff; 32]), 0x62a8_ab43);
        assert_eq!(crc32c::crc32c(b"123456789"), 0xe306_9283);
    }

    /// From the `masked_crc32c` of TensorBoard 2.21.
    #[test]
    fn checksums_are_masked_as_tensorboard_masks_them() {
        assert_eq!(masked_crc32c(b""), 0xa282_ead8);
        assert_eq!(masked_crc32c(b"123456789"), 0xc78a_b0e5);
        assert_eq!(masked_crc32c(&[0xff; 32]), 0xf909_b029);
    }
}
