//! ECSV in and out. Truth: the text of the format's definition (APE 6) for what is read, the exact messages for what is
//! refused, and the table itself for what comes back. What astropy says is in `astropy.rs`.

use sunglint_formats::{Column, Meta, Table, Values, ecsv};

const GOOD: &str = "# %ECSV 1.0
# ---
# delimiter: ','
# datatype:
# - {name: time_utc, datatype: string, description: 'mid-exposure, UTC'}
# - {name: counts, unit: ct, datatype: uint16}
# - {name: rate_hz, unit: Hz, datatype: float64}
# - {name: good, datatype: bool}
# meta: !!omap
# - {title: 'a night: the first'}
# - {n: 3}
# - site: {lat_deg: 45.5, names: [a, b]}
# schema: astropy-2.0
time_utc,counts,rate_hz,good
2016-12-31T23:59:60.5Z,7,1.5e3,True
\"\",,nan,
,65535,,False
";

#[test]
fn a_table_with_everything() {
    let table = ecsv::read_str("night.ecsv", GOOD).unwrap();
    assert_eq!(table.rows(), 3);
    assert_eq!(
        table.text("time_utc").unwrap(),
        [Some("2016-12-31T23:59:60.5Z".to_owned()), Some(String::new()), None]
    );
    assert_eq!(table.i64("counts").unwrap(), [Some(7), None, Some(65535)]);
    let rate = table.f64("rate_hz").unwrap();
    assert!(rate[0] == 1500.0 && rate[1].is_nan() && rate[2].is_nan());
    assert_eq!(table.bool("good").unwrap(), [Some(true), None, Some(false)]);
    let column = table.column("time_utc").unwrap();
    assert_eq!(column.description.as_deref(), Some("mid-exposure, UTC"));
    assert_eq!(table.column("counts").unwrap().unit.as_deref(), Some("ct"));
    assert_eq!(table.meta_text("title"), Some("a night: the first"));
    assert_eq!(table.meta["n"], 3);
    assert_eq!(table.meta["site"]["lat_deg"], 45.5);
    assert_eq!(table.meta.keys().collect::<Vec<_>>(), ["title", "n", "site"]);
}

#[test]
fn what_is_written_comes_back() {
    let mut meta = Meta::new();
    meta.insert("title".into(), "tabs\tand \"quotes\", colons: and\nlines \u{2028} é".into());
    meta.insert("yes".into(), "no".into());
    meta.insert("a key: with colon".into(), serde_json::json!([1, 2.5, null, true, {"x": []}]));
    meta.insert("tiny".into(), 1e-300.into());
    meta.insert("whole".into(), 3.0.into());
    meta.insert("long".into(), "word ".repeat(60).into());
    let values = vec![0.1, -0.0, f64::MAX, f64::MIN_POSITIVE, 5e-324, 1e16, 0.1 + 0.2];
    let n = values.len();
    let text = ["", "a,b", "# not a comment", " blanks ", "\"quoted\"", "two\nlines", "é"];
    let table = Table {
        meta,
        columns: vec![
            Column::f64("x m", Some("W / (m2 nm)"), values).described("a: 'b', \"c\""),
            Column::i64("i", None, (0..n as i64).map(|i| i64::MIN + i).collect()),
            Column::text("t", text.iter().map(|t| (*t).to_owned()).collect()),
            Column {
                name: "nan".into(),
                unit: None,
                description: None,
                values: Values::Bool((0..n).map(|i| (i > 1).then_some(i > 3)).collect()),
            },
        ],
    };
    let written = ecsv::to_string(&table).unwrap();
    let back = ecsv::read_str("back.ecsv", &written).unwrap();
    assert_eq!(back, table);
    // -0.0 == 0.0, so the bits are compared too.
    assert_eq!(back.f64("x m").unwrap()[1].to_bits(), (-0.0_f64).to_bits());
}

#[test]
fn one_column_of_missing_values_keeps_its_rows() {
    let column = |values| Table {
        meta: Meta::new(),
        columns: vec![Column { name: "a".into(), unit: None, description: None, values }],
    };
    let table = column(Values::I64(vec![None, Some(1), None]));
    assert_eq!(ecsv::read_str("a", &ecsv::to_string(&table).unwrap()).unwrap(), table);
    let table = column(Values::F64(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]));
    let back = ecsv::read_str("a", &ecsv::to_string(&table).unwrap()).unwrap();
    assert_eq!(format!("{back:?}"), format!("{table:?}"));
}

#[test]
fn what_the_format_cannot_hold_is_not_written() {
    let table = |columns| Table { meta: Meta::new(), columns };
    let column =
        |name: &str, values| Column { name: name.into(), unit: None, description: None, values };
    let refused = |columns| ecsv::to_string(&table(columns)).unwrap_err().to_string();
    let flat = Box::new(Values::F64(vec![1.0; 6]));
    assert_eq!(
        refused(vec![column("v", Values::Vectors { width: 3, flat })]),
        "v: found vectors of 3, expected one value a row (FITS holds vectors)"
    );
    assert_eq!(
        refused(vec![column("t", Values::Text(vec![None]))]),
        "t: found a missing text in a table of one column, expected a second column beside it, or the empty text"
    );
    assert_eq!(
        refused(vec![Column::f64("a", None, vec![1.0]), Column::f64("b", None, vec![])]),
        "b: found 0 rows, expected 1 rows, as in the first column"
    );
    assert_eq!(
        refused(vec![Column::f64("a", None, vec![]), Column::f64("a", None, vec![])]),
        "a: found the column twice, expected each column once"
    );
    assert_eq!(refused(vec![]), "table: found no columns, expected at least one column");
}

#[test]
fn what_is_wrong_is_named_with_its_line_and_column() {
    let with = |from: &str, to: &str| {
        assert!(GOOD.contains(from), "{from}");
        ecsv::read_str("n.ecsv", &GOOD.replace(from, to)).unwrap_err().to_string()
    };
    assert_eq!(
        with(",7,", ",70000,"),
        "n.ecsv:15: counts: found `70000`, expected a whole number from 0 to 65535 (uint16)"
    );
    assert_eq!(with("1.5e3", "1.5.3"), "n.ecsv:15: rate_hz: found `1.5.3`, expected a number");
    assert_eq!(
        with("1.5e3", "1.5e999"),
        "n.ecsv:15: rate_hz: found `1.5e999`, expected a number that fits the datatype"
    );
    assert_eq!(with(",False", ",2"), "n.ecsv:17: good: found `2`, expected True or False");
    assert_eq!(
        with(",7,1.5e3", ",7"),
        "n.ecsv:15: found 3 fields, expected 4 fields, one for each column"
    );
    assert_eq!(
        with("uint16", "uint12"),
        "n.ecsv: counts: found the datatype `uint12`, expected one of bool, int8, int16, int32, int64, uint8, uint16, \
         uint32, uint64, float16, float32, float64, string (did you mean `uint16`?)"
    );
    assert_eq!(
        with("datatype: bool", "datatype: string, subtype: 'float64[2]'"),
        "n.ecsv: good: found the subtype `float64[2]`, expected a column of plain values (arrays and JSON inside a column \
         are not read)"
    );
    assert_eq!(
        with("time_utc,counts", "time,counts"),
        "n.ecsv:14: found `time`, expected `time_utc` (the column names must be those of the header, in its order)"
    );
    assert_eq!(
        with("rate_hz,good\n", "rate_hz,good,extra\n"),
        "n.ecsv:14: found `extra`, expected 4 column names (the header announces no such column)"
    );
    assert_eq!(
        with("name: good", "name: counts"),
        "n.ecsv: counts: found the column twice, expected each column once"
    );
    assert_eq!(
        with("delimiter: ','", "delimiter: ';'"),
        "n.ecsv: delimiter: found `;`, expected a blank or a comma"
    );
    assert_eq!(with("%ECSV 1.0", "%ECSV 7.0"), "n.ecsv:1: found `%ECSV 7.0`, expected `%ECSV 1.0`");
    assert_eq!(
        with("astropy-2.0", "mine-1"),
        "n.ecsv: schema: found `mine-1`, expected `astropy-2.0`"
    );
    assert!(
        with("{n: 3}", "{n: 3").starts_with(
            "n.ecsv:11: found a header that cannot be read, expected an ECSV header in YAML ("
        ),
        "{}",
        with("{n: 3}", "{n: 3")
    );
    assert_eq!(
        ecsv::read_str("n.csv", "a,b\n1,2\n").unwrap_err().to_string(),
        "n.csv:1: found `a,b`, expected `# %ECSV 1.0`"
    );
    assert_eq!(
        ecsv::read_str("n.csv", "").unwrap_err().to_string(),
        "n.csv:1: found ``, expected `# %ECSV 1.0`"
    );
}

#[test]
fn lines_are_counted_through_quoted_line_breaks() {
    let text = GOOD.replace("2016-12-31T23:59:60.5Z", "\"two\nlines\"").replace(",65535,", ",x,");
    assert_eq!(
        ecsv::read_str("n.ecsv", &text).unwrap_err().to_string(),
        "n.ecsv:18: counts: found `x`, expected a whole number from 0 to 65535 (uint16)"
    );
}
