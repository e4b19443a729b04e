"""Elements and ephemerides in the forms of others, and where other programs see the objects.

    python ephemeris/tests/peers/messages.py REPOSITORY FOLDER

Writes into FOLDER the same elements as OMM in JSON, CSV, XML and KVN (sgp4's exporter gives the values, ccsds-ndm writes KVN and reads XML back), the
places that sgp4's own OMM reader leads to, and an orbit as OEM and CPF in several frames, turned by astropy. No program here downloads anything.
"""
import csv
import io
import json
import sys

import numpy as np
from astropy import units as u
from astropy.coordinates import CartesianDifferential, CartesianRepresentation, GCRS, ITRS, TEME
from astropy.time import Time
from astropy.utils import iers
from ccsds_ndm.ndm_io import NDMFileFormats, NdmIo
from sgp4 import omm
from sgp4.api import Satrec, WGS72
from sgp4.exporter import export_omm

iers.conf.auto_download = False
repository, folder = sys.argv[1:3]

lines = open(f"{repository}/fixtures/orbits/SGP4-VER.TLE").read().splitlines()
ONES = [line[:69] for line in lines if line.startswith("1 ")]
TWOS = [line[:69] for line in lines if line.startswith("2 ")]
# Low orbits: sgp4's OMM reader starts SGP4 in its improved mode, which differs from ours for periods above 225 min.
CHOSEN = ("00005", "06251", "28057", "28872", "16925")
# One number of each length that the catalogue will have.
NUMBERS = (25544, 100001, 339999, 1234567, 12345678, 999999999)

UNITS = {"MEAN_MOTION": "rev/day", "INCLINATION": "deg", "RA_OF_ASC_NODE": "deg", "ARG_OF_PERICENTER": "deg", "MEAN_ANOMALY": "deg"}
MEAN = ["EPOCH", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY"]
TLE = ["EPHEMERIS_TYPE", "CLASSIFICATION_TYPE", "NORAD_CAT_ID", "ELEMENT_SET_NO", "REV_AT_EPOCH", "BSTAR", "MEAN_MOTION_DOT",
       "MEAN_MOTION_DDOT"]


def xml_of(fields):
    one = lambda key: f"<{key}>{fields[key]}</{key}>"
    return ('<omm id="CCSDS_OMM_VERS" version="2.0"><header><CREATION_DATE>2026-01-01T00:00:00</CREATION_DATE>'
            "<ORIGINATOR>TEST</ORIGINATOR></header><body><segment><metadata>"
            + "".join(one(key) for key in ("OBJECT_NAME", "OBJECT_ID", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "MEAN_ELEMENT_THEORY"))
            + "</metadata><data><meanElements>" + "".join(one(key) for key in MEAN) + "</meanElements><tleParameters>"
            + "".join(one(key) for key in TLE) + "</tleParameters></data></segment></body></omm>")


sets, truth = [], []
for first, second in zip(ONES, TWOS):
    if first[2:7] not in CHOSEN:
        continue
    satrec = Satrec.twoline2rv(first, second, WGS72)
    fields = export_omm(satrec, f"OBJECT {first[2:7].strip()}")
    fields = {key: (f"{value:.10f}".rstrip("0") if isinstance(value, float) and 1e-3 < abs(value) else value) for key, value in fields.items()}
    fields = {key: (format(value, ".12g") if isinstance(value, float) else value) for key, value in fields.items()}
    fields["NORAD_CAT_ID"] = NUMBERS[len(sets) % len(NUMBERS)]
    sets.append(fields)
    # What the independent reader is given: a number that it can hold.
    row = {key: str(value) for key, value in fields.items()} | {"NORAD_CAT_ID": "25544"}
    by_csv, text = Satrec(), io.StringIO()
    writer = csv.DictWriter(text, row.keys())
    writer.writeheader()
    writer.writerow(row)
    text.seek(0)
    omm.initialize(by_csv, next(omm.parse_csv(text)))
    by_xml = Satrec()
    omm.initialize(by_xml, next(omm.parse_xml(io.StringIO("<ndm>" + xml_of(row) + "</ndm>"))))
    places = []
    for minutes in (0.0, 7.5, 15.0, 45.0):
        day = by_csv.jdsatepochF + minutes / 1440.0
        error, position, _ = by_csv.sgp4(by_csv.jdsatepoch, day)
        other = by_xml.sgp4(by_csv.jdsatepoch, day)[1]
        assert error == 0 and np.allclose(other, position, rtol=0, atol=1e-7), (position, other)
        places.append([minutes, *position])
    truth.append({"number": fields["NORAD_CAT_ID"], "lines": [first, second], "places": places})

number = lambda key, value: value if key in ("EPOCH", "OBJECT_NAME", "OBJECT_ID", "CLASSIFICATION_TYPE") else json.loads(str(value))
constants = ("CENTER_NAME", "REF_FRAME", "TIME_SYSTEM", "MEAN_ELEMENT_THEORY")


class Raw(float):
    """A number that keeps its digits."""


def json_object(fields, quoted):
    """CelesTrak's form (numbers, no metadata), and Space-Track's (texts, null, keys of its own)."""
    texts = ("EPOCH", "OBJECT_NAME", "OBJECT_ID", "CLASSIFICATION_TYPE")
    pairs = [(key, value) for key, value in fields.items() if quoted or key not in constants]
    body = [f'{json.dumps(key)}: {json.dumps(str(value)) if quoted or key in texts else digits(value)}' for key, value in pairs]
    if quoted:
        body = ['"CCSDS_OMM_VERS": "3.0"', '"DECAY_DATE": null', '"TLE_LINE1": "1 ..."'] + body
    return "{" + ", ".join(body) + "}"


def digits(value):
    text = str(value)
    # JSON's numbers: no bare point at the end.
    return text + "0" if text.endswith(".") else text


with open(f"{folder}/sets.json", "w") as out:
    out.write("[" + ",\n".join(json_object(fields, False) for fields in sets) + "]\n")
with open(f"{folder}/space_track.json", "w") as out:
    out.write("[" + ",\n".join(json_object(fields, True) for fields in sets) + "]\n")
with open(f"{folder}/sets.csv", "w", newline="") as out:
    keys = [key for key in sets[0] if key not in constants]
    writer = csv.DictWriter(out, keys, extrasaction="ignore")
    writer.writeheader()
    writer.writerows(sets)
xml = '<?xml version="1.0" encoding="UTF-8"?>\n<ndm>\n' + "\n".join(xml_of(fields) for fields in sets) + "\n</ndm>\n"
open(f"{folder}/sets.xml", "w").write(xml)
kvn = []
for fields in sets:
    message = NdmIo().from_string(xml_of(fields))
    kvn.append(NdmIo().to_string(message, NDMFileFormats.KVN))
open(f"{folder}/sets.kvn", "w").write("\n".join(kvn) + "\n")
json.dump(truth, open(f"{folder}/truth.json", "w"))

# An orbit of half an hour, in a true place at each minute: the frames by astropy, with its own tables of the Earth's rotation.
table = iers.IERS_B.open()
iers.earth_orientation_table.set(table)
times = Time("2022-03-20T20:00:00", scale="utc") + np.arange(31) * u.min
satrec = Satrec.twoline2rv(*[next(line for line in rows if line[2:7] == "28057") for rows in (ONES, TWOS)], WGS72)
_, position, velocity = satrec.sgp4_array(np.full(31, 2453912.5), np.arange(31) / 1440.0)
teme = TEME(CartesianRepresentation(position.T * u.km, differentials=CartesianDifferential(velocity.T * u.km / u.s)), obstime=times)
itrs = teme.transform_to(ITRS(obstime=times))
gcrs = itrs.transform_to(GCRS(obstime=times))


def rows(frame):
    place, speed = frame.cartesian.xyz.to_value(u.km).T, frame.cartesian.differentials["s"].d_xyz.to_value(u.km / u.s).T
    return [(time, *p, *v) for time, p, v in zip(times, place, speed)]


# GCRS to the mean equator and equinox of J2000: ERFA's bias matrix.
import erfa
bias, _, _ = erfa.bp06(2451545.0, 0.0)
eme = [(r[0], *(bias @ np.array(r[1:4])), *(bias @ np.array(r[4:7]))) for r in rows(gcrs)]
SCALES = {"UTC": "utc", "TAI": "tai", "TT": "tt"}
for name, scale, body in (("GCRF", "UTC", rows(gcrs)), ("EME2000", "TT", eme), ("TEME", "TAI", rows(teme)), ("ITRF2014", "UTC", rows(itrs))):
    text = (f"CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2022-03-20T00:00:00\nORIGINATOR = TEST\n\nMETA_START\nOBJECT_NAME = CBERS 2\nOBJECT_ID = 2003-049A\n"
            f"CENTER_NAME = EARTH\nREF_FRAME = {name}\nTIME_SYSTEM = {scale}\nSTART_TIME = {getattr(times[0], SCALES[scale]).isot}\n"
            f"STOP_TIME = {getattr(times[-1], SCALES[scale]).isot}\nMETA_STOP\n\n")
    for time, *numbers in body:
        text += f"{getattr(time, SCALES[scale]).isot} " + " ".join(f"{value:.9f}" for value in numbers) + "\n"
    open(f"{folder}/{name}.oem", "w").write(text)
    message = NdmIo().from_string(text)
    open(f"{folder}/{name}.xml", "w").write(NdmIo().to_string(message, NDMFileFormats.XML))
# CPF, version 2.
text = ("H1 CPF  2  TST 2022 03 20 19  0790 01 cbers2     synthetic\n"
        "H2  0304901 9999    28057 2022 03 20 20 00 00 2022 03 20 20 30 00    60 1 1  0 0 0 1\nH9\n")
for time, *numbers in rows(itrs):
    day = int(np.floor(time.mjd))
    second = (time - Time(day, format="mjd", scale="utc")).to_value(u.s)
    text += f"10 0 {day} {second:13.6f} 0 " + " ".join(f"{value * 1e3:17.3f}" for value in numbers[:3]) + "\n"
    text += "20 0 " + " ".join(f"{value * 1e3:19.6f}" for value in numbers[3:]) + "\n"
open(f"{folder}/cbers2.cpf", "w").write(text + "99\n")
json.dump([[time.utc.isot, *numbers] for time, *numbers in rows(gcrs)], open(f"{folder}/gcrs.json", "w"))
