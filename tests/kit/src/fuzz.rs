//! Fuzzing on any compiler: seeds, changed at random, are given to a reader, which must not panic.

use crate::repository;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Longest seed and longest input, bytes.
const LONGEST: usize = 64 << 10;
/// Inputs that a target gets in a run of the suite.
const FEW: u64 = 1500;
/// Seconds that a target gets in the whole campaign, where `SUNGLINT_FUZZ_S` does not say.
const WHOLE_S: u64 = 600;

/// Pieces that readers give a meaning to.
const WORDS: [&[u8]; 28] = [
    b"\n",
    b"\r\n",
    b",",
    b" ",
    b"\t",
    b"=",
    b"\"",
    b"'",
    b"<",
    b">",
    b"[",
    b"]",
    b"{",
    b"}",
    b"#",
    b"-",
    b"+",
    b"e",
    b"nan",
    b"inf",
    b"1e308",
    b"-1",
    b"0",
    b"18446744073709551615",
    b"9223372036854775808",
    b"END",
    b"\0",
    b"\xff",
];

/// A reader that is tried, with the seeds of `fixtures/fuzz/NAME`.
#[derive(Debug)]
pub struct Fuzz {
    name: &'static str,
    seeds: Vec<Vec<u8>>,
}

/// How trying a reader went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tried {
    /// Inputs that were tried.
    pub inputs: u64,
    /// Longest time that one took, s.
    pub longest_s: f64,
}

impl Fuzz {
    /// The seeds of a target.
    ///
    /// # Panics
    /// Panics where there are none.
    pub fn of(name: &'static str) -> Self {
        let fuzz = Self { name, seeds: Vec::new() }.with(&format!("fixtures/fuzz/{name}"));
        assert!(!fuzz.seeds.is_empty(), "no seeds in fixtures/fuzz/{name}");
        fuzz
    }

    /// The same with the files of another folder of the repository.
    #[must_use]
    pub fn with(mut self, folder: &str) -> Self {
        let files = std::fs::read_dir(repository().join(folder)).into_iter().flatten();
        let mut paths: Vec<PathBuf> = files.filter_map(|f| Some(f.ok()?.path())).collect();
        paths.sort();
        for path in paths {
            if let Ok(mut bytes) = std::fs::read(&path) {
                bytes.truncate(LONGEST);
                self.seeds.push(bytes);
            }
        }
        self
    }

    /// Tries the reader: the seeds, then inputs made of them, a fixed number of them or for a fixed time (`./test --campaign fuzz`).
    ///
    /// # Panics
    /// Panics where the reader does, with the file in the temporary folder that holds the input.
    pub fn run(self, target: fn(&[u8])) -> Tried {
        let whole = std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|name| name == "fuzz");
        let seconds = std::env::var("SUNGLINT_FUZZ_S").ok().and_then(|text| text.parse().ok());
        let time = Duration::from_secs(seconds.unwrap_or(WHOLE_S));
        // Other inputs in each whole campaign, the same in every run of the suite.
        let seed = if whole {
            std::time::SystemTime::now()
                .duration_since(std::time::UNIX_EPOCH)
                .map_or(2, |t| t.as_nanos() as u64)
        } else {
            1
        };
        let mut random = Random(seed ^ 0x5EED);
        let begun = Instant::now();
        let mut tried = Tried { inputs: 0, longest_s: 0.0 };
        let mut failed = None;
        for seed in &self.seeds {
            failed = failed.or_else(|| try_one(target, seed, &mut tried));
        }
        while failed.is_none() && if whole { begun.elapsed() < time } else { tried.inputs < FEW } {
            let input = self.mutated(&mut random);
            failed = try_one(target, &input, &mut tried);
        }
        if let Some((input, words)) = failed {
            let path = std::env::temp_dir().join(format!("fuzz-{}-{}", self.name, random.next()));
            let kept = std::fs::write(&path, &input);
            panic!(
                "{} panics ({words}); the input ({} bytes) is {} {kept:?}",
                self.name,
                input.len(),
                path.display()
            );
        }
        println!("fuzz {}: {} inputs, longest {:.3} s", self.name, tried.inputs, tried.longest_s);
        tried
    }

    fn mutated(&self, random: &mut Random) -> Vec<u8> {
        let pick = |random: &mut Random| &self.seeds[random.below(self.seeds.len())];
        let mut bytes = pick(random).clone();
        for _ in 0..=random.below(6) {
            let at = random.below(bytes.len() + 1);
            match random.below(12) {
                0 => {
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte ^= 1 << random.below(8);
                    }
                }
                1 => {
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte = random.next() as u8;
                    }
                }
                2 => bytes.truncate(at),
                3 => {
                    let end = (at + 1 + random.below(40)).min(bytes.len());
                    bytes.drain(at.min(end)..end);
                }
                4 => {
                    let end = (at + 1 + random.below(80)).min(bytes.len());
                    let copy = bytes[at.min(end)..end].to_vec();
                    let to = random.below(bytes.len() + 1);
                    bytes.splice(to..to, copy);
                }
                5 => {
                    let other = pick(random);
                    let from = random.below(other.len() + 1);
                    bytes.truncate(at);
                    bytes.extend_from_slice(&other[from..]);
                }
                6 | 7 => {
                    let word = WORDS[random.below(WORDS.len())];
                    bytes.splice(at..at, word.iter().copied());
                }
                8 | 9 => another_number(&mut bytes, random),
                10 => {
                    // A number of four or eight bytes.
                    let value = [0, 1, u64::MAX, 1 << 31, 1 << 63, random.next()][random.below(6)];
                    let count = if random.below(2) == 0 { 4 } else { 8 };
                    let end = (at + count).min(bytes.len());
                    let size = end.saturating_sub(at);
                    bytes[end - size..end].copy_from_slice(&value.to_le_bytes()[..size]);
                }
                _ => a_line_elsewhere(&mut bytes, random),
            }
        }
        bytes.truncate(LONGEST);
        bytes
    }
}

/// Puts another number where one stands as text.
fn another_number(bytes: &mut Vec<u8>, random: &mut Random) {
    let from = random.below(bytes.len() + 1);
    let Some(begin) = (from..bytes.len()).find(|&i| bytes[i].is_ascii_digit()) else { return };
    let is_part = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'e' | b'E');
    let end = (begin..bytes.len()).find(|&i| !is_part(&bytes[i])).unwrap_or(bytes.len());
    let number = match random.below(8) {
        0 => "0".to_owned(),
        1 => "-1".to_owned(),
        2 => "1e308".to_owned(),
        3 => "1e-320".to_owned(),
        4 => u64::MAX.to_string(),
        5 => (1_u64 << random.below(63)).to_string(),
        6 => "nan".to_owned(),
        _ => random.below(1000).to_string(),
    };
    bytes.splice(begin..end, number.into_bytes());
}

/// Doubles or moves a line.
fn a_line_elsewhere(bytes: &mut Vec<u8>, random: &mut Random) {
    let mut lines: Vec<&[u8]> = bytes.split_inclusive(|&byte| byte == b'\n').collect();
    if lines.is_empty() {
        return;
    }
    let line = lines[random.below(lines.len())];
    if random.below(2) == 0 {
        let gone = random.below(lines.len());
        lines.remove(gone);
    }
    let to = random.below(lines.len() + 1);
    lines.insert(to, line);
    *bytes = lines.concat();
}

/// Gives an input to the reader; if it panics, the input with what it said.
fn try_one(target: fn(&[u8]), input: &[u8], tried: &mut Tried) -> Option<(Vec<u8>, String)> {
    let begun = Instant::now();
    let result = std::panic::catch_unwind(|| target(input));
    tried.inputs += 1;
    tried.longest_s = tried.longest_s.max(begun.elapsed().as_secs_f64());
    let panic = result.err()?;
    let words = panic
        .downcast_ref::<String>()
        .cloned()
        .or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
    Some((input.to_vec(), words.unwrap_or_default()))
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}
