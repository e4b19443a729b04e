//! Magnitudes of other programs' files.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::Path;
use sunglint_formats::photometry::{Format, Scale, column_times, moment, read_str, recognise};
use sunglint_formats::text_table;
use sunglint_formats::time::format_utc;

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
        column_times(Path::new("t.csv"), &table).map(|t| format_utc(t.unwrap().time[0], 3))
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
