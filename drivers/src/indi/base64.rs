//! Base64 as INDI sends BLOBs (RFC 4648, broken into lines), decoded while it arrives, so that the text is never held.

/// Entries of the decoder's table for characters without six bits: white space, padding, all others.
const SPACE: u8 = 64;
const PAD: u8 = 65;
const BAD: u8 = 66;

const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

const VALUES: [u8; 256] = {
    let mut values = [BAD; 256];
    let mut i = 0;
    while i < 64 {
        values[ALPHABET[i] as usize] = i as u8;
        i += 1;
    }
    values[b'=' as usize] = PAD;
    values[b'\n' as usize] = SPACE;
    values[b'\r' as usize] = SPACE;
    values[b' ' as usize] = SPACE;
    values[b'\t' as usize] = SPACE;
    values
};

/// Why a text is no base64.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Base64Error {
    /// A character that is not of the alphabet.
    #[error("the byte 0x{0:02x} is not of base64's alphabet")]
    Character(u8),
    /// Something behind the padding.
    #[error("characters behind the padding `=`")]
    BehindPadding,
    /// A padding where none can be.
    #[error("a padding `=` in the wrong place")]
    Padding,
    /// The last group of four is not whole.
    #[error("the last group has {0} characters instead of 4")]
    Cut(u8),
    /// Bits that no byte uses are not zero: the text was cut or spoilt.
    #[error("the last character holds bits of a byte that is not there")]
    TrailingBits,
}

/// Decodes a text piece by piece.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    bytes: Vec<u8>,
    group: u32,
    /// Characters of the group that have come, padding included.
    filled: u8,
    padding: u8,
}

impl Decoder {
    /// Returns the number of bytes decoded so far.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Whether nothing was decoded so far.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Decodes the next piece.
    ///
    /// # Errors
    /// The first character that cannot be.
    pub fn feed(&mut self, mut text: &[u8]) -> Result<(), Base64Error> {
        while let Some(rest) = self.whole_groups(text) {
            // What is not four plain characters in a row goes one by one: line ends, the end, a group across two pieces.
            let Some((&character, rest)) = rest.split_first() else { return Ok(()) };
            self.one(character)?;
            text = rest;
        }
        Ok(())
    }

    /// The fast way: groups of four characters as long as there are any. What is left; `None` at the end.
    fn whole_groups<'a>(&mut self, text: &'a [u8]) -> Option<&'a [u8]> {
        if self.filled != 0 || self.padding != 0 {
            return Some(text);
        }
        let (groups, _) = text.as_chunks::<4>();
        let mut done = 0;
        for group in groups {
            let [a, b, c, d] = group.map(|character| VALUES[usize::from(character)]);
            if (a | b | c | d) >= 64 {
                break;
            }
            let bits = u32::from(a) << 18 | u32::from(b) << 12 | u32::from(c) << 6 | u32::from(d);
            let [_, x, y, z] = bits.to_be_bytes();
            self.bytes.extend_from_slice(&[x, y, z]);
            done += 4;
        }
        text.get(done..)
    }

    fn one(&mut self, character: u8) -> Result<(), Base64Error> {
        let value = VALUES[usize::from(character)];
        match value {
            SPACE => return Ok(()),
            BAD => return Err(Base64Error::Character(character)),
            PAD if self.filled < 2 => return Err(Base64Error::Padding),
            PAD => {
                self.padding += 1;
                self.group <<= 6;
            }
            _ if self.padding > 0 => return Err(Base64Error::BehindPadding),
            bits => self.group = self.group << 6 | u32::from(bits),
        }
        self.filled += 1;
        if self.filled == 4 {
            let [_, x, y, z] = self.group.to_be_bytes();
            let kept = 3 - usize::from(self.padding);
            let bytes = [x, y, z];
            if bytes[kept..].iter().any(|&byte| byte != 0) {
                return Err(Base64Error::TrailingBits);
            }
            self.bytes.extend_from_slice(&bytes[..kept]);
            self.group = 0;
            // After a padded group nothing may come: `filled` starts again, `padding` stays.
            self.filled = 0;
        }
        Ok(())
    }

    /// The bytes, once the text is over.
    ///
    /// # Errors
    /// The last group is not whole.
    pub fn finish(self) -> Result<Vec<u8>, Base64Error> {
        match self.filled {
            0 => Ok(self.bytes),
            filled => Err(Base64Error::Cut(filled)),
        }
    }
}

/// The text of `bytes` in lines of 72 characters, as `indiserver` sends it.
pub fn encode(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len() * 37 / 27 + 8);
    for line in bytes.chunks(54) {
        for group in line.chunks(3) {
            let mut bits = [0; 4];
            bits[1..=group.len()].copy_from_slice(group);
            let bits = u32::from_be_bytes(bits);
            for (i, shift) in [18, 12, 6, 0].into_iter().enumerate() {
                let plain = i <= group.len();
                let value = (bits >> shift & 63) as usize;
                text.push(if plain { char::from(ALPHABET[value]) } else { '=' });
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(text: &[u8]) -> Result<Vec<u8>, Base64Error> {
        let mut decoder = Decoder::default();
        decoder.feed(text)?;
        decoder.finish()
    }

    /// Truth: the test vectors of RFC 4648, section 10.
    #[test]
    fn the_vectors_of_rfc_4648() {
        for (plain, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(decode(text.as_bytes()).unwrap(), plain.as_bytes());
            assert_eq!(encode(plain.as_bytes()).trim_end(), text);
        }
    }

    /// Truth: RFC 4648, sections 3.2 to 3.5: padding ends the text, unused bits are zero, other characters are refused.
    #[test]
    fn what_is_no_base64_is_named() {
        for (text, error) in [
            ("Zg=", Base64Error::Cut(3)),
            ("Zg", Base64Error::Cut(2)),
            ("Z===", Base64Error::Padding),
            ("=Zg=", Base64Error::Padding),
            ("Zg==Zg==", Base64Error::BehindPadding),
            ("Zg=a", Base64Error::BehindPadding),
            ("Zh==", Base64Error::TrailingBits),
            ("Zm9?", Base64Error::Character(b'?')),
        ] {
            assert_eq!(decode(text.as_bytes()), Err(error), "{text}");
        }
    }

    /// Truth: what was encoded, for every length up to 200 and however the text is cut.
    #[test]
    fn every_length_and_every_cut() {
        for length in 0..200_usize {
            let bytes: Vec<u8> = (0..length).map(|i| (i * 89 + length) as u8).collect();
            let text = encode(&bytes);
            assert!(text.lines().all(|line| line.len() <= 72));
            for piece in [1, 3, 7, 1000] {
                let mut decoder = Decoder::default();
                text.as_bytes().chunks(piece).for_each(|part| decoder.feed(part).unwrap());
                assert_eq!(decoder.finish().unwrap(), bytes);
            }
        }
    }
}
