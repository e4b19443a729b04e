//! Magnitudes of other programs' files.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::Path;
use sunglint_formats::photometry::{
    ColumnNames, Format, ObjectRows, Scale, Source, column_times, import, moment, open, read_str,
    recognise,
};
use sunglint_formats::text_table;
use sunglint_formats::time::format_utc;
use sunglint_testkit::{peer_python, run_python};

/// Blocks by the specification of ALCDEF 2.1.1 (not from a real file). Truth: JD 2455000.0 is 2009-06-17T12:00 (Meeus, table 7.A: 2451545.0 is 2000-01-01T12:00).
const ALCDEF: &str = "# made up by the standard\nSTARTMETADATA\nREVISEDDATA=FALSE\nOBJECTNUMBER=1\nOBJECTNAME=Ceres\nCONTACTNAME=A\nCONTACTINFO=b\nOBSERVERS=C\nSESSIONDATE=2009-06-17\nSESSIONTIME=12:00:00\n\
FILTER=C\nMAGBAND=V\nLTCAPP=AVERAGE\nLTCTYPE=NONE\nREDUCEDMAGS=NONE\nDIFFERMAGS=FALSE\nDELIMITER=PIPE\nENDMETADATA\nDATA=2455000.0|7.812|0.004|1.2\nDATA=2455000.25|7.9||\nENDDATA\n\
STARTMETADATA\nSESSIONDATE=2009-06-18\nFILTER=R\nMAGADJUST=-0.1\nDIFFERMAGS=TRUE\nDELIMITER=TAB\nENDMETADATA\nDATA=2455001.5\t0.5\t0.01\nENDDATA\n";

#[test]
fn alcdef_by_the_specification() {
    assert_eq!(recognise(ALCDEF), Some(Format::Alcdef));
    let read = read_str("a.txt", ALCDEF, Format::Alcdef).unwrap();
    let times: Vec<String> = read.time.iter().map(|t| format_utc(*t, 6)).collect();
    assert_eq!(
        times,
        [
            "2009-06-17T12:00:00.000000Z",
            "2009-06-17T18:00:00.000000Z",
            "2009-06-19T00:00:00.000000Z"
        ]
    );
    assert_eq!(read.magnitude, [7.812, 7.9, 0.4]);
    let sigma = read.sigma_mag.unwrap();
    assert!(sigma[0] == 0.004 && sigma[1].is_nan() && sigma[2] == 0.01);
    assert_eq!(read.filter.unwrap(), ["V", "V", "R"]);
    assert_eq!(read.session.unwrap(), ["1 2009-06-17", "1 2009-06-17", "2 2009-06-18"]);
    assert!(
        read.is_relative && read.target == "Ceres" && read.notes.len() == 2,
        "{:?}",
        read.notes
    );
    for (from, to, line) in [
        ("DELIMITER=PIPE", "DELIMITER=COMMA", "a.txt:19"),
        ("2455000.25", "55000.25", "a.txt:20"),
        ("|7.9|", "|bright|", "a.txt:20"),
        ("LTCAPP=AVERAGE", "LTCAPP=HALF", "a.txt:18"),
    ] {
        let error = read_str("a.txt", &ALCDEF.replace(from, to), Format::Alcdef).unwrap_err();
        assert!(error.to_string().starts_with(line), "{to}: {error}");
    }
}

/// Lines by the specification of TDM (503.0-B-2; layout of its example with angles and magnitudes, other numbers). Truth: day 181 of 2005 is 30 June; START means half an exposure later.
const TDM: &str = "CCSDS_TDM_VERS = 2.0\nCOMMENT made up by the standard\nCREATION_DATE = 2012-10-30T20:00\nORIGINATOR = X\nMETA_START\nTIME_SYSTEM = UTC\nPARTICIPANT_1 = SITE\nPARTICIPANT_2 = 2005-001A\n\
MODE = SEQUENTIAL\nPATH = 2,1\nINTEGRATION_INTERVAL = 2.0\nINTEGRATION_REF = START\nANGLE_TYPE = RADEC\nREFERENCE_FRAME = EME2000\nMETA_STOP\nDATA_START\nANGLE_1 = 2005-181T12:00:00.25 332.2298\n\
ANGLE_2 = 2005-181T12:00:00.25 -16.3028\nMAG = 2005-181T12:00:00.25 12.1\nMAG = 2005-06-30T12:00:10.25 12.3\nDATA_STOP\n";

#[test]
fn tdm_by_the_specification() {
    assert_eq!(recognise(TDM), Some(Format::TdmKvn));
    let read = read_str("a.tdm", TDM, Format::TdmKvn).unwrap();
    let times: Vec<String> = read.time.iter().map(|t| format_utc(*t, 3)).collect();
    assert_eq!(times, ["2005-06-30T12:00:01.250Z", "2005-06-30T12:00:11.250Z"]);
    assert_eq!(
        (read.magnitude.as_slice(), read.exposure_s),
        (&[12.1, 12.3][..], Some(vec![2.0, 2.0]))
    );
    assert_eq!((read.target.as_str(), read.notes.len()), ("2005-001A", 2));
    for (from, to, words) in [
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = MET", "TIME_SYSTEM `MET`"),
        ("MAG = 2005-181T", "MAG = 2005-381T", "2005-381T"),
        ("12.1\n", "12.1 3\n", "an epoch and a magnitude"),
        ("INTEGRATION_INTERVAL = 2.0\n", "", "INTEGRATION_INTERVAL"),
    ] {
        let error =
            read_str("a.tdm", &TDM.replace(from, to), Format::TdmKvn).unwrap_err().to_string();
        assert!(error.contains(words), "{to}: {error}");
    }
}

/// Truth: MJD 57754 is 2017-01-01T00:00. TAI and TT reach it before the leap second, when TAI − UTC was still 36 s (IERS bulletin C 52) and TT − UTC 68.184 s.
#[test]
fn julian_dates_keep_their_scale() {
    let utc = |name: &str, value: &str| {
        let table =
            text_table::read_str(Path::new("t.csv"), &format!("{name},magnitude\n{value},1\n"))
                .unwrap();
        column_times(Path::new("t.csv"), &table, &ColumnNames::default())
            .map(|t| format_utc(t.unwrap().time[0], 3))
    };
    assert_eq!(utc("mjd_utc", "57754").unwrap(), "2017-01-01T00:00:00.000Z");
    assert_eq!(utc("jd_utc", "2457754.5").unwrap(), "2017-01-01T00:00:00.000Z");
    assert_eq!(utc("mjd_tai", "57754").unwrap(), "2016-12-31T23:59:24.000Z");
    assert_eq!(utc("mjd_tt", "57754").unwrap(), "2016-12-31T23:58:51.816Z");
    assert_eq!(utc("MJD_TDB", "57754").unwrap(), "2016-12-31T23:58:51.816Z");
    assert!(utc("jd", "2457754.5").unwrap_err().to_string().contains("jd_utc"));
    assert!(utc("mjd_utc", "2457754.5").unwrap_err().to_string().contains("1972 to 2100"));
    assert!(moment(57_754, f64::NAN, Scale::Utc).is_none());
}

/// Masked times as astropy 7 writes them, in ECSV and VOTable (its own output, shortened). Truth: what astropy reads back: two rows of three have a time.
#[test]
fn rows_without_a_time_are_left_out() {
    let ecsv = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: jd_utc, datatype: float64}\n# - {name: magnitude, datatype: float64}\n# schema: astropy-2.0\n\
                jd_utc magnitude\n2460000.5 8.1\n\"\" 8.2\n2460000.50001 8.3\n";
    let fields = |kind: &str| {
        format!(
            "<?xml version=\"1.0\"?><VOTABLE version=\"1.4\" xmlns=\"http://www.ivoa.net/xml/VOTable/v1.3\"><RESOURCE type=\"results\"><TABLE>\
             <FIELD {kind}/><FIELD datatype=\"double\" name=\"magnitude\"/><DATA><TABLEDATA>"
        )
    };
    let rows = |first: &str, last: &str| {
        format!(
            "<TR><TD>{first}</TD><TD>8.1</TD></TR><TR><TD/><TD>8.2</TD></TR><TR><TD>{last}</TD><TD>8.3</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"
        )
    };
    let numbers =
        fields("datatype=\"double\" name=\"jd_utc\"") + &rows("2460000.5", "2460000.50001");
    let texts = fields("arraysize=\"19\" datatype=\"unicodeChar\" name=\"time_utc\"")
        + &rows("2023-02-25T00:00:00", "2023-02-25T00:00:01");
    for (name, text) in [("a.ecsv", ecsv), ("a.vot", &numbers), ("b.vot", &texts)] {
        let Source::Table(_, table) = open(name, text.as_bytes().to_vec()).unwrap() else {
            panic!("{name} is a table")
        };
        assert_eq!(*table.f64("magnitude").unwrap(), [8.1, 8.3], "{name}");
        let times =
            column_times(Path::new(name), &table, &ColumnNames::default()).unwrap().unwrap();
        assert_eq!(format_utc(times.time[0], 0), "2023-02-25T00:00:00Z", "{name}");
        assert!(
            times.notes.iter().any(|n| n.contains("1 row without a time")),
            "{:?}",
            times.notes
        );
    }
}

/// The message above as ccsds-ndm 3.1.1 (PyPI) wrote it in XML: it read our KVN, which is the other half of this test.
const TDM_XML: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<tdm id=\"CCSDS_TDM_VERS\" version=\"2.0\">\n  <header>\n    <COMMENT>made up by the standard</COMMENT>\n    <CREATION_DATE>2012-10-30T20:00</CREATION_DATE>\n    <ORIGINATOR>X</ORIGINATOR>\n  </header>\n  <body>\n    <segment>\n      <metadata>\n        <TIME_SYSTEM>UTC</TIME_SYSTEM>\n        <PARTICIPANT_1>SITE</PARTICIPANT_1>\n        <PARTICIPANT_2>2005-001A</PARTICIPANT_2>\n        <MODE>SEQUENTIAL</MODE>\n        <PATH>2,1</PATH>\n        <INTEGRATION_INTERVAL>2.0</INTEGRATION_INTERVAL>\n        <INTEGRATION_REF>START</INTEGRATION_REF>\n        <ANGLE_TYPE>RADEC</ANGLE_TYPE>\n        <REFERENCE_FRAME>EME2000</REFERENCE_FRAME>\n      </metadata>\n      <data>\n        <observation>\n          <EPOCH>2005-181T12:00:00.25</EPOCH>\n          <ANGLE_1>332.2298</ANGLE_1>\n        </observation>\n        <observation>\n          <EPOCH>2005-181T12:00:00.25</EPOCH>\n          <ANGLE_2>-16.3028</ANGLE_2>\n        </observation>\n        <observation>\n          <EPOCH>2005-181T12:00:00.25</EPOCH>\n          <MAG>12.1</MAG>\n        </observation>\n        <observation>\n          <EPOCH>2005-06-30T12:00:10.25</EPOCH>\n          <MAG>12.3</MAG>\n        </observation>\n      </data>\n    </segment>\n  </body>\n</tdm>\n";

#[test]
fn tdm_in_xml_says_the_same() {
    assert_eq!(recognise(TDM_XML), Some(Format::TdmXml));
    let read = read_str("a.xml", TDM_XML, Format::TdmXml).unwrap();
    assert_eq!(read, read_str("a.tdm", TDM, Format::TdmKvn).unwrap());
    for (from, to, words) in [
        ("<MAG>12.1", "<MAG>bright", "a.xml:32"),
        ("UTC</TIME", "MET</TIME", "TIME_SYSTEM `MET`"),
        ("</tdm>", "", "well-formed"),
        ("?>\n", "?>\n<!DOCTYPE tdm [<!ENTITY a \"aa\">]>\n", "definitions of a DTD"),
    ] {
        let error = read_str("a.xml", &TDM_XML.replacen(from, to, 1), Format::TdmXml).unwrap_err();
        assert!(error.to_string().contains(words), "{to}: {error}");
    }
}

/// Truth: what was put into tables that astropy 8.0.2 wrote: FITS and ECSV with a column of Time, FITS with TIMESYS, VOTables, and EOSSA laid out as published writers do.
#[test]
fn tables_that_astropy_writes() {
    let Some(python) = peer_python("tables_that_astropy_writes", &["astropy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = "
import sys, numpy as np
from astropy.table import Table
from astropy.time import Time
from astropy.io import fits
f = sys.argv[1] + '/'
utc = Time(['2021-03-01T19:02:11.5', '2021-03-02T04:11:48.25', '2016-12-31T23:59:60.5'], scale='utc')
Table({'time': utc, 'mag': [5.4, 6.0, 7.25], 'mag_err': [.1, .2, .3]}).write(f + 'time.fits')
Table({'time': utc, 'mag': [5.4, 6.0, 7.25], 'mag_err': [.1, .2, .3]}).write(f + 'time.ecsv')
t = Table({'MJD': utc.tt.mjd, 'Vmag': [5.4, 6.0, 7.25]}); t.meta['TIMESYS'] = 'TT'; t.write(f + 'tt.fits')
Table({'jd': utc[:2].jd, 'Vmag': [5.4, 6.0]}).write(f + 'none.vot', format='votable')
Table({'jd_utc': utc[:2].jd, 'flux': [100., 10.], 'flux_err': [1., 1.]}).write(f + 'flux.vot', format='votable')
Table({'jd_utc': utc[:2].jd, 'mag': [1., 2.]}).write(f + 'binary.vot', format='votable', tabledata_format='binary2')
c = lambda n, form, a, **k: fits.Column(n, form, array=a, **k)
iso = lambda *a: np.array(a)
h = fits.BinTableHDU.from_columns([
  c('UTC_Begin_exp', '23A', iso('2021-03-01T19:02:10.500', 'NULLSTRING')), c('UTC_End_Exp', '23A', iso('2021-03-01T19:02:12.500', 'NULLSTRING')),
  c('JD_Mid_Exp', 'D', np.array([2459275.5, utc[1].jd])), c('Exp_Duration', 'D', np.array([2.0, 2.0])), c('Cur_Spec_Filt_Num', 'J', np.array([1, 2])),
  c('Mag_Exo_Atm', 'D', np.array([5.4, -9999.0])), c('Mag_Exo_Atm_Unc', 'D', np.array([0.05, -9999.0])), c('Tel_Obj_Range', 'D', np.array([36.0e6, -9999.0]), unit='m')])
for k, v in dict(VERS='3.1.1', OBSEPH='GROUND', OBJECT='GALAXY 15', SPFNUM=2, SPFNAM1='V', SPFNAM2='R').items(): h.header[k] = v
fits.HDUList([fits.PrimaryHDU(), h]).writeto(f + 'eossa.fits')
";
    run_python(&python, script, &[folder.path().to_str().unwrap()]);
    let source = |name: &str| {
        let path = folder.path().join(name);
        let bytes = std::fs::read(&path).unwrap();
        open(&path, bytes)
    };
    let table = |name: &str| match source(name).unwrap() {
        Source::Table(_, table) => *table,
        other => panic!("{name}: {other:?}"),
    };
    let truth = [
        "2021-03-01T19:02:11.500000Z",
        "2021-03-02T04:11:48.250000Z",
        "2016-12-31T23:59:60.500000Z",
    ];
    let names = ColumnNames::default();
    for (name, digits) in [("time.fits", 6), ("time.ecsv", 6), ("tt.fits", 4)] {
        let table = table(name);
        let times = column_times(Path::new(name), &table, &names).unwrap().unwrap();
        for (time, truth) in times.time.iter().zip(truth) {
            let found = format_utc(*time, digits);
            // A date in one double is good to some microseconds.
            assert_eq!(found[..found.len() - 1], truth[..found.len() - 1], "{name}");
        }
        let magnitude = names.magnitude_of(&table).unwrap();
        assert_eq!(table.f64(magnitude).unwrap().to_vec(), [5.4, 6.0, 7.25], "{name}");
        assert_eq!(names.sigma_of(&table, false).is_some(), name != "tt.fits");
    }
    // Nothing names the scale: it is not guessed, but it can be said.
    let none = table("none.vot");
    let error = column_times(Path::new("none.vot"), &none, &names).unwrap_err().to_string();
    assert!(error.contains("--time-scale"), "{error}");
    let mut said = ColumnNames::default();
    said.scale = Some(Scale::Utc);
    let times = column_times(Path::new("none.vot"), &none, &said).unwrap().unwrap();
    assert_eq!(format_utc(times.time[1], 3), "2021-03-02T04:11:48.250Z");
    let flux = table("flux.vot");
    assert_eq!((names.magnitude_of(&flux), names.flux_of(&flux)), (None, Some("flux")));
    assert_eq!(names.sigma_of(&flux, true), Some("flux_err"));
    let binary = table("binary.vot");
    let times = column_times(Path::new("binary.vot"), &binary, &names).unwrap().unwrap();
    assert_eq!(format_utc(times.time[1], 3), "2021-03-02T04:11:48.250Z");
    let Source::Samples(format, read) = source("eossa.fits").unwrap() else { panic!("a table") };
    assert_eq!((format, read.target.as_str()), (Format::Eossa, "GALAXY 15"));
    assert_eq!(format_utc(read.time[0], 3), "2021-03-01T19:02:11.500Z");
    assert_eq!(format_utc(read.time[1], 3), "2021-03-02T04:11:48.250Z");
    assert!(read.magnitude[0] == 5.4 && read.magnitude[1].is_nan());
    assert_eq!(read.range_km.unwrap()[0], 36_000.0);
    assert_eq!(read.filter.unwrap(), ["V", "R"]);
}

/// Truth: the samples that were written, as ccsds-ndm 3.1.1 reads them (`tests/peers/tdm_readers.py`; ccsds-ndm-py 0.0.9 and Orekit 13.1.9, run by hand, read the same). Tolerance: the microseconds that are written.
#[test]
fn a_written_tdm_is_read_by_another_program() {
    use sunglint_formats::photometry::{Photometry, write};
    let Some(python) =
        peer_python("a_written_tdm_is_read_by_another_program", &["ccsds_ndm", "xsdata"])
    else {
        return;
    };
    let days = [(57_753, 0.75), (59_274, 0.0), (59_274, 0.25)];
    let made = Photometry {
        time: days.map(|(day, part)| moment(day, part, Scale::Utc).unwrap()).to_vec(),
        magnitude: vec![7.25, 5.4, 6.0125],
        sigma_mag: Some(vec![0.1, f64::NAN, 0.05]),
        filter: Some(["R", "V", "V"].map(str::to_owned).to_vec()),
        target: "2005-001A".into(),
        ..Photometry::default()
    };
    let mut sender = write::Sender::default();
    sender.originator = "A group".into();
    sender.site = "UFO".into();
    let path = std::env::temp_dir().join(format!("sunglint-written-{}.tdm", std::process::id()));
    std::fs::write(&path, write::tdm(&made, &sender).unwrap()).unwrap();
    let script = sunglint_testkit::repository().join("tests/peers/tdm_readers.py");
    let out = std::process::Command::new(python).arg(script).arg(&path).output().unwrap();
    std::fs::remove_file(&path).unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{said}");
    let rows: Vec<(String, f64)> = serde_json::from_slice(&out.stdout).unwrap();
    let expected = [
        ("2016-12-31T18:00:00.000000", 7.25),
        ("2021-03-01T00:00:00.000000", 5.4),
        ("2021-03-01T06:00:00.000000", 6.0125),
    ];
    assert_eq!(rows, expected.map(|(time, magnitude)| (time.to_owned(), magnitude)));
}

/// Truth: the samples that were written. Read back by us, and by a reader of ALCDEF written here from the standard alone.
#[test]
fn what_is_written_is_read_back() {
    use sunglint_formats::photometry::{Photometry, write};
    let days = [(59_274, 0.793_188_657_4), (59_275, 0.174_864_004_6), (57_753, 0.25)];
    let time = days.map(|(day, part)| moment(day, part, Scale::Utc).unwrap()).to_vec();
    let mut made = Photometry {
        time,
        magnitude: vec![5.4, 6.0125, 7.25],
        sigma_mag: Some(vec![0.05, f64::NAN, 0.1]),
        session: Some(["1", "1", "2"].map(str::to_owned).to_vec()),
        filter: Some(["V", "V", "R"].map(str::to_owned).to_vec()),
        exposure_s: Some(vec![2.0, 2.0, 2.0]),
        target: "2005-001A\nü".into(),
        ..Photometry::default()
    };
    let mut sender = write::Sender::default();
    sender.originator = "A group".into();
    sender.site = "UFO".into();
    let text = write::tdm(&made, &sender).unwrap();
    let read = read_str("a.tdm", &text, Format::TdmKvn).unwrap();
    // The earlier session comes first.
    assert_eq!(read.magnitude, [7.25, 5.4, 6.0125]);
    assert_eq!(read.exposure_s, Some(vec![2.0; 3]));
    for (k, i) in [2, 0, 1].into_iter().enumerate() {
        let off = (read.time[k] - made.time[i]).to_seconds().abs();
        assert!(off < 1e-6, "{off} s");
    }
    assert!(
        text.contains("PARTICIPANT_2 = 2005-001A__\n") && text.contains("COMMENT filter: V\n"),
        "{text}"
    );
    let text = write::alcdef(&made, &sender).unwrap();
    let read = read_str("a.txt", &text, Format::Alcdef).unwrap();
    assert_eq!(read.magnitude, [7.25, 5.4, 6.0125]);
    for (k, i) in [2, 0, 1].into_iter().enumerate() {
        let off = (read.time[k] - made.time[i]).to_seconds().abs();
        assert!(off < 1e-5, "{off} s");
    }
    // By the standard's words: required keys, lines of at most 255 characters, no exponent, JD = MJD + 2400000.5.
    let required = [
        "CONTACTNAME",
        "CONTACTINFO",
        "DELIMITER",
        "DIFFERMAGS",
        "FILTER",
        "LTCAPP",
        "LTCTYPE",
        "MAGBAND",
        "OBJECTNUMBER",
        "OBSERVERS",
        "REDUCEDMAGS",
        "SESSIONDATE",
        "SESSIONTIME",
    ];
    assert_eq!(text.matches("STARTMETADATA").count(), 2);
    for key in required {
        assert_eq!(text.matches(&format!("\n{key}=")).count(), 2, "{key}: {text}");
    }
    assert!(text.lines().all(|l| l.len() <= 255 && l.is_ascii()));
    assert!(text.contains("DATA=2457753.7500000000|7.2500|0.1000|\n"), "{text}");
    // Others' programs look for a third and a fourth field without counting: an uncertainty that is not known leaves its field empty.
    assert!(text.contains("|6.0125||\n"), "{text}");
    assert!(write::tdm(&Photometry::default(), &sender).is_err());
    made.is_relative = true;
    assert!(
        write::tdm(&made, &sender).is_err()
            && write::alcdef(&made, &sender).unwrap().contains("DIFFERMAGS=TRUE")
    );
}

/// Truth: what the tests of `dnl-blkv/alcdef-php` expect of the same file, and the rows as they stand there; JD 2451425.5 is 1999-09-04T00:00 (Meeus, table 7.A: 2451544.5 is 2000-01-01T00:00). Written again, the rows have the same numbers.
///
/// The written file was read by hand with two programs of others: `alcdef2json` of D. Belyakov (all rows, no unknown key) and `read_alcdef` of `dirac-institute/CometGPs` (largest difference 0).
#[test]
fn sessions_of_the_database_are_read() {
    use sunglint_formats::photometry::write;
    let folder = sunglint_testkit::repository().join("fixtures/photometry");
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let zachia = text("alcdef_zachia.txt");
    assert_eq!(recognise(&zachia), Some(Format::Alcdef));
    let read = read_str("zachia.txt", &zachia, Format::Alcdef).unwrap();
    assert_eq!(
        (read.target.as_str(), read.magnitude.len(), read.is_relative),
        ("Zachia", 35, false)
    );
    assert_eq!((read.magnitude[0], read.magnitude[34]), (13.192, 13.274));
    assert_eq!(read.sigma_mag.as_ref().map(|s| (s[0], s[26])), Some((0.008, 0.042)));
    // 0.113960 d and 0.328090 d after midnight.
    let times = [0, 34].map(|i| format_utc(read.time[i], 3));
    assert_eq!(times, ["1999-09-04T02:44:06.144Z", "1999-09-04T07:52:26.976Z"]);
    // Cut within its last magnitude the number is another one: nothing but the missing end of the line tells.
    let at = zachia.rfind("13.274").unwrap();
    let cut = read_str("cut.txt", &zachia[..at + 4], Format::Alcdef).unwrap();
    assert_eq!(cut.magnitude[34], 13.2);
    assert!(cut.notes.iter().any(|n| n.contains("no ENDDATA follows")), "{:?}", cut.notes);
    assert!(read.notes.iter().all(|n| !n.contains("ENDDATA")), "{:?}", read.notes);
    // MAGBAND, the band of the magnitudes; FILTER is what stood before the camera.
    assert_eq!(read.filter.as_ref().map(|f| f[0].as_str()), Some("R"));
    let written = write::alcdef(&read, &write::Sender::default()).unwrap();
    let rows = |text: &str| -> Vec<[f64; 3]> {
        let rows = text.lines().filter_map(|l| l.strip_prefix("DATA="));
        rows.map(|l| [0, 1, 2].map(|k| l.split('|').nth(k).unwrap().parse().unwrap())).collect()
    };
    assert_eq!(rows(&written), rows(&zachia));
    // Two sessions without an ENDDATA between them.
    let ceres = read_str("ceres.txt", &text("alcdef_ceres.txt"), Format::Alcdef).unwrap();
    assert_eq!(
        ceres.magnitude,
        [7.328, 7.317, 7.317, 7.277, 7.311, 7.189, 7.185, 7.193, 7.183, 7.186]
    );
    let sessions = ceres.session.unwrap();
    assert!(sessions[4] != sessions[5] && sessions[0] == sessions[4], "{sessions:?}");
    assert_eq!(format_utc(ceres.time[0], 3), "2011-09-13T05:39:44.957Z");
}

/// Truth: half of an exposure of 60 s, after EXPJD of ALCDEF 2.1 (START, MID, END); programs write `NONE` too.
#[test]
fn alcdef_times_are_those_of_the_middle() {
    let read = |exposure: &str| {
        let text = ALCDEF.replacen("FILTER=C", &format!("{exposure}FILTER=C"), 1);
        let read = read_str("a.txt", &text, Format::Alcdef).unwrap();
        (format_utc(read.time[0], 3), format_utc(read.time[2], 3), read.notes.len())
    };
    let other = || "2009-06-19T00:00:00.000Z".to_owned();
    for (exposure, truth, notes) in [
        ("EXPOSURE=60\nEXPJD=START\n", "2009-06-17T12:00:30.000Z", 3),
        ("EXPOSURE=60\nEXPJD=END\n", "2009-06-17T11:59:30.000Z", 3),
        ("EXPOSURE=60\nEXPJD=MID\n", "2009-06-17T12:00:00.000Z", 2),
        ("EXPOSURE=-99\nEXPJD=START\n", "2009-06-17T12:00:00.000Z", 3),
        ("EXPOSURE=60\nEXPJD=NONE\n", "2009-06-17T12:00:00.000Z", 3),
    ] {
        assert_eq!(read(exposure), (truth.to_owned(), other(), notes), "{exposure}");
    }
}

#[test]
fn alcdef_of_two_objects_is_no_curve() {
    let second = |lines: &str| {
        let text =
            ALCDEF.replacen("SESSIONDATE=2009-06-18", &format!("{lines}SESSIONDATE=2009-06-18"), 1);
        read_str("a.txt", &text, Format::Alcdef)
    };
    let error = second("OBJECTNUMBER=4\nOBJECTNAME=Vesta\n").unwrap_err().to_string();
    assert!(error.contains("OBJECTNAME=Vesta after Ceres"), "{error}");
    assert_eq!(second("OBJECTNUMBER=1\nOBJECTNAME=(1) Ceres\n").unwrap().target, "Ceres");
}

/// Truth: CORRECTION_MAG, PATH and COMMENT by CCSDS 503.0-B-2, tables 3-3 and 3-4.
#[test]
fn tdm_corrections_and_targets() {
    let read = |lines: &str| {
        let text = TDM.replace("META_STOP", &format!("{lines}META_STOP"));
        read_str("a.tdm", &text, Format::TdmKvn)
    };
    let applied = read("CORRECTION_MAG = 0.5\nCORRECTIONS_APPLIED = YES\n").unwrap();
    assert_eq!((applied.magnitude, applied.notes.len()), (vec![12.1, 12.3], 2));
    let asked = read("CORRECTION_MAG = 0.5\nCORRECTIONS_APPLIED = NO\nCOMMENT\ttab\n").unwrap();
    assert!((asked.magnitude[0] - 12.6).abs() < 1e-12 && asked.notes.len() == 3, "{asked:?}");
    let error = read("CORRECTION_MAG = 0.5\n").unwrap_err().to_string();
    assert!(error.contains("CORRECTIONS_APPLIED"), "{error}");
    // The light's path begins at the target, whichever its number.
    let turned = TDM
        .replace("PARTICIPANT_1 = SITE", "PARTICIPANT_1 = 2005-001A")
        .replace("PARTICIPANT_2 = 2005-001A", "PARTICIPANT_2 = SITE")
        .replace("PATH = 2,1", "PATH = 1,2");
    assert_eq!(read_str("a.tdm", &turned, Format::TdmKvn).unwrap().target, "2005-001A");
    let segment = TDM[TDM.find("META_START").unwrap()..].replace("2005-001A", "1998-067A");
    let error = read_str("a.tdm", &format!("{TDM}{segment}"), Format::TdmKvn).unwrap_err();
    assert!(
        error.to_string().contains("magnitudes of 1998-067A after those of 2005-001A"),
        "{error}"
    );
}

/// Truth: the same answer of the Gaia archive as TABLEDATA (both from astroquery's tests).
#[test]
fn votable_of_an_archive_in_binary2() {
    let table = |name: &str| {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/formats/votable").join(name);
        match open(&path, std::fs::read(&path).unwrap()).unwrap() {
            Source::Table("VOTable", table) => *table,
            other => panic!("{name}: {other:?}"),
        }
    };
    let (binary, plain) = (table("gaia_binary2.vot"), table("gaia_tabledata.vot"));
    for name in ["my_votable_fits_oid", "ra", "dec"] {
        assert_eq!(binary.f64(name).unwrap(), plain.f64(name).unwrap(), "{name}");
    }
    // All digits of a long count: it is a name.
    let ids = binary.i64("source_id").unwrap();
    assert_eq!(ids, [Some(3_834_447_128_563_320_320), Some(3_834_447_162_923_057_280)]);
}

/// Truth: what was put into VOTables that astropy 8.0.2 wrote in each of the three ways, with missing values, and times that it made of the numbers of a header as Kepler's and X-ray missions
/// have it (synthetic numbers).
#[test]
fn votables_and_origins_that_astropy_writes() {
    let name = "votables_and_origins_that_astropy_writes";
    let Some(python) = peer_python(name, &["astropy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = "
import sys, numpy as np
from astropy.table import Table, MaskedColumn
from astropy.time import Time
from astropy.io import fits
from astropy.io.votable import from_table
f = sys.argv[1] + '/'
t = Table({'jd_utc': [2459275.25, 2459276.5], 'mag': MaskedColumn(np.array([5.5, 6.25], 'f4'), mask=[False, True]),
  'variable': [True, False], 'n': MaskedColumn(np.array([7, -8], 'i2'), mask=[True, False]), 'band': ['V', 'Rc'], 'word': np.array(['α', 'be'], dtype='U4'),
  'row': np.arange(6, dtype='i4').reshape(2, 3)})
for kind in ['tabledata', 'binary', 'binary2']:
    v = from_table(t)
    v.get_first_table().get_field_by_id_or_name('n').values.null = -32768
    v.to_xml(f + kind + '.vot', tabledata_format=kind)
def table(name, columns, **cards):
    h = fits.BinTableHDU.from_columns(columns)
    for k, v in cards.items(): h.header[k] = v
    fits.HDUList([fits.PrimaryHDU(), h]).writeto(f + name)
c = lambda n, form, a, **k: fits.Column(n, form, array=np.array(a), **k)
table('kepler.fits', [c('TIME', 'D', [169.51998136, np.nan, 1325.29454859], unit='BJD - 2454833'), c('SAP_FLUX', 'E', [100, np.nan, 50]), c('SAP_FLUX_ERR', 'E', [1, np.nan, 2]),
  c('QUALITY', 'J', [0, 16, 0])], TIMEREF='SOLARSYSTEM', TIMESYS='TDB', BJDREFI=2454833, BJDREFF=0.25, TIMEUNIT='d', TIMEPIXR=0.5)
table('xray.fits', [c('TIME', 'D', [6.26069341e8, 6.26069441e8], unit='s'), c('RATE', 'E', [3, 4]), c('ERROR', 'E', [.5, .5])],
  TIMEREF='LOCAL', TIMESYS='TT', MJDREF=51543.875, TIMEZERO=10.0, TIMEUNIT='s', TIMEPIXR=0.0, TIMEDEL=100.0)
table('none.fits', [c('TIME', 'D', [1., 2.], unit='s'), c('RATE', 'E', [3, 4])])
table('unknown.fits', [c('TIME', 'D', [1., 2.], unit='s'), c('RATE', 'E', [3, 4])], MJDREFI=51543, TIMESYS='LOCAL')
for t in [Time(2454833.25, [169.51998136, 1325.29454859], format='jd', scale='tdb'), Time(51543.875, np.array([6.26069341e8, 6.26069441e8]) / 86400 + 60 / 86400, format='mjd', scale='tt')]:
    for x in t.utc.isot: print(x)
";
    let printed = run_python(&python, script, &[folder.path().to_str().unwrap()]);
    let truth: Vec<&str> = printed.lines().collect();
    let table = |name: &str| {
        let path = folder.path().join(name);
        match open(&path, std::fs::read(&path).unwrap()).unwrap() {
            Source::Table(_, table) => *table,
            other => panic!("{name}: {other:?}"),
        }
    };
    for kind in ["tabledata.vot", "binary.vot", "binary2.vot"] {
        let read = table(kind);
        assert_eq!(read.f64("jd_utc").unwrap().to_vec(), [2_459_275.25, 2_459_276.5], "{kind}");
        let magnitude = read.f64("mag").unwrap();
        assert!(magnitude[0] == 5.5 && magnitude[1].is_nan(), "{kind}");
        let n = read.f64("n").unwrap();
        assert!(n[0].is_nan() && n[1] == -8.0, "{kind}");
        assert_eq!(read.bool("variable").unwrap(), [Some(true), Some(false)], "{kind}");
        let band: Vec<_> = read.text("band").unwrap().iter().flatten().collect();
        assert_eq!(band, ["V", "Rc"], "{kind}");
        assert_eq!(read.text("word").unwrap()[0].as_deref(), Some("α"), "{kind}");
    }
    let names = ColumnNames::default();
    let times = |name: &str| column_times(Path::new(name), &table(name), &names);
    let kepler = table("kepler.fits");
    let read = times("kepler.fits").unwrap().unwrap();
    let found: Vec<String> = read.time.iter().map(|t| format_utc(*t, 3)).collect();
    // A day in a double since the origin is good to some nanoseconds, TDB here to 10 µs.
    assert_eq!(found, truth[..2].iter().map(|t| format!("{t}Z")).collect::<Vec<_>>());
    assert_eq!(
        (names.flux_of(&kepler), names.sigma_of(&kepler, true)),
        (Some("SAP_FLUX"), Some("SAP_FLUX_ERR"))
    );
    assert_eq!(kepler.f64("SAP_FLUX").unwrap().to_vec(), [100.0, 50.0]);
    assert!(read.notes.iter().any(|n| n == "1 row without a time left out"), "{:?}", read.notes);
    assert!(read.notes.iter().any(|n| n.contains("barycentre")), "{:?}", read.notes);
    let read = times("xray.fits").unwrap().unwrap();
    let found: Vec<String> = read.time.iter().map(|t| format_utc(*t, 3)).collect();
    assert_eq!(found, truth[2..].iter().map(|t| format!("{t}Z")).collect::<Vec<_>>());
    assert_eq!(names.sigma_of(&table("xray.fits"), true), Some("ERROR"));
    assert!(times("none.fits").unwrap_err().to_string().contains("TIME"));
    assert!(times("unknown.fits").unwrap_err().to_string().contains("`LOCAL`"));
}

/// Truth: what stands in the text.
#[test]
fn words_between_blanks_and_names_in_comments() {
    let read = |text: &str| open("a.txt", text.as_bytes().to_vec()).map_err(|e| e.to_string());
    let table = |text: &str| match read(text) {
        Ok(Source::Table(_, table)) => *table,
        other => panic!("{text}: {other:?}"),
    };
    let texts = [
        "# a night\njd_utc  mag\terr band\n2459275.25 5.5 0.1 V\n\n2459276.5  6.25  nan  \"R\"\n",
        "# a night\n# jd_utc mag err band\n2459275.25 5.5 0.1 V\n# seeing 2\"\n2459276.5 6.25 nan R\n",
        "#jd_utc,mag,err,band\n2459275.25,5.5,0.1,V\n2459276.5,6.25,,R\n",
    ];
    for text in texts {
        let table = table(text);
        assert_eq!(table.f64("mag").unwrap().to_vec(), [5.5, 6.25], "{text}");
        assert!(table.f64("err").unwrap()[1].is_nan(), "{text}");
        let band: Vec<_> = table.text("band").unwrap().iter().flatten().collect();
        assert_eq!(band, ["V", "R"], "{text}");
        assert_eq!(ColumnNames::default().sigma_of(&table, false), Some("err"));
    }
    for (text, words) in [
        ("2459275.25 5.5\n2459276.5 6.25\n", "a.txt:1: found `2459275.25 5.5`, expected names"),
        ("# jd mag err\n2459275.25 5.5\n", "expected names"),
        ("1,2\n3,4\n", "expected names"),
        ("date mag\n2021-03-01 19:02:11 5.5 7\n", "a.txt:2: found 4 words, expected 2"),
        ("mag mag\n1 2\n", "`mag` twice"),
        ("<?xml version=\"1.0\"?>\n<VODML/>\n", "XML of another kind"),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}

/// Truth: MJD 55197 is 2010-01-01 (Meeus: JD 2455197.5); the column's own TIMESYS counts, not the first of the document.
#[test]
fn votable_columns_refer_to_their_time_system() {
    let text = |timescale: &str| {
        format!(
            "<VOTABLE version=\"1.4\"><RESOURCE><TIMESYS ID=\"a\" timescale=\"TT\" timeorigin=\"JD-origin\" refposition=\"TOPOCENTER\"/><TIMESYS ID=\"b\" timescale=\"{timescale}\" timeorigin=\"2455197.5\" refposition=\"BARYCENTER\"/>\
             <TABLE><FIELD name=\"obs_time\" datatype=\"double\" unit=\"d\" ref=\"b\"/><FIELD name=\"mag\" datatype=\"float\"/><DATA><TABLEDATA><TR><TD>1.5</TD><TD>5</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"
        )
    };
    let times = |timescale: &str| {
        let Source::Table(_, table) = open("a.vot", text(timescale).into_bytes()).unwrap() else {
            panic!("no table")
        };
        column_times(Path::new("a.vot"), &table, &ColumnNames::default())
    };
    let read = times("UTC").unwrap().unwrap();
    assert_eq!(format_utc(read.time[0], 3), "2010-01-02T12:00:00.000Z");
    assert!(read.notes.iter().any(|n| n.contains("BARYCENTER")), "{:?}", read.notes);
    assert_eq!(format_utc(times("TAI").unwrap().unwrap().time[0], 3), "2010-01-02T11:59:26.000Z");
    assert!(times("TCB").unwrap_err().to_string().contains("`TCB`"));
}

/// Tables as people have them (synthetic). Truth: 2024-03-05T18:00:00 UTC and two seconds later, 7.25 and 7.5 mag: JD 2460375.25 and MJD 60374.75 (Meeus, algorithm of chapter 7), Unix time
/// 1709661600 (date -u -d 2024-03-05T18:00Z +%s).
mod made_by_others {
    use super::*;
    use sunglint_formats::photometry::{Import, ObjectRows, TimeFormat, import, write};

    fn read_as(bytes: &[u8], names: &ColumnNames) -> Result<Import, String> {
        import("t.txt", bytes.to_vec(), names, &ObjectRows::One).map_err(|error| error.to_string())
    }

    fn names(change: impl Fn(&mut ColumnNames)) -> ColumnNames {
        let mut names = ColumnNames::default();
        change(&mut names);
        names
    }

    fn read(text: &str) -> Result<Import, String> {
        read_as(text.as_bytes(), &ColumnNames::default())
    }

    fn holds(found: &Import, digits: usize) {
        let times: Vec<String> = found.samples.time.iter().map(|t| format_utc(*t, 9)).collect();
        let truth = ["2024-03-05T18:00:00.000000000Z", "2024-03-05T18:00:02.000000000Z"];
        let near = |text: &str, truth: &str| {
            let apart = sunglint_formats::time::parse_utc(text).unwrap()
                - sunglint_formats::time::parse_utc(truth).unwrap();
            apart.to_seconds().abs() < 10f64.powi(-(digits as i32))
        };
        assert!(times.iter().zip(truth).all(|(t, truth)| near(t, truth)), "{times:?}");
        assert_eq!(times.len(), 2);
        assert_eq!(found.samples.magnitude, [7.25, 7.5]);
    }

    /// Truth: by hand; 5 March is day 31 + 29 + 5 of the leap year 2024. All countries that write dots write the day first (Unicode CLDR 46, `d.M.y` in each such locale).
    #[test]
    fn dates_with_the_day_first_and_of_the_year() {
        for text in [
            "date,mag\n05.03.2024 18:00:00,7.25\n05.03.2024 18:00:02,7.5\n",
            "date;mag\n5.3.2024 18:00:00;7,25\n5.3.2024 18:00:02,0;7,5\n",
            "date mag\n05.03.2024 18:00:00 7.25\n05.03.2024 18:00:02 7.5\n",
            "date,time,mag\n05.03.2024,18:00:00,7.25\n05.03.2024,18:00:02,7.5\n",
            "date,mag\n05.03.2024 20:00:00+02:00,7.25\n05.03.2024T18:00:02Z,7.5\n",
            "time_utc,mag\n2024-065T18:00:00,7.25\n2024-065T18:00:02.0,7.5\n",
            "time_utc mag\n2024-065 18:00:00 7.25\n2024-065 18:00:02 7.5\n",
            "time_utc;mag\n2024-065T20:00:00+02:00;7,25\n2024-065T18:00:02Z;7,5\n",
            "date,time,mag\n2024-065,18:00:00,7.25\n2024-065,18:00:02,7.5\n",
        ] {
            let found = read(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            holds(&found, 9);
        }
        for (date, words) in [
            ("03/04/2021 20:31:05", "the day or the month may be the first of them"),
            ("25/03/2021 20:31:05", "2021-04-03"),
            ("3/4/21 20:31:05", "the day or the month may be the first of them"),
            ("03-04-2021 20:31:05", "the day or the month may be the first of them"),
            ("29.02.2021 20:31:05", "a day of the calendar"),
            ("25.13.2021 20:31:05", "a day of the calendar"),
            ("2021-366T20:31:05", "a day of the year"),
            ("2021-000T20:31:05", "a day of the year"),
            ("2021.084T20:31:05", "expected UTC as"),
            ("1.2.3.2021 20:31:05", "expected UTC as"),
            ("005.03.2024 20:31:05", "expected UTC as"),
        ] {
            let error = read(&format!("date,mag\n{date},7.25\n{date},7.5\n")).unwrap_err();
            assert!(error.contains(words), "{date}: {error}");
        }
    }

    /// Truth: IERS bulletin C 52: the last minute of 2016 had 61 s; day 366 of it is 31 December.
    #[test]
    fn a_leap_second_in_a_table() {
        for text in [
            "date,time,mag\n2016-12-31,23:59:59.5,1\n2016-12-31,23:59:60.5,2\n2017-01-01,00:00:00.5,3\n",
            "date,time,mag\n31.12.2016,23:59:59.5,1\n31.12.2016,23:59:60.5,2\n01.01.2017,00:00:00.5,3\n",
            "time mag\n31.12.2016 23:59:59.5 1\n31.12.2016 23:59:60.5 2\n01.01.2017 00:00:00.5 3\n",
            "time,mag\n2016-366T23:59:59.5,1\n2016-366T23:59:60.5,2\n2017-001T00:00:00.5,3\n",
            "date,time,mag\n2017-01-01,01:59:59.5+02:00,1\n2017-01-01,01:59:60.5+02:00,2\n2017-01-01,02:00:00.5+02:00,3\n",
        ] {
            let found = read(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            let times: Vec<String> = found.samples.time.iter().map(|t| format_utc(*t, 1)).collect();
            let truth =
                ["2016-12-31T23:59:59.5Z", "2016-12-31T23:59:60.5Z", "2017-01-01T00:00:00.5Z"];
            assert_eq!(times, truth, "{text}");
        }
        let error =
            read("date,time,mag\n2015-12-31,23:59:60,1\n2015-12-31,23:59:59,1\n").unwrap_err();
        assert!(error.contains("the IERS announced one"), "{error}");
    }

    #[test]
    fn separators_and_forms_of_times() {
        let utc = names(|n| n.scale = Some(Scale::Utc));
        let none = ColumnNames::default();
        let jd = 2_460_375.25;
        let two = 2.0 / 86_400.0;
        for (text, names, digits) in [
            ("time_utc;magnitude\n2024-03-05T18:00:00;7,25\n2024-03-05T18:00:02,0;7,5\n".to_owned(), &none, 9),
            ("time_utc\tmagnitude\n2024-03-05 18:00:00\t7,25\n2024-03-05 18:00:02\t7.5\n".to_owned(), &none, 9),
            ("\"time_utc\",\"magnitude\",\"note\"\n\"2024-03-05T18:00:00\",\"7.25\",\"a, b\"\n2024-03-05T18:00:02,7.5,\"say \"\"c\"\"\"\n".to_owned(), &none, 9),
            ("time,mag\n2024-03-05T20:00:00+02:00,7.25\n2024-03-05T18:00:02Z,7.5\n".to_owned(), &none, 9),
            ("date,time,mag\n2024-03-05,18:00:00,7.25\n2024-03-05,18:00:02,7.5\n".to_owned(), &utc, 9),
            ("# date time_utc mag\n2024-03-05 18:00:00 7.25\n2024-03-05 18:00:02 7.5\n".to_owned(), &none, 9),
            ("time_utc mag\n2024-03-05 18:00:00 7.25\n2024-03-05 18:00:02 7.5\n".to_owned(), &none, 9),
            (format!("obsjd,mag\n{jd},7.25\n{:.9},7.5\n", jd + two), &utc, 4),
            (format!("HJD,UT Date,mag\n{jd},2024-03-05.75,7.25\n{:.9},2024-03-05.75,7.5\n", jd + two), &utc, 4),
            ("unix_time,mag\n1709661600,7.25\n1709661602,7.5\n".to_owned(), &none, 6),
            ("time,mag\n1709661600,7.25\n1709661602,7.5\n".to_owned(), &none, 6),
        ] {
            let found = read_as(text.as_bytes(), names).unwrap_or_else(|e| panic!("{text}: {e}"));
            holds(&found, digits);
        }
        // Nothing says the scale, or what the numbers are.
        assert!(read("obsjd,mag\n2460375.25,7.25\n").unwrap_err().contains("--time-scale"));
        assert!(read("time,mag\n0.5,7.25\n").unwrap_err().contains("--time-format"));
        assert!(read("t;mag;x\n1\n2\n3;4;5\n").unwrap_err().contains("as many as names"));
        let relative = names(|n| {
            n.time = Some("t_s".into());
            n.format = Some(TimeFormat::Seconds);
        });
        let found = read_as(b"t_s,mag\n0.5,7.25\n2.5,7.5\n", &relative).unwrap();
        let step = found.samples.time[1] - found.samples.time[0];
        assert!((step.to_seconds() - 2.0).abs() < 1e-9);
        assert!(found.samples.notes[0].contains("made up"), "{:?}", found.samples.notes);
        let asked = names(|n| {
            n.time = Some("when".into());
            n.format = Some(TimeFormat::Mjd);
            n.scale = Some(Scale::Gps);
        });
        // 18 s between GPS and UTC since 2017.
        let gps = 60_374.75 + 18.0 / 86_400.0;
        let text = format!("when,mag\n{gps:.12},7.25\n{:.12},7.5\n", gps + two);
        holds(&read_as(text.as_bytes(), &asked).unwrap(), 4);
    }

    #[test]
    fn encodings() {
        let text =
            "# Müller\ntime_utc,magnitude\n2024-03-05T18:00:00,7.25\n2024-03-05T18:00:02,7.5\n";
        let none = ColumnNames::default();
        let wide = |of: fn(u16) -> [u8; 2]| -> Vec<u8> {
            let units = std::iter::once(0xfeff).chain(text.encode_utf16());
            units.flat_map(of).collect()
        };
        holds(&read_as(text.as_bytes(), &none).unwrap(), 9);
        holds(&read_as(&wide(u16::to_le_bytes), &none).unwrap(), 9);
        holds(&read_as(&wide(u16::to_be_bytes), &none).unwrap(), 9);
        let latin: Vec<u8> = text.chars().map(|c| c as u32 as u8).collect();
        let found = read_as(&latin, &none).unwrap();
        holds(&found, 9);
        assert!(found.samples.notes[0].contains("Latin-1"), "{:?}", found.samples.notes);
        let mut broken = latin.clone();
        broken.push(0);
        assert!(read_as(&broken, &none).unwrap_err().contains("0xfc"));
        assert!(read_as(&[0xff, 0xfe, 0x41], &none).unwrap_err().contains("UTF-16"));
    }

    /// Rows without a time are left out, values that are none are none, and all of it is told with its number and its first line; a file most of whose rows are unread is refused.
    #[test]
    fn what_cannot_be_read_is_told() {
        let row = |i: usize, magnitude: &str| format!("2024-03-05T18:00:{i:02},{magnitude}\n");
        let mut text = "time_utc,mag\n".to_owned();
        for (i, magnitude) in
            ["7.25", ">16.9", "--", "7.5", "", "bright", "7.5", "7.5", "7.5", "7.5"]
                .into_iter()
                .enumerate()
        {
            text += &row(i, magnitude);
        }
        text += ",7.5\n2024-03-05T18:00:30\n";
        let found = read(&text).unwrap();
        assert_eq!(found.samples.time.len(), 10);
        assert_eq!(found.samples.magnitude.iter().filter(|m| m.is_finite()).count(), 6);
        let notes = found.samples.notes.join("\n");
        for words in [
            "mag: 1 cell with a limit, no value (the first in line 3: `>16.9`)",
            "mag: 2 cells without a value (the first in line 4: `--`)",
            "mag: 1 cell with no number (the first in line 7: `bright`)",
            "1 row without a time left out (the first in line 12)",
            "1 row left out: without 2 values, as many as names (the first in line 13: 1)",
        ] {
            assert!(notes.contains(words), "{words}: {notes}");
        }
        let error = read("time_utc,mag\n,1\n,2\n2024-03-05T18:00:00,3\n").unwrap_err();
        assert!(error.contains("time_utc, row 1"), "{error}");
        let error = read("time_utc,mag\n1\n2\n2024-03-05T18:00:00,3\n").unwrap_err();
        assert!(error.starts_with("t.txt:2: found 1 fields"), "{error}");
    }

    /// Exposures stand under many names. Truth: the documents of those who write them (FITS: `EXPTIME`, seconds), the words `_ms`, and the unit that the table itself states.
    #[test]
    fn exposures_under_other_names() {
        let of = |head: &str, value: &str| {
            let rows = format!(
                "{head}\n2024-03-05T18:00:00Z,7.25,{value}\n2024-03-05T18:00:02Z,7.5,{value}\n"
            );
            read(&rows).unwrap()
        };
        for name in [
            "exposure_s",
            "exptime",
            "EXP_TIME",
            "exposure",
            "Exposure_Time",
            "exp",
            "t_exp",
            "texp",
            "itime",
            "exp_s",
            "exptime_s",
        ] {
            let found = of(&format!("time_utc,mag,{name}"), "0.5");
            assert_eq!(found.samples.exposure_s, Some(vec![0.5, 0.5]), "{name}");
            assert!(
                found.columns.contains(&("exposure", name.to_owned())) && found.unused.is_empty()
            );
        }
        for name in ["exposure_ms", "exptime_ms"] {
            let found = of(&format!("time_utc,mag,{name}"), "500");
            assert_eq!(found.samples.exposure_s, Some(vec![0.5, 0.5]), "{name}");
        }
        // A unit comes before the name.
        let ecsv = |unit: &str| {
            format!(
                "# %ECSV 1.0\n# ---\n# datatype:\n# - {{name: time_utc, datatype: string}}\n# - {{name: mag, datatype: float64}}\n# - {{name: exptime, unit: {unit}, datatype: float64}}\n\
             time_utc mag exptime\n2024-03-05T18:00:00Z 7.25 30\n2024-03-05T18:00:02Z 7.5 30\n"
            )
        };
        for (unit, seconds) in [("s", 30.0), ("ms", 0.03), ("min", 1800.0)] {
            let found = read(&ecsv(unit)).unwrap();
            assert_eq!(found.samples.exposure_s, Some(vec![seconds; 2]), "{unit}");
        }
        // Any that is none makes all unknown, and is told.
        for (found, words) in [
            (read(&ecsv("pix")).unwrap(), "its unit, `pix`, is none of time"),
            (
                of("time_utc,mag,exptime", "0"),
                "2 of its 2 values are not above 0 (the first in row 1: 0)",
            ),
            (of("time_utc,mag,exptime", "-1"), "not above 0"),
            (of("time_utc,mag,exptime", "nan"), "not above 0"),
            (of("time_utc,mag,exptime", "0.5 s"), "it does not hold numbers"),
        ] {
            assert_eq!(found.samples.exposure_s, None, "{words}");
            let notes = found.samples.notes.join("\n");
            assert!(notes.contains(words) && notes.contains("not known"), "{words}: {notes}");
        }
    }

    /// Truth: the rows: three of one object and two of another, one of them twice.
    #[test]
    fn one_object_is_taken() {
        let text = "# synthetic\ntime_utc,object,mag,filter\n2024-03-05T18:00:00Z,SAT A,7.25,V\n2024-03-05T18:00:01Z,SAT B,9.0,R\n2024-03-05T18:00:02Z,SAT A,7.5,B\n\
                    2024-03-05T18:00:02Z,SAT A,7.5,B\n2024-03-05T18:00:03Z,SAT B,9.5,R\n";
        let of = |rows: ObjectRows| {
            import("t.csv", text.as_bytes().to_vec(), &ColumnNames::default(), &rows)
        };
        let refused = of(ObjectRows::One).unwrap_err().to_string();
        for words in
            ["t.csv: its rows are of 2 objects (column `object`)", "SAT A (3 rows), SAT B (2 rows)"]
        {
            assert!(refused.contains(words), "{refused}");
        }
        let found = of(ObjectRows::Of("SAT A".into())).unwrap();
        assert_eq!(found.samples.magnitude, [7.25, 7.5, 7.5]);
        assert_eq!(found.samples.filter, Some(["V", "B", "B"].map(str::to_owned).to_vec()));
        assert_eq!((found.samples.target.as_str(), found.samples.time.len()), ("SAT A", 3));
        let notes = found.samples.notes.join("\n");
        for words in ["3 of 5 rows taken: those of the object", "1 row given twice"] {
            assert!(notes.contains(words), "{words}: {notes}");
        }
        let refused = of(ObjectRows::Of("SAT C".into())).unwrap_err().to_string();
        assert!(
            refused.contains("no row is of the object SAT C") && refused.contains("SAT B (2 rows)")
        );
        assert_eq!(of(ObjectRows::All).unwrap().samples.time.len(), 5);
        let tdm = "CCSDS_TDM_VERS = 2.0\nMETA_START\nTIME_SYSTEM = UTC\nPARTICIPANT_1 = SITE\nPARTICIPANT_2 = SAT A\nPATH = 2,1\nMETA_STOP\nDATA_START\nMAG = 2024-03-05T18:00:00 7.25\nDATA_STOP\n";
        let of = |name: &str| {
            let rows = ObjectRows::Of(name.into());
            import("t.tdm", tdm.as_bytes().to_vec(), &ColumnNames::default(), &rows)
        };
        assert!(of("SAT A").is_ok());
        assert!(of("SAT B").unwrap_err().to_string().contains("it has SAT A"));
    }

    /// Truth: by hand: 2.5 lg 2 between fluxes of 1 and 2; an uncertainty of 1 % is 0.0109 mag. A column that is asked for is what its name or unit says, not a magnitude because it was asked for.
    #[test]
    fn fluxes_that_are_asked_for_are_fluxes() {
        for (column, sigma) in [
            ("rel_flux_T1", "rel_flux_err_T1"),
            ("flux(mJy)", "flux_err"),
            ("KSPSAP_FLUX", "KSPSAP_FLUX_ERR"),
            ("RATE1", "none"),
            ("Source counts", "Source counts error"),
        ] {
            let text = format!(
                "time_utc,{column},{sigma}\n2024-03-05T18:00:00Z,1,0.01\n2024-03-05T18:00:02Z,2,0.02\n"
            );
            let asked = names(|n| n.magnitude = Some(column.to_lowercase()));
            let found = read_as(text.as_bytes(), &asked).unwrap();
            assert!(found.of_flux && found.samples.is_relative, "{column}");
            let m = &found.samples.magnitude;
            assert!((m[0] - m[1] - 0.752_575).abs() < 1e-6, "{column}: {m:?}");
            if sigma != "none" {
                let s = found.samples.sigma_mag.unwrap();
                assert!((s[0] - 0.010_857).abs() < 1e-6 && (s[1] - s[0]).abs() < 1e-12, "{s:?}");
            }
        }
        let text = "time_utc,inst_mag_flux\n2024-03-05T18:00:00Z,7.25\n2024-03-05T18:00:02Z,7.5\n";
        let asked = names(|n| n.magnitude = Some("inst_mag_flux".into()));
        assert!(!read_as(text.as_bytes(), &asked).unwrap().of_flux);
    }

    /// A text without a line of names. Truth: the module's.
    #[test]
    fn names_may_be_given() {
        let text = "# a survey\n2460375.25 7.25 0.01\n2460375.250023148 7.5 0.01\n";
        assert!(read(text).unwrap_err().contains("--columns"), "{:?}", read(text));
        let named =
            |columns: &str| names(|n| n.all = columns.split(',').map(str::to_owned).collect());
        let found = read_as(text.as_bytes(), &named("jd_utc,mag,sigma_mag")).unwrap();
        holds(&found, 3);
        assert_eq!(found.samples.sigma_mag.unwrap(), [0.01, 0.01]);
        for (text, columns, words) in [
            (text, "jd_utc,mag", "3 values"),
            ("jd_utc,mag\n2460375.25,7.25\n", "jd_utc,mag", "without a line of names"),
            (ALCDEF, "jd_utc,mag", "leave out --columns"),
        ] {
            let refused = read_as(text.as_bytes(), &named(columns)).unwrap_err();
            assert!(refused.contains(words), "{refused}");
        }
    }

    /// Truth: the words of the names: none of these times is UTC. Behind an offset, or with a scale that is told, the same are taken.
    #[test]
    fn local_times_are_not_utc() {
        let rows = "2024-03-05,18:00:00,7.25\n2024-03-05,18:00:02,7.5\n";
        for head in [
            "Date,Local time,mag",
            "Date,Time (CEST),mag",
            "Date (LT),Time,mag",
            "Date,time_local,mag",
            "Date,Time (UTC+2),mag",
            "# Time zone: CET\nDate,Time,mag",
        ] {
            let refused = read(&format!("{head}\n{rows}")).unwrap_err();
            assert!(refused.contains("times in UTC") && refused.contains("+02:00"), "{refused}");
            let told = names(|n| n.scale = Some(Scale::Utc));
            holds(&read_as(format!("{head}\n{rows}").as_bytes(), &told).unwrap(), 9);
        }
        holds(&read(&format!("# Time zone: UTC\nDate,Time,mag\n{rows}")).unwrap(), 9);
        holds(&read(&format!("Date,Time (UT),mag\n{rows}")).unwrap(), 9);
        let zoned =
            "time (local),mag\n2024-03-05T20:00:00+02:00,7.25\n2024-03-05T20:00:02+02:00,7.5\n";
        let asked = names(|n| n.time = Some("time (local)".into()));
        holds(&read_as(zoned.as_bytes(), &asked).unwrap(), 9);
    }

    /// Tables as surveys have them (synthetic rows under their heads: AAVSO's download, ZTF at IRSA, a numbered table). Truth: the rows.
    #[test]
    fn objects_and_filters_of_surveys() {
        let two = "Star Name,JD_UTC,Magnitude,Band\nZZ A,2460375.25,7.25,V\nZZ A,2460375.26,7.3,V\nZZ B,2460375.25,9,V\nZZ B,2460375.26,9.1,V\n";
        let refused =
            import("t.csv", two.as_bytes().to_vec(), &ColumnNames::default(), &ObjectRows::One);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("2 objects (column `Star Name`): ZZ A (2 rows)"), "{refused}");
        // One source in two filters has a number in each; four numbers are two sources.
        let ztf = |oids: [u32; 4]| {
            let rows = oids.iter().enumerate().map(|(i, oid)| {
                let filter = if i % 2 == 0 { "zg" } else { "zr" };
                format!("{oid},2460375.25{i},60374.75{i},7.25,{filter}\n{oid},2460375.26{i},60374.76{i},7.5,{filter}\n")
            });
            format!("oid,hjd,mjd,mag,filtercode\n{}", rows.collect::<String>())
        };
        let utc = names(|n| n.scale = Some(Scale::Utc));
        let one = read_as(ztf([11, 12, 11, 12]).as_bytes(), &utc).unwrap();
        assert_eq!(one.samples.filter.unwrap()[..4], ["zg", "zg", "zr", "zr"]);
        assert!(one.columns.contains(&("time", "mjd".to_owned())), "{:?}", one.columns);
        let refused = read_as(ztf([11, 12, 13, 14]).as_bytes(), &utc).unwrap_err();
        assert!(refused.contains("4 objects (column `oid`)"), "{refused}");
        holds(
            &read("id,time_utc,mag\n1,2024-03-05T18:00:00,7.25\n2,2024-03-05T18:00:02,7.5\n")
                .unwrap(),
            9,
        );
    }

    /// The head of the forced photometry of ATLAS, whose magnitudes have the sign of the flux (synthetic rows). Truth: a flux below 0 has no magnitude; 2.5 lg 2 between its fluxes.
    #[test]
    fn fluxes_below_zero_have_no_magnitude() {
        let text = "###MJD m dm uJy duJy F err chi/N RA Dec\n60374.75 19.6 0.5 52 25 c 0 1.0 10.0 20.0\n60374.76 -18.9 0.3 -106 25 o 0 1.0 10.0 20.0\n60374.77 18.85 0.2 104 25 o 0 1.0 10.0 20.0\n";
        let utc = names(|n| n.scale = Some(Scale::Utc));
        let found = read_as(text.as_bytes(), &utc).unwrap();
        let told: Vec<bool> = found.samples.magnitude.iter().map(|m| m.is_finite()).collect();
        assert_eq!(told, [true, false, true]);
        assert!(found.samples.notes.join("\n").contains("1 magnitudes left out"));
        assert_eq!(found.samples.filter.unwrap(), ["c", "o", "o"]);
        let flux = names(|n| (n.scale, n.magnitude) = (Some(Scale::Utc), Some("uJy".into())));
        let found = read_as(text.as_bytes(), &flux).unwrap();
        let m = &found.samples.magnitude;
        assert!((m[0] - m[2] - 0.752_575).abs() < 1e-6 && m[1].is_nan(), "{m:?}");
    }

    /// Heads that begin with a tab, as ImageJ's tables do (from memory of AstroImageJ's), and days that a name takes off. Truth: the module's; TDB is 69.184 s ahead of UTC, to 2 ms.
    #[test]
    fn leading_tabs_and_days_taken_off() {
        let jd = 2_460_375.25;
        let two = 2.0 / 86_400.0;
        let table = format!(
            " \tLabel\tJ.D.-2400000\tmag\n1\ta.fits\t{:.9}\t7.25\n2\tb.fits\t{:.9}\t7.5\n",
            jd - 2.4e6,
            jd - 2.4e6 + two
        );
        let utc = names(|n| n.scale = Some(Scale::Utc));
        holds(&read_as(table.as_bytes(), &utc).unwrap(), 3);
        // Another column of the observer's names its scale: that one is taken.
        let named = format!(
            "J.D.-2400000,JD_UTC,BJD_TDB,mag\n{:.9},{jd:.9},1,7.25\n{:.9},{:.9},1,7.5\n",
            jd - 2.4e6,
            jd - 2.4e6 + two,
            jd + two
        );
        holds(&read(&named).unwrap(), 3);
        holds(
            &read("\ttime_utc\tmag\n2024-03-05T18:00:00\t7.25\n2024-03-05T18:00:02\t7.5\n")
                .unwrap(),
            9,
        );
        for (name, off) in [
            ("HJD-2450000", 2.45e6),
            ("HJD (-2400000)", 2.4e6),
            ("JD-2400000.5", 2_400_000.5),
            ("RJD", 2.4e6),
        ] {
            let text = format!("{name},mag\n{:.9},7.25\n{:.9},7.5\n", jd - off, jd - off + two);
            let found = read_as(text.as_bytes(), &utc).unwrap();
            holds(&found, 3);
            assert!(found.samples.notes.join("\n").contains("days since the Julian date"));
        }
        // Whole dates under such a name stay whole.
        holds(
            &read_as(format!("HJD-2450000,mag\n{jd},7.25\n{:.9},7.5\n", jd + two).as_bytes(), &utc)
                .unwrap(),
            3,
        );
        for (name, off) in [("btjd", 2_457_000.0), ("BKJD", 2_454_833.0)] {
            let at = jd - off + 69.184 / 86_400.0;
            let text = format!("{name},mag\n{at:.9},7.25\n{:.9},7.5\n", at + two);
            holds(&read(&text).unwrap(), 2);
        }
        let days = names(|n| n.format = Some(TimeFormat::Days));
        let found = read_as(b"time,mag\n0.5,7.25\n1.75,7.5\n", &days).unwrap();
        let step = (found.samples.time[1] - found.samples.time[0]).to_seconds();
        assert!((step - 108_000.0).abs() < 1e-6, "{step}");
    }

    /// Truth: the rows: five magnitudes, and four numbers that stand for none. Fluxes may be any number.
    #[test]
    fn numbers_that_stand_for_none_are_none() {
        let values = ["7.25", "99.999", "7.5", "-9.99", "7.5", "0.0", "7.5", "999", "7.5"];
        let text = |name: &str| {
            let rows = values.iter().enumerate();
            let rows = rows.map(|(i, v)| format!("2024-03-05T18:00:{i:02}Z,{v}\n"));
            format!("time_utc,{name}\n{}", rows.collect::<String>())
        };
        let found = read(&text("mag")).unwrap();
        let told: Vec<bool> = found.samples.magnitude.iter().map(|m| m.is_finite()).collect();
        assert_eq!(told, [true, false, true, false, true, false, true, false, true]);
        let notes = found.samples.notes.join("\n");
        assert!(notes.contains("4 magnitudes are words for a missing one"), "{notes}");
        let written = write::alcdef(&found.samples, &write::Sender::default()).unwrap();
        assert_eq!(written.lines().filter(|l| l.starts_with("DATA=")).count(), 5);
        let fluxes = read(&text("flux")).unwrap();
        assert_eq!(fluxes.samples.magnitude.iter().filter(|m| m.is_finite()).count(), 7);
    }

    /// Text is UTC where nothing says another scale, in one column or in two, and a note says it.
    #[test]
    fn text_without_a_scale_is_utc() {
        for text in [
            "date;time;mag\n2024-03-05;18:00:00;7,25\n2024-03-05;18:00:02;7,5\n",
            "time,mag\n2024-03-05T18:00:00,7.25\n2024-03-05T18:00:02,7.5\n",
        ] {
            let found = read(text).unwrap();
            holds(&found, 9);
            let notes = found.samples.notes.join("\n");
            assert!(notes.contains("times without a scale or an offset are UTC"), "{notes}");
        }
        let tai = names(|n| n.scale = Some(Scale::Tai));
        assert!(read_as(b"time,mag\n2024-03-05T18:00:00,7.25\n", &tai).is_err());
        assert!(read("jd,mag\n2460375.25,7.25\n").unwrap_err().contains("--time-scale"));
    }

    /// A file in the layout of AAVSO's extended format, one of ATLAS's forced photometry, and one with another name of the uncertainty (synthetic). Truth: their documents: times of AAVSO are UT,
    /// `dm` is the uncertainty of `m`, and `err` a flag.
    #[test]
    fn surveys_and_societies() {
        let head = "#TYPE=EXTENDED\n#OBSCODE=ABC\n#SOFTWARE=x\n#DELIM=,\n#DATE=JD\n#OBSTYPE=CCD\n#NAME,DATE,MAG,MERR,FILT,TRANS,MTYPE,CNAME,CMAG,KNAME,KMAG,AMASS,GROUP,CHART,NOTES\n";
        let aavso = format!(
            "{head}SS CYG,2460375.25,7.25,0.03,V,NO,STD,105,10.593,110,11.09,1.561,NA,X1,na\n\
             SS CYG,2460375.250023148,7.5,na,V,NO,STD,105,10.593,110,11.09,1.561,NA,X1,na\n\
             SS CYG,2460375.250046296,<9.5,na,V,NO,STD,105,10.593,110,11.09,1.561,NA,X1,na\n\
             SS CYG,2460375.250069444,7.5,0.03,V,NO,STD,105,10.593,110,11.09,1.561,NA,X1,na\n"
        );
        let found = read(&aavso).unwrap();
        assert_eq!((found.format, found.samples.time.len()), ("AAVSO", 4));
        assert_eq!(format_utc(found.samples.time[1], 3), "2024-03-05T18:00:02.000Z");
        assert!(found.samples.magnitude[2].is_nan(), "a limit is no magnitude");
        let sigma = found.samples.sigma_mag.unwrap();
        assert!(sigma[0] == 0.03 && sigma[1].is_nan(), "{sigma:?}");
        assert_eq!(found.samples.filter.unwrap()[0], "V");
        let excel = aavso.replace("#DATE=JD", "#DATE=EXCEL");
        assert!(read(&excel).unwrap_err().contains("DATE=EXCEL"));

        let atlas = "###MJD          m      dm   uJy   duJy F err chi/N\n60374.75 7.25 0.03 100 55 o  0  1.2\n60374.750023148 7.5 0.04 100 55 o  0  1.2\n";
        let utc = names(|n| n.scale = Some(Scale::Utc));
        let found = read_as(atlas.as_bytes(), &utc).unwrap();
        holds(&found, 4);
        assert_eq!(found.samples.sigma_mag, Some(vec![0.03, 0.04]));
        // A flag is no uncertainty, whatever stands beside it.
        let flag = "time_utc,mag,err\n2024-03-05T18:00:00,7.25,0\n2024-03-05T18:00:02,7.5,1\n";
        assert_eq!(read(flag).unwrap().samples.sigma_mag, None);
        let other =
            flag.replace("err", "mag_unc").replace(",1\n", ",0.03\n").replace(",0\n", ",0.02\n");
        assert_eq!(read(&other).unwrap().samples.sigma_mag, Some(vec![0.02, 0.03]));
        let asked = names(|n| n.sigma = Some("sd".into()));
        assert!(read_as(flag.as_bytes(), &asked).unwrap_err().contains("a column `sd`"));
    }

    /// Truth: by hand; 18 s between the time of GPS and UTC in 2024, 13 s in 2005 (IERS).
    #[test]
    fn messages_in_other_scales() {
        let utc = |system: &str| {
            let text = TDM.replace("TIME_SYSTEM = UTC", &format!("TIME_SYSTEM = {system}"));
            read_str("a.tdm", &text, Format::TdmKvn).map(|r| (format_utc(r.time[0], 3), r.notes))
        };
        assert_eq!(utc("GPS").unwrap().0, "2005-06-30T11:59:48.250Z");
        let (time, notes) = utc("UT1").unwrap();
        assert_eq!(time, "2005-06-30T12:00:01.250Z");
        assert!(notes.iter().any(|n| n.contains("0.9 s")), "{notes:?}");
        let typed = TDM_XML.replacen("?>\n", "?>\n<!DOCTYPE tdm SYSTEM \"a>b.dtd\">\n", 1);
        let plain = read_str("a.xml", TDM_XML, Format::TdmXml).unwrap();
        assert_eq!(recognise(&typed), Some(Format::TdmXml));
        assert_eq!(read_str("a.xml", &typed, Format::TdmXml).unwrap(), plain);
        // A sample without a magnitude ends no file.
        let lost = ALCDEF.replace("DATA=2455000.25|7.9||", "DATA=2455000.25|NaN|0.1|");
        let found = read_str("a.txt", &lost, Format::Alcdef).unwrap();
        assert_eq!(found.magnitude, [7.812, 0.4]);
        assert!(found.notes.iter().any(|n| n.contains("1 sample without a magnitude")));
    }
}

/// Truth: the file: names and no row, in three formats. Refused with the number of rows, and with the names that are there; with one row it is read.
#[test]
fn tables_without_a_row_are_refused() {
    let ecsv = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: mjd_utc, datatype: float64}\n# - {name: mag, datatype: float64}\nmjd_utc mag\n";
    for (format, text) in
        [("CSV", "# synthetic\nmjd_utc,mag\n"), ("text", "mjd_utc mag\n"), ("ECSV", ecsv)]
    {
        let read = |text: String| {
            import("f", text.into_bytes(), &ColumnNames::default(), &ObjectRows::default())
        };
        let words = read(text.to_owned()).unwrap_err().to_string();
        let found = format!("f: found {format} with 0 rows below the names mjd_utc, mag");
        assert!(words.starts_with(&found) && words.contains("a row for each sample"), "{words}");
        let between = if format == "CSV" { ',' } else { ' ' };
        let one = read(format!("{text}60374.5{between}8.1\n")).unwrap();
        assert_eq!(one.samples.magnitude, [8.1]);
    }
}

/// The layout of a single track of MMT-9, which has no number of it (synthetic). Truth: the rows.
#[test]
fn one_track_of_mmt9_has_no_number() {
    let row = |second: u32, mag: f64| {
        format!("2024-03-05 18:00:{second:02}.0 {mag} {mag} Clear 0 1000.0 60.0 5\n")
    };
    let text = format!(
        "# Date Time StdMag Mag Filter Penumbra Distance Phase Channel\n{}{}",
        row(0, 7.25),
        row(2, 7.5)
    );
    let found = import("track_1.txt", text.into_bytes(), &ColumnNames::default(), &ObjectRows::One)
        .unwrap();
    assert_eq!(found.format, "MMT-9 text");
    assert_eq!(found.samples.magnitude, [7.25, 7.5]);
    assert_eq!(found.samples.camera.unwrap(), ["5", "5"]);
}

/// The layout of DAMIT's lc.txt (synthetic). Truth: JD 2460375.25 is 2024-03-05T18:00 (Meeus, chapter 7); the intensity 2.5 is −0.99485 mag (−2.5 lg 2.5); seen from the asteroid the Earth
/// stands 1 au beside the Sun at 2 au, and at 3 au: phase angles of atan 1/2 and atan 1/3.
#[test]
fn light_curves_for_inversion_with_their_counts_and_without() {
    let read = |text: &str, scale: Option<Scale>| {
        let mut names = ColumnNames::default();
        names.scale = scale;
        import("lc.txt", text.as_bytes().to_vec(), &names, &ObjectRows::One)
            .map_err(|error| error.to_string())
    };
    let rows = [
        "2460375.25 1.000000 2 0 0 2 1 0",
        "2460375.50 2.500000 2 0 0 2.0 0 -1",
        "2460376.25 1.5e0 0 3 0 0 3 1",
    ];
    let [a, b, c] = rows;
    let whole = format!("2\n2 0\n{a}\n{b}\n1 1\n{c}\n");
    for text in [&whole, &format!("{a}\n{b}\n\n{c}\n"), &whole.replace('\n', "\r\n")] {
        let found = read(text, Some(Scale::Utc)).unwrap_or_else(|error| panic!("{text}: {error}"));
        let samples = found.samples;
        let times: Vec<String> = samples.time.iter().map(|t| format_utc(*t, 3)).collect();
        let truth =
            ["2024-03-05T18:00:00.000Z", "2024-03-06T00:00:00.000Z", "2024-03-06T18:00:00.000Z"];
        assert_eq!(times, truth, "{text}");
        assert!(found.of_flux && samples.is_relative);
        // Five digits of the logarithm above.
        assert!((samples.magnitude[1] + 0.99485).abs() < 5e-6, "{:?}", samples.magnitude);
        let phase = samples.phase_deg.unwrap();
        let truth = [0.5_f64, 0.5, 1.0 / 3.0].map(|tan| tan.atan().to_degrees());
        assert!(phase.iter().zip(truth).all(|(p, t)| (p - t).abs() < 1e-9), "{phase:?}");
        assert_eq!(samples.session.unwrap(), ["1", "1", "2"]);
        let says = |words: &str| samples.notes.iter().any(|n| n.contains(words));
        assert!(says("the light's way") && says("zero point"), "{:?}", samples.notes);
    }
    // Which scale the dates are in, the files do not say.
    assert!(read(&whole, None).unwrap_err().contains("--time-scale"));
    let utc = |text: &str| read(text, Some(Scale::Utc)).unwrap_err();
    for (text, words) in [
        (
            whole.replace("1 1\n", "2 1\n"),
            "found the end of the file, expected 2 rows, as line 5 says; there are 1",
        ),
        (
            whole.replacen("2\n", "3\n", 1),
            "found the end of the file, expected light curve 3 of 3, as line 1 says",
        ),
        (
            whole.replacen("2\n", "1\n", 1),
            "lc.txt:5: found `1 1`, expected the end after 1 light curve, as line 1 says",
        ),
        (whole.replace("2 0\n246", "1 0\n246"), "lc.txt:4: found `2460375.5 2.5 2"),
        (
            whole.replace("2.0 0 -1", "2.0 0 -9"),
            "lc.txt:4: found `2460375.5 2.5 2 0 0 2 0 -9`, expected rows of 8 numbers",
        ),
        (
            format!("{a}\n{}\n", b.replace("-1", "")),
            "lc.txt:2: found `2460375.5 2.5 2 0 0 2 0`, expected rows of 8 numbers",
        ),
        (
            "4 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 3 2\n1 2 4\n1 4 3\n2 3 4\n".into(),
            "lc.txt:1: found a shape of 4 vertices and 4 facets (DAMIT's shape.txt), expected light curves",
        ),
        // The Earth 5 au from the Sun: these are other columns.
        ("2460375.25 1 2 0 0 2 5 0\n".into(), "names of the columns in the first line"),
        ("1\n2\n3\n".into(), "names of the columns in the first line"),
    ] {
        let error = utc(&text);
        assert!(error.contains(words), "{text}{error}\nshould have: {words}");
    }
}
