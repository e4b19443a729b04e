//! Files that describe SCPI devices: the templates are right, wrong files say the line, the key and what to do.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use sunglint_drivers::scpi::{Definition, DeviceKind, TEMPLATES};

const METER: &str = "\
kind = \"meter\"
name = \"ammeter\"
unit = \"A\"
[read]
send = \"READ?\"
fresh = \"trigger\"
";

fn wrong(text: &str) -> String {
    Definition::parse("device.toml", text).unwrap_err().to_string()
}

/// The meter with a line put in place of another.
fn with(old: &str, new: &str) -> String {
    assert!(METER.contains(old), "{old}");
    METER.replace(old, new)
}

/// Truth: the kinds and units that the templates' titles say; each says that it was not tried.
#[test]
fn every_template_is_a_good_file() {
    for template in &TEMPLATES {
        let about = Definition::parse(template.name, template.text)
            .unwrap_or_else(|error| panic!("{error}"));
        let source = ["keithley2400", "rigol_dp832"].contains(&template.name);
        assert_eq!(about.kind() == DeviceKind::Source, source, "{}", template.name);
        let amperes = ["keithley6485", "photodiode"].contains(&template.name);
        let unit = match template.name {
            "idq_id900" => "1/s",
            _ if amperes => "A",
            _ => "V",
        };
        assert_eq!(about.unit(), unit, "{}", template.name);
        assert!(template.text.contains("not tried with an instrument"), "{}", template.name);
    }
    let photodiode = TEMPLATES.iter().find(|template| template.name == "photodiode").unwrap();
    // What its comment says makes a power meter of it.
    let power = photodiode
        .text
        .replace("kind = \"meter\"", "kind = \"power_meter\"")
        .replace("unit = \"A\"\n", "")
        + "[response]\na_per_w = [[400, 0.2], [800, 0.5]]\nwavelength_nm = 633\n";
    let about = Definition::parse("power.toml", &power).unwrap();
    assert_eq!((about.kind(), about.unit()), (DeviceKind::PowerMeter, "W"));
}

/// Truth: the line of each mistake, counted by hand, its key, and what should stand there.
#[test]
fn a_wrong_file_says_where_and_what() {
    Definition::parse("device.toml", METER).unwrap();
    let setting = |lines: &str| format!("{METER}[settings.range]\n{lines}");
    for (text, at, why) in [
        (with("send =", "sned ="), "device.toml:5: read.sned", "did you mean `send`"),
        (with("\"meter\"", "\"metre\""), "device.toml:1: kind", "meter"),
        (with("name = \"ammeter\"\n", ""), "device.toml:1: name", "it is required"),
        (with("\"trigger\"", "\"poll\""), "device.toml:4: read.period_ms", "from one new value"),
        (with("\"READ?\"", "\"READ?\\n*RST\""), "device.toml:5: read.send", "printable"),
        (
            with("\"READ?\"", "\"READ?\"\nexpect = \"{word}\""),
            "device.toml:6: read.expect",
            "{value}",
        ),
        (
            with("\"READ?\"", "\"READ?\"\nexpect = \"{value}{unit}\""),
            "read.expect",
            "holes of the names",
        ),
        (with("\"READ?\"", "\"READ?\"\nunit = \"V\""), "device.toml:6: read.unit", "\"A\""),
        (with("\"READ?\"", "\"READ?\"\nscale = 0"), "device.toml:6: read.scale", "other than 0"),
        (
            with("\"READ?\"", "\"READ?\"\nfirst = [\"X?\"]"),
            "device.toml:6: read.first[0]",
            "would not be read",
        ),
        (with("\"meter\"", "\"source\""), "settings.level", "a source has one"),
        (with("\"meter\"", "\"power_meter\""), "device.toml:3: unit", "watts"),
        (setting("send = \"R\""), "device.toml:8: settings.range.send", "{value} in it"),
        (
            setting("send = \"R {value}\"\nleast = 2\nmost = 1"),
            "device.toml:10: settings.range.most",
            "at least 2",
        ),
        (setting("send = \"R {value}\"\nexpect = \"{word}\""), "settings.range.names", "a word"),
        (setting("send = \"R {value}\"\nnames = {}"), "settings.range.names", "at least one"),
        (
            setting("send = \"R {value}\"\nauto = { send = \"A\", ask = \"A?\", on = \"1\" }"),
            "device.toml:9: settings.range.auto",
            "`names`",
        ),
        (format!("{METER}[gain]\nv_per_a = {{ a = 1e6 }}"), "read.unit", "volts"),
        (
            format!("{METER}[response]\na_per_w = [[1, 1], [2, 1]]"),
            "device.toml:7: response",
            "power_meter",
        ),
        (format!("{METER}[settings.Range]\nsend = \"R {{value}}\""), "settings.Range", "a-z"),
    ] {
        let said = wrong(&text);
        assert!(said.contains(at) && said.contains(why), "expected {at} … {why}: {said}");
    }
    let power = "kind = \"power_meter\"\nname = \"p\"\n[read]\nsend = \"R?\"\nunit = \"A\"\nfresh = \"trigger\"\n[response]\n";
    let said = wrong(&format!("{power}a_per_w = [[400, 0.1], [500, 0.2]]\nwavelength_nm = 633\n"));
    assert!(
        said.contains("device.toml:9: response.wavelength_nm") && said.contains("400 to 500 nm"),
        "{said}"
    );
    let said = wrong(&format!("{power}file = \"nowhere.csv\"\n"));
    assert!(said.contains("cannot read nowhere.csv"), "{said}");
    let said = wrong(power);
    assert!(said.contains("either `file` or `a_per_w`"), "{said}");
}

/// Truth: the folder of the file, in which the responsivity lies.
#[test]
fn a_responsivity_is_found_beside_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("diode.toml");
    let text = "kind = \"power_meter\"\nname = \"p\"\n[read]\nsend = \"R?\"\nunit = \"A\"\nfresh = \"trigger\"\n[response]\nfile = \"r.csv\"\n";
    std::fs::write(&file, text).unwrap();
    std::fs::write(
        folder.path().join("r.csv"),
        "wavelength_nm,responsivity_a_per_w\n400,0.2\n800,x\n",
    )
    .unwrap();
    let said = Definition::read(&file).unwrap_err().to_string();
    assert!(said.contains("r.csv:3: "), "{said}");
    std::fs::write(
        folder.path().join("r.csv"),
        "wavelength_nm,responsivity_a_per_w\n400,0.2\n800,0.5\n",
    )
    .unwrap();
    assert_eq!(Definition::read(&file).unwrap().unit(), "W");
}

/// Every file in the guide is a good one, and every key of a file is in its table. Truth: the keys that the templates and the guide's own files have.
#[test]
fn the_files_of_the_guide_are_good_ones() {
    let page = sunglint_testkit::repository().join("docs/devices-scpi.md");
    let page = std::fs::read_to_string(page).unwrap();
    let mut files = 0;
    for block in page.split("```toml\n").skip(1) {
        let text = block.split("```").next().unwrap();
        Definition::parse("guide.toml", text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        files += 1;
    }
    assert_eq!(files, 3);
    for template in &TEMPLATES {
        assert!(page.contains(&format!("`{}`", template.name)), "{}", template.name);
        for line in template.text.lines().filter(|line| !line.starts_with(['#', '[', ' '])) {
            let key = line.split_once(" = ").map_or("", |(key, _)| key);
            assert!(page.contains(&format!("{key}`")) || key.starts_with('"'), "{key}");
        }
    }
}
