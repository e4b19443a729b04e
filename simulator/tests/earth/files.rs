//! Tables as CSV, and the pass file's table `[earth]`.

use std::path::Path;
use sunglint_simulator::light::EarthAlbedo;
use sunglint_simulator::light::earth::csv;
use sunglint_simulator::pass::{Overrides, PassFile};

fn parse(text: &str) -> Result<EarthAlbedo, String> {
    csv::parse(Path::new("e.csv"), text, None).map_err(|e| e.to_string())
}

/// Four cells: two zones of two longitudes.
const FOUR: [&str; 4] = ["-45,-90,0.1", "-45,90,0.2", "45,-90,0.3", "45,90,0.4"];

fn table(rows: &[&str]) -> String {
    format!("lat_deg,lon_deg,albedo\n{}\n", rows.join("\n"))
}

/// The albedo at a place, degrees.
fn at(earth: &EarthAlbedo, lat_deg: f64, lon_deg: f64) -> f32 {
    let up = super::truth::vertical(lat_deg.to_radians(), lon_deg.to_radians());
    earth.grid().unwrap().at(up)[0]
}

/// Truth: the rows of the file, wherever they stand in it and however longitudes are counted: −90° is 270°, 180° is −180°.
#[test]
fn the_order_of_rows_and_the_count_of_longitudes_do_not_matter() {
    let one = parse(&table(&FOUR)).unwrap();
    for (lat, lon, expected) in
        [(-1.0, -1.0, 0.1), (-89.0, 1.0, 0.2), (1.0, -179.0, 0.3), (80.0, 179.0, 0.4)]
    {
        assert_eq!(at(&one, lat, lon), expected);
    }
    let mut mixed = FOUR;
    mixed.swap(0, 3);
    mixed.swap(1, 2);
    let mixed = mixed.map(|row| row.replace("-90", "270"));
    let mixed = parse(&format!(
        "# synthetic\r\n\r\nalbedo,lat_deg,lon_deg\r\n{}",
        mixed
            .iter()
            .map(|row| {
                let fields: Vec<&str> = row.split(',').collect();
                format!("{}, {} ,{}\r\n# note\r\n", fields[2], fields[0], fields[1])
            })
            .collect::<String>()
    ));
    assert_eq!(mixed.unwrap().grid(), one.grid());
    // A grid with points on the poles and a meridian that closes the map.
    let mut rows = Vec::new();
    for lat in [-90, -45, 0, 45, 90] {
        for lon in [-180_i32, -90, 0, 90, 180] {
            let value = if lon.abs() == 180 { 0.5 } else { 0.1 };
            rows.push(format!("{lat},{lon},{value}"));
        }
    }
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let closed = parse(&table(&rows)).unwrap();
    assert_eq!(closed.grid().unwrap().size(), (5, 4));
    assert_eq!(
        (at(&closed, 89.0, 170.0), at(&closed, 1.0, -140.0), at(&closed, 1.0, 130.0)),
        (0.5, 0.5, 0.1)
    );
    // Zones: no longitudes. And one spectrum for all of the Earth.
    let zones = parse("lat_deg,albedo\n-60,0.6\n0,0.2\n60,0.5\n").unwrap();
    assert_eq!(zones.grid().unwrap().size(), (3, 1));
    assert_eq!((at(&zones, -31.0, 77.0), at(&zones, -29.0, 77.0)), (0.6, 0.2));
    let spectrum = parse("wavelength_nm,albedo\n400,0.4\n800,0.2\n").unwrap();
    assert!(spectrum.grid().is_none() && (spectrum.mean_at(600.0) - 0.3).abs() < 1e-12);
    assert_eq!(spectrum.most(), 1.5 * 0.4);
    let colours = parse("lat_deg,albedo_450nm,albedo_650nm\n-45,0.1,0.2\n45,0.3,0.4\n").unwrap();
    assert_eq!((colours.layers(), colours.known_nm()), (2, (450.0, 650.0)));
}

/// Truth: the places of the faults. Each is refused with file, line, column, what was found and what to do.
#[test]
fn what_is_no_table_is_refused() {
    let with = |row: &str| table(&[&FOUR[..3], &[row]].concat());
    for (text, parts) in [
        (String::new(), &["e.csv", "no line"][..]),
        ("# nothing\n".into(), &["no line"]),
        (
            "latitude,lon_deg,albedo\n1,2,0.3\n".into(),
            &["e.csv:1", "latitude", "lat_deg,lon_deg,albedo"],
        ),
        ("lat_deg,lon_deg\n1,2\n".into(), &["e.csv:1", "albedo"]),
        ("lat_deg,albedo,albedo_450nm\n".into(), &["e.csv:1", "albedo_450nm"]),
        ("lat_deg,lat_deg,albedo\n".into(), &["e.csv:1", "lat_deg twice"]),
        ("lat_deg,albedo_450nm\n-45,0.1\n45,0.1\n".into(), &["450 nm alone", "at least two"]),
        (
            "lat_deg,albedo_650nm,albedo_450nm\n-45,0.1,0.1\n45,0.1,0.1\n".into(),
            &["450 nm after 650 nm", "increase"],
        ),
        (with("45,90"), &["e.csv:5", "2 fields", "3 fields"]),
        (with("45,90,bright"), &["e.csv:5: albedo", "bright", "a number"]),
        (with("45,90,1.01"), &["e.csv:5: albedo", "1.01", "from 0 to 1", "per cent"]),
        (with("45,90,-0.1"), &["e.csv:5: albedo", "-0.1", "NaN"]),
        (with("45,90,-9999"), &["e.csv:5: albedo", "-9999", "NaN"]),
        (with("45,90,inf"), &["e.csv:5: albedo", "inf"]),
        (with("95,90,0.4"), &["e.csv:5: lat_deg", "95°", "-90° to 90°"]),
        (with("45,400,0.4"), &["e.csv:5: lon_deg", "400°"]),
        (with(",90,0.4"), &["e.csv:5: lat_deg", "NaN"]),
        (with("45,-90,0.3"), &["e.csv:5", "twice", "each cell once"]),
        (with("45,270,0.31"), &["e.csv:5", "twice", "360° apart"]),
        (
            table(&["-45,0,0.1", "10,0,0.1", "30,0,0.1", "45,0,0.1"]),
            &["e.csv:3: lat_deg", "10°", "equal steps", "regular grid"],
        ),
        (
            with("45,90,nan"),
            &["no value for 1 of 4 cells", "45.000° north, 90.000° east", "missing = 0.3"],
        ),
        (with("45,90,"), &["no value for 1 of 4 cells"]),
        (table(&FOUR[..3]), &["no value for 1 of 4 cells"]),
        (table(&["45,0,0.1"]), &["lat_deg", "1 of them", "at least two"]),
        ("lat_deg,lon_deg,albedo\n".into(), &["lat_deg", "0 of them"]),
        (
            table(&["-45,0,0.1", "45,0,0.1", "-45,100,0.1", "45,100,0.1"]),
            &["lon_deg", "100°", "divides 360°"],
        ),
        (
            table(&["0,0,0.1", "0.001,0.001,0.1"]),
            &["180001 × 360000 cells", "8000000", "larger cells"],
        ),
        (table(&["10,0,0.1", "20,10,0.1"]), &["cells", "missing = 0.3"]),
        ("wavelength_nm,albedo\n400,0.1\n500,1.5\n".into(), &["e.csv:3: albedo", "1.5"]),
    ] {
        let Err(error) = parse(&text) else { panic!("accepted:\n{text}") };
        for part in parts {
            assert!(error.contains(part), "`{part}` is not in `{error}`, of\n{text}");
        }
    }
    let many: String = (0..17).map(|k| format!(",albedo_{}nm", 400 + 10 * k)).collect();
    let row = |lat: i32| format!("{lat}{}\n", ",0.1".repeat(17));
    let error = parse(&format!("lat_deg{many}\n{}{}", row(-45), row(45))).unwrap_err();
    assert!(error.contains("17 of them") && error.contains("at most 16"), "{error}");
}

const SCENE: &str = "target.built_in = \"lambert_sphere\"\nstation.name = \"ufo\"\ntimes.from = 2008-09-21T18:48:00Z\n\
    orbit.lines = [\"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\", \"2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\"]\n";

/// Truth: what the keys say; a table with holes gets what the file says for them, and says so.
#[test]
fn the_pass_file_says_what_the_earth_reflects() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pass.toml");
    std::fs::write(folder.path().join("e.csv"), table(&FOUR[..3])).unwrap();
    let pass = |earth: &str| {
        let file = PassFile::parse(&path, &format!("{SCENE}[earth]\n{earth}\n"));
        file.and_then(|file| file.resolve(Overrides::default())).map_err(|e| e.to_string())
    };
    let plain = pass("").unwrap();
    assert_eq!((plain.earth.mean_at(550.0), plain.earth.uncertainty()), (0.30, 0.5));
    let grey = pass("albedo = 0.2\nuncertainty = 0.1").unwrap();
    assert_eq!((grey.earth.mean_at(550.0), grey.earth.uncertainty()), (0.2, 0.1));
    assert!(grey.earth.describe().contains("0.20"), "{}", grey.earth.describe());
    let filled = pass("file = \"e.csv\"\nmissing = 0.25").unwrap();
    assert_eq!((filled.earth.grid().unwrap().missing(), filled.earth.uncertainty()), (1, 0.5));
    assert_eq!(at(&filled.earth, 1.0, 1.0), 0.25);
    assert!(filled.warnings.iter().any(|w| w.contains("1 of 4 cells") && w.contains("0.25")));
    assert!(
        filled.earth.describe().contains("2 × 2 cells, 0.10 to 0.30"),
        "{}",
        filled.earth.describe()
    );
    for (earth, parts) in [
        ("albedo = 1.2", &["earth.albedo", "1.2"][..]),
        ("albedo = 0.2\nfile = \"e.csv\"", &["earth.albedo", "not both"]),
        ("missing = 0.2", &["earth.missing", "file"]),
        ("file = \"none.csv\"", &["earth.file", "none.csv"]),
        ("file = \"e.csv\"", &["no value for 1 of 4 cells", "missing = 0.3"]),
        ("file = \"e.csv\"\nmissing = -1", &["earth.missing", "-1"]),
        ("uncertainty = 50", &["earth.uncertainty", "50"]),
        ("albdeo = 0.2", &["albdeo", "albedo"]),
    ] {
        let error = pass(earth).expect_err(earth);
        assert!(parts.iter().all(|part| error.contains(part)), "{error}, of {earth}");
    }
}
