//! MD5 (RFC 1321): the checksum of frames. It holds nothing secret.

/// Turns of the four steps of each round.
const TURNS: [[u32; 4]; 4] = [[7, 12, 17, 22], [5, 9, 14, 20], [4, 11, 16, 23], [6, 10, 15, 21]];

/// The RFC's table: 2³² |sin(i + 1)|, whole.
fn table() -> [u32; 64] {
    // The RFC defines the table by this; a double has 21 bits more than it needs.
    std::array::from_fn(|i| (4_294_967_296.0 * (i as f64 + 1.0).sin().abs()) as u32)
}

/// The MD5 of bytes.
pub fn md5(bytes: &[u8]) -> [u8; 16] {
    let table = table();
    let mut message = bytes.to_vec();
    message.push(0x80);
    message.resize(message.len().next_multiple_of(64), 0);
    if bytes.len() % 64 > 55 {
        message.resize(message.len() + 64, 0);
    }
    let end = message.len() - 8;
    message[end..].copy_from_slice(&(bytes.len() as u64).wrapping_mul(8).to_le_bytes());
    let mut state = [0x6745_2301_u32, 0xefcd_ab89, 0x98ba_dcfe, 0x1032_5476];
    for block in message.chunks_exact(64) {
        let word = |i: usize| {
            let part = [block[4 * i], block[4 * i + 1], block[4 * i + 2], block[4 * i + 3]];
            u32::from_le_bytes(part)
        };
        let [mut a, mut b, mut c, mut d] = state;
        for (i, constant) in table.iter().enumerate() {
            let (mixed, which) = match i / 16 {
                0 => ((b & c) | (!b & d), i),
                1 => ((d & b) | (!d & c), (5 * i + 1) % 16),
                2 => (b ^ c ^ d, (3 * i + 5) % 16),
                _ => (c ^ (b | !d), (7 * i) % 16),
            };
            let sum = a.wrapping_add(mixed).wrapping_add(*constant).wrapping_add(word(which));
            let turned = b.wrapping_add(sum.rotate_left(TURNS[i / 16][i % 4]));
            (a, d, c, b) = (d, c, b, turned);
        }
        for (sum, part) in state.iter_mut().zip([a, b, c, d]) {
            *sum = sum.wrapping_add(part);
        }
    }
    let mut digest = [0; 16];
    for (to, from) in digest.chunks_exact_mut(4).zip(state) {
        to.copy_from_slice(&from.to_le_bytes());
    }
    digest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the test suite of RFC 1321, appendix A.5, and its first constants.
    #[test]
    fn the_rfcs_digests() {
        assert_eq!(table()[..3], [0xd76a_a478, 0xe8c7_b756, 0x2420_70db]);
        assert_eq!(table()[63], 0xeb86_d391);
        let eighty = "1234567890".repeat(8);
        let alphabet = "abcdefghijklmnopqrstuvwxyz";
        let both = format!("{}{alphabet}0123456789", alphabet.to_uppercase());
        for (text, digest) in [
            ("", "d41d8cd98f00b204e9800998ecf8427e"),
            ("a", "0cc175b9c0f1b6a831c399e269772661"),
            ("abc", "900150983cd24fb0d6963f7d28e17f72"),
            ("message digest", "f96b697d7cb7938d525a2f31aaf161d0"),
            (alphabet, "c3fcd3d76192e4007dfb496cca67e13b"),
            (&both, "d174ab98d277d9f5a5611c2c9f419d9f"),
            (&eighty, "57edf4a22be3c955ac49da2e2107b67a"),
        ] {
            let hex: String = md5(text.as_bytes()).iter().map(|b| format!("{b:02x}")).collect();
            assert_eq!(hex, digest, "{text}");
        }
    }
}
