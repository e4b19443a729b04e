//! Bytes from outside: whatever they are, a reader answers with a value or an error, never with a panic, and a file
//! that promises more than it holds costs nothing. Files of that kind are in `fixtures/formats/hostile`.

use proptest::prelude::*;
use serde::Deserialize;
use std::time::{Duration, Instant};
use sunglint_formats::bsdf::{Tensor, TensorFile};
use sunglint_formats::fits::{Fits, Header, Image, Pixels, Writer};
use sunglint_formats::toml::{Document, NonNegative, Positive};
use sunglint_formats::{Column, CountSeries, Frame, Meta, Table, Values, curve, ecsv, time};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only read")]
struct Station {
    name: String,
    height_m: Option<f64>,
    channel: Vec<Channel>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only read")]
struct Channel {
    dead_time_ns: NonNegative,
    aperture_mm: Option<Positive>,
    start: Option<time::Utc>,
    mode: Option<Mode>,
    pair: Option<(u8, i64)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "only read")]
enum Mode {
    Photon,
    Analog { gain: f32 },
    Other(String),
}

const TOML: &str = "name = \"hill\"\nheight_m = 1.5e3\n[[channel]]\ndead_time_ns = 22\nstart = 2016-12-31T23:59:60Z\n\
                    mode = { Analog = { gain = 2 } }\npair = [1, 0x2]\n[[channel]]\ndead_time_ns = 0\nmode = 'Photon'\n";
const CSV: &str = "# note\nwavelength_um,qe_percent,\"x\"\n0.4,50,1\n\n0.5,75,2\n";
const ECSV: &str = "# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n# - {name: a, unit: nm, datatype: float32}\n\
                    # - {name: b, datatype: int8, description: 'x: y'}\n# - {name: c, datatype: string}\n\
                    # - {name: d, datatype: bool}\n# meta: !!omap\n# - {k: &x [1, {y: 2}]}\n# - n: *x\n\
                    # schema: astropy-2.0\na,b,c,d\n1.5,-3,\"two\nlines\",True\n,,\"\",\n";

/// Reads with everything that takes these bytes, and decodes all that decodes.
fn read_all(bytes: &[u8]) {
    if let Ok(fits) = Fits::from_bytes("x", bytes.to_vec()) {
        for i in 0..fits.hdus().len() {
            let _ = fits.image(i);
            if let Ok(table) = fits.table(i) {
                // What was read can be written, or is refused with a reason.
                let _ = Writer::new().table(&table, "X");
                let _ = ecsv::to_string(&table);
            }
        }
        let _ = Frame::from_fits(&fits);
    }
    let _ = TensorFile::from_bytes("x", bytes).map(|file| {
        let _ = file.check_material("x");
        file.to_bytes()
    });
    if let Ok(text) = str::from_utf8(bytes) {
        if let Ok(table) = ecsv::read_str("x", text) {
            let _ = CountSeries::from_table("x", &table);
            let _ = Writer::new().table(&table, "X");
        }
        let _ = curve::read_str("x", text, None);
        let _ = curve::read_str("x", text, Some("qe"));
        if let Ok(document) = Document::new("x", text) {
            let _ = document.parse::<Station>();
            let _ = document.error_at("channel[1].pair[0]", "something else");
        }
        let _ = time::parse_utc(text).map(|epoch| time::format_utc(epoch, 9));
    }
}

fn fits_image() -> Vec<u8> {
    let mut header = Header::default();
    header.set("DATE-OBS", "2026-03-04T05:06:07", "");
    header.set("EXPTIME", 0.5, "s");
    header.set("BAYERPAT", "RGGB", "");
    header.set("XBINNING", 1_i64, "");
    header.set("LONGTEXT", "long ".repeat(30), "continued");
    header.set("ESO DET DIT", 2.5, "");
    header.set("OBSERVER", "Jörg 🛰", "");
    header.history(&"\\u00f6 é ".repeat(20));
    header.set("BLANK", -5_i64, "");
    let pixels = ndarray::Array::from_shape_fn((5, 7), |(y, x)| (y * 7 + x) as u16).into_dyn();
    let mut writer = Writer::new();
    writer.image(&Image { header, pixels: Pixels::U16(pixels) }).expect("it fits");
    writer.into_bytes()
}

fn fits_table() -> Vec<u8> {
    let vectors = Values::F64((0..12).map(f64::from).collect());
    let column =
        |name: &str, values| Column { name: name.into(), unit: None, description: None, values };
    let table = Table {
        meta: Meta::new(),
        columns: vec![
            Column::f64("f", Some("nm"), vec![0.5, f64::NAN, 1.0]),
            column("i", Values::I64(vec![Some(1), None, Some(-1)])),
            column("b", Values::Bool(vec![Some(true), Some(false), None])),
            Column::text("s", vec!["x".into(), String::new(), "it's".into()]),
            column("v", Values::Vectors { width: 4, flat: Box::new(vectors) }),
        ],
    };
    let mut writer = Writer::new();
    writer.table(&table, "T").expect("it fits");
    writer.into_bytes()
}

fn tensors() -> Vec<u8> {
    let tensors = vec![
        Tensor::u8("description", *b"white"),
        Tensor::f32("theta_i", &[2], vec![0.0, 1.0]),
        Tensor::f32("vndf", &[1, 1, 2, 2], vec![1.0; 4]),
    ];
    TensorFile { tensors }.to_bytes().expect("it fits")
}

/// A valid file, changed in a few places: cut, digits and letters that mean something, or any byte.
fn mutated(good: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    const WORDS: [&[u8]; 12] = [
        b"9",
        b"-",
        b"999999999999",
        b"\xff",
        b"'",
        b"\"",
        b"P",
        b"\n",
        b"[",
        b"{",
        b"e999",
        b"18446744073709551615",
    ];
    let change = (any::<prop::sample::Index>(), any::<u8>(), 0..WORDS.len() + 2);
    (prop::collection::vec(change, 1..6), any::<prop::sample::Index>()).prop_map(
        move |(changes, cut)| {
            let mut bytes = good.clone();
            for (place, byte, kind) in changes {
                let at = place.index(bytes.len());
                match kind {
                    0 => bytes[at] = byte,
                    // The heads of binary files are where sizes are.
                    1 => bytes[at % 60.min(good.len())] = byte,
                    word => {
                        for (i, &b) in WORDS[word - 2].iter().enumerate() {
                            if at + i < bytes.len() {
                                bytes[at + i] = b;
                            }
                        }
                    }
                }
            }
            if cut.index(4) == 0 {
                bytes.truncate(cut.index(bytes.len()));
            }
            bytes
        },
    )
}

fn any_valid() -> impl Strategy<Value = Vec<u8>> {
    let files = vec![TOML.into(), CSV.into(), ECSV.into(), fits_image(), fits_table(), tensors()];
    prop::sample::select(files)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
        read_all(&bytes);
    }

    #[test]
    fn arbitrary_text(text in "[ -~\n\"'#,=\\[\\]{}:0-9é]{0,200}") {
        read_all(text.as_bytes());
        read_all(format!("# %ECSV 1.0\n# ---\n# {text}").as_bytes());
    }

    #[test]
    fn arbitrary_times(text in "[0-9]{0,5}[-T :Z.+]{0,2}[0-9]{0,3}[-T :Z.]{0,2}[0-9]{1,3}[-T :Z.]?[0-9:.Z]{0,20}") {
        if let Ok(epoch) = time::parse_utc(&text) {
            // What parses comes back as the same instant.
            prop_assert_eq!(time::parse_utc(&time::format_utc(epoch, 9)), Ok(epoch));
        }
    }

    #[test]
    fn every_instant_comes_back(nanoseconds in 2_272_060_810_000_000_000_i64..6_342_969_600_000_000_000) {
        let epoch = hifitime::Epoch::from_tai_duration(hifitime::Duration::from_total_nanoseconds(nanoseconds.into()));
        prop_assert_eq!(time::parse_utc(&time::format_utc(epoch, 9)), Ok(epoch));
        prop_assert_eq!(time::parse_utc(&time::format_utc_shortest(epoch)), Ok(epoch));
    }

    #[test]
    fn changed_files(bytes in any_valid().prop_flat_map(mutated)) {
        read_all(&bytes);
    }
}

#[test]
fn the_valid_files_are_valid() {
    // Else the test above would only try the first check of each reader.
    Document::new("x", TOML).unwrap().parse::<Station>().unwrap();
    curve::read_str("x", CSV, Some("qe")).unwrap();
    ecsv::read_str("x", ECSV).unwrap();
    Frame::from_fits(&Fits::from_bytes("x", fits_image()).unwrap()).unwrap();
    Fits::from_bytes("x", fits_table()).unwrap().table(1).unwrap();
    TensorFile::from_bytes("x", &tensors()).unwrap();
}

#[test]
fn files_that_must_be_refused() {
    let mut count = 0;
    for entry in std::fs::read_dir(sunglint_testkit::fixture("formats/hostile")).unwrap() {
        let path = entry.unwrap().path();
        let start = Instant::now();
        let refused = match path.extension().and_then(|e| e.to_str()).unwrap() {
            "fits" => Fits::read(&path).and_then(|fits| Ok(fits.table(1)?)).is_err(),
            "ecsv" => ecsv::read(&path).is_err(),
            "toml" => Document::read(&path).is_err(),
            "csv" => curve::read(&path, None).is_err(),
            "bsdf" => TensorFile::read(&path).is_err(),
            other => panic!("no reader for .{other}"),
        };
        assert!(refused, "{} was read", path.display());
        assert!(start.elapsed() < Duration::from_secs(2), "{} took long", path.display());
        read_all(&std::fs::read(&path).unwrap());
        count += 1;
    }
    assert!(count >= 14);
}

/// A FITS file of those cards and so many bytes of zeros.
fn fits_of(headers: &[&[&str]], data: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    for cards in headers {
        for card in cards.iter().chain([&"END"]) {
            bytes.extend(format!("{card:<80}").bytes());
        }
        bytes.resize(bytes.len().next_multiple_of(2880), b' ');
    }
    bytes.resize(bytes.len() + data, 0);
    bytes
}

fn fits_error(headers: &[&[&str]], data: usize) -> String {
    let start = Instant::now();
    let fits = Fits::from_bytes("f.fits", fits_of(headers, data));
    let last = headers.len() - 1;
    let error = match fits {
        Err(error) => error,
        Ok(fits) if last == 0 => fits.image(0).expect_err("it is wrong"),
        Ok(fits) => fits.table(last).expect_err("it is wrong"),
    };
    assert!(start.elapsed() < Duration::from_secs(1), "{error} took {:?}", start.elapsed());
    error.to_string()
}

const SIMPLE: &str = "SIMPLE  =                    T";

#[test]
fn fits_that_promises_too_much() {
    let image = |axes: &[&'static str], data| {
        let mut cards = vec![SIMPLE, "BITPIX  =                   16"];
        cards.extend_from_slice(axes);
        fits_error(&[&cards], data)
    };
    assert_eq!(
        image(&["NAXIS   = 1", "NAXIS1  = 1000000000000"], 2880),
        "f.fits: NAXIS1: found 2880 bytes of data, expected 2000000000000 bytes, as the header says (the file is cut off, or \
         its header is wrong)"
    );
    assert_eq!(
        image(&["NAXIS   = 2", "NAXIS1  = 1000000", "NAXIS2  = 1000000000000"], 2880),
        "f.fits: NAXIS2: found 2880 bytes of data, expected 2000000000000000000 bytes, as the header says (the file is cut \
         off, or its header is wrong)"
    );
    assert_eq!(
        image(&["NAXIS   = 2", "NAXIS1  = 1000000000000", "NAXIS2  = 1000000000000"], 2880),
        "f.fits: NAXIS1: found 2880 bytes of data, expected a size that fits into 64 bits (the file is cut off, or its header \
         is wrong)"
    );
    assert_eq!(
        image(&["NAXIS   = 2", "NAXIS1  = 100", "NAXIS2  = 50"], 2880),
        "f.fits: NAXIS1: found 2880 bytes of data, expected 10000 bytes, as the header says (the file is cut off, or its \
         header is wrong)"
    );
    assert_eq!(
        image(&["NAXIS   = 1000000000"], 2880),
        "f.fits: NAXIS: found 1000000000, expected 0 to 999 axes"
    );
    assert_eq!(
        image(&["NAXIS   = 1", "NAXIS1  = -10"], 2880),
        "f.fits: NAXIS1: found -10, expected a number of 0 or above"
    );
    assert_eq!(
        image(&["NAXIS   = 1", "NAXIS1  = 'ten'"], 2880),
        "f.fits: NAXIS1: found the text `ten`, expected a whole number"
    );
    assert_eq!(
        image(&["NAXIS   = 2", "NAXIS1  = 10"], 2880),
        "f.fits: NAXIS2: found no such card, expected a whole number"
    );
    assert_eq!(
        fits_error(&[&[SIMPLE, "BITPIX  = 17", "NAXIS   = 0"]], 0),
        "f.fits: BITPIX: found 17, expected 8, 16, 32, 64, -32 or -64"
    );
    assert_eq!(
        image(&["NAXIS   = 0"], 2880 - 80),
        "f.fits: HDU 0: found a header without data, expected an image"
    );
    assert_eq!(
        image(&["NAXIS   = 1", "NAXIS1  = 10", "PCOUNT  = 5"], 2880),
        "f.fits: PCOUNT: found 5, expected 0, for an image"
    );
    // An axis of nothing beside axes that overflow.
    assert_eq!(
        image(
            &[
                "NAXIS   = 3",
                "NAXIS1  = 0",
                "NAXIS2  = 9000000000000000000",
                "NAXIS3  = 9000000000000000000"
            ],
            0
        ),
        "f.fits: NAXIS: found axes whose product is beyond 64 bits, expected a smaller image"
    );
}

#[test]
fn fits_that_is_cut_off_or_something_else() {
    let mut bytes = fits_image();
    bytes.truncate(1000);
    let error = |bytes: &[u8]| Fits::from_bytes("f.fits", bytes.to_vec()).unwrap_err().to_string();
    assert_eq!(
        error(&bytes),
        "f.fits: HDU 0: found a header of 1000 bytes without END, expected a card END (the file is cut off)"
    );
    assert_eq!(
        error(b"P5 640 480 255 not FITS"),
        "f.fits: HDU 0: found `P5 640 48`, expected a FITS file, which begins with `SIMPLE  =`"
    );
    assert_eq!(error(b""), "f.fits: found no bytes, expected a FITS file");
    let mut bytes = fits_image();
    bytes.extend(b"left over");
    assert_eq!(error(&bytes), "f.fits: HDU 1: found `left over`, expected `XTENSION=`, or the end");
    // The padding of the last block does not matter.
    let mut bytes = fits_image();
    bytes.truncate(2880 + 5 * 7 * 2);
    assert!(!bytes.len().is_multiple_of(2880));
    assert_eq!(Fits::from_bytes("f.fits", bytes).unwrap().image(0).unwrap().pixels.shape(), [5, 7]);
}

#[test]
fn fits_tables_that_promise_too_much() {
    const PRIMARY: &[&str] = &[SIMPLE, "BITPIX  = 8", "NAXIS   = 0"];
    let table = |cards: &[&'static str], data| {
        let mut all = vec!["XTENSION= 'BINTABLE'", "BITPIX  = 8", "NAXIS   = 2"];
        all.extend_from_slice(cards);
        fits_error(&[PRIMARY, &all], data)
    };
    assert_eq!(
        table(&["NAXIS1  = 0", "NAXIS2  = 1000000000000", "TFIELDS = 0"], 0),
        "f.fits: HDU 1, NAXIS1: found rows of 0 bytes, expected at least one byte"
    );
    assert_eq!(
        table(&["NAXIS1  = 8", "NAXIS2  = 1000000000000", "TFIELDS = 1", "TFORM1  = '1D'"], 2880),
        "f.fits: HDU 1, NAXIS2: found 2880 bytes of data, expected 8000000000000 bytes, as the header says (the file is cut \
         off, or its header is wrong)"
    );
    assert_eq!(
        table(
            &[
                "NAXIS1  = 8",
                "NAXIS2  = 1",
                "TFIELDS = 1",
                "TTYPE1  = 'a'",
                "TFORM1  = '9223372036854775807D'"
            ],
            2880
        ),
        "f.fits: HDU 1, TFORM1 (a): found columns wider than the row, expected columns of 8 bytes together, as NAXIS1 says"
    );
    assert_eq!(
        table(
            &["NAXIS1  = 8", "NAXIS2  = 1", "TFIELDS = 1", "TFORM1  = '99999999999999999999D'"],
            2880
        ),
        "f.fits: HDU 1, TFORM1 (column_1): found `99999999999999999999D`, expected a format such as `1D`"
    );
    assert_eq!(
        table(&["NAXIS1  = 8", "NAXIS2  = 1", "TFIELDS = 1", "TFORM1  = '1J'"], 2880),
        "f.fits: HDU 1, NAXIS1: found 8 bytes a row, expected 4, the sum of the columns"
    );
    assert_eq!(
        table(
            &["NAXIS1  = 8", "NAXIS2  = 1", "PCOUNT  = 9223372036854775807", "GCOUNT  = 9"],
            2880
        ),
        "f.fits: HDU 1, PCOUNT: found 2880 bytes of data, expected a size that fits into 64 bits (the file is cut off, or its \
         header is wrong)"
    );
    assert_eq!(
        table(&["NAXIS1  = 8", "NAXIS2  = 1", "GCOUNT  = 0", "TFIELDS = 1", "TFORM1  = 'D'"], 2880),
        "f.fits: HDU 1, GCOUNT: found no data, expected 1, for a table"
    );
    assert_eq!(
        table(&["NAXIS1  = 8", "NAXIS2  = 1", "TFIELDS = 1000000000000"], 2880),
        "f.fits: HDU 1, TFIELDS: found 1000000000000, expected at most 999 columns"
    );
    assert_eq!(
        table(
            &[
                "NAXIS1  = 8",
                "NAXIS2  = 1",
                "TFIELDS = 1",
                "TFORM1  = 'K'",
                "TZERO1  = 9223372036854775808",
                "TTYPE1  = 'n'",
                "DUMMY   = 1"
            ],
            0
        )
        .replace("found 0 bytes", "found no bytes"),
        "f.fits: HDU 1, NAXIS1: found no bytes of data, expected 8 bytes, as the header says (the file is cut off, or its \
         header is wrong)"
    );
}

#[test]
fn unsigned_numbers_beyond_63_bits_are_refused_with_the_value() {
    let cards: &[&str] = &[
        "XTENSION= 'BINTABLE'",
        "BITPIX  = 8",
        "NAXIS   = 2",
        "NAXIS1  = 8",
        "NAXIS2  = 1",
        "TFIELDS = 1",
        "TTYPE1  = 'n'",
        "TFORM1  = 'K'",
        "TZERO1  = 9223372036854775808",
    ];
    // Eight zero bytes are 2^63 then.
    assert_eq!(
        fits_error(&[&[SIMPLE, "BITPIX  = 8", "NAXIS   = 0"], cards], 8),
        "f.fits: HDU 1, TZERO1 (n): found the value 9223372036854775808, expected at most 9223372036854775807"
    );
}

#[test]
fn deep_nesting_ends_in_an_error() {
    for text in [
        format!("a = {}1{}", "[".repeat(100_000), "]".repeat(100_000)),
        format!("a = {}1{}", "{a=".repeat(100_000), "}".repeat(100_000)),
        format!("{}b = 1", "a.".repeat(100_000)),
    ] {
        assert!(Document::new("x", text).is_err());
    }
    for text in [
        format!("# %ECSV 1.0\n# ---\n# meta: {}{}\n", "[".repeat(100_000), "]".repeat(100_000)),
        format!("# %ECSV 1.0\n# ---\n# meta: {}\n", "{a: ".repeat(100_000)),
        format!("# %ECSV 1.0\n# ---\n# meta: {}\n", "- ".repeat(100_000)),
    ] {
        assert!(ecsv::read_str("x", &text).is_err());
    }
}

#[test]
fn a_packed_file_that_unpacks_to_too_much_is_refused() {
    use std::io::Write as _;
    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    packer.write_all(&vec![0; 1 << 20]).unwrap();
    let packed = packer.finish().unwrap();
    let inflate = |most| sunglint_formats::fits::inflate("f.fits.z", packed.clone(), most);
    assert_eq!(inflate(1 << 20).unwrap().len(), 1 << 20);
    assert_eq!(
        inflate(1 << 16).unwrap_err().to_string(),
        "f.fits.z: found a packed file of more than 65536 bytes, expected at most 65536 bytes"
    );
    let mut damaged = packed.clone();
    damaged.truncate(20);
    let error = sunglint_formats::fits::inflate("f.fits.z", damaged, 1 << 20).unwrap_err();
    assert!(error.to_string().starts_with("f.fits.z: found a damaged packed file"), "{error}");
}

/// Truth: the first bytes that gzip(1), compress(1), bzip2(1), xz(1), zstd(1) and zip(1) write (each format's own document).
#[test]
fn a_file_packed_in_another_way_is_named() {
    for (bytes, name, command) in [
        (&b"\x1f\x9d\x90SI"[..], "compress", "uncompress f.fits"),
        (b"BZh91AY&SY", "bzip2", "bunzip2 f.fits"),
        (b"\xfd7zXZ\0\0\x04", "xz", "unxz f.fits"),
        (b"\x28\xb5\x2f\xfd\x04", "zstd", "unzstd f.fits"),
        (b"PK\x03\x04\x14\0", "zip", "unzip f.fits"),
    ] {
        let error = sunglint_formats::fits::inflate("f.fits", bytes.to_vec(), 1 << 20);
        let error = error.unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(command), "{error}");
    }
}
