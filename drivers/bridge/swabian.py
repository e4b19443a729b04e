#!/usr/bin/env python3
"""The bridge between sunglint and Swabian Instruments' Time Taggers.

sunglint starts it as a child process. It needs the vendor's package, which the user installs (`pip install
Swabian-TimeTagger`) and which sunglint never ships; the vendor's usage statistics are switched off before anything else.

Requests come on standard input, one a line: `JSON CRC` with `{"id":1,"op":"open", ...}` and the CRC-32 of the JSON's
bytes in 8 hexadecimal digits. The end of the input ends the bridge. Answers and data go to standard output in frames,
all little-endian:

    u32 length of the payload | u8 kind | u32 number of the frame, from 0 | payload | u32 CRC-32 of all before it

    J  JSON: {"id":1,"ok":{...}} or {"id":1,"error":{"code":"no_device","text":"..."}}; id null: a request that was not
       understood
    C  a finished bin: i64 start ps, i64 width ps, i64 when it was read (unix ns), u32 flags (1 overflow, 2 error, 4 lost
       reports), u32 n channels, n x u64 counts, n x u64 missed events. Without channels, in a stream that was asked for
       `stretches`: all tags from its start to its end were sent (the first, 1 ps long, says where the stream's time stands)
    T  time tags: n x 16 bytes (u8 type, u8 0, u16 missed, i32 channel, i64 time ps)

Standard error is a log. What the vendor's library prints goes there too.

`--module NAME --path FOLDER` takes a stand-in for the vendor's package, for tests of the plumbing: such a test says
nothing about a real Time Tagger.
"""

import argparse
import importlib
import json
import math
import os
import queue
import signal
import struct
import sys
import threading
import time
import zlib

PROTOCOL = 1
POLL_S = 0.02
# The vendor's ring of finished bins: this much time, within these numbers of bins.
RING_S, FEWEST_BINS, MOST_BINS = 600, 100, 1_000_000
# Room of a tag stream between two looks: 0.1 s at 40 million tags a second.
STREAM_EVENTS = 4_000_000
BLOCK = 65_536
LONGEST_LINE = 65_536
OVERFLOW, ERROR, LOST = 1, 2, 4
TYPE_ERROR, TYPE_BEGIN, TYPE_END, TYPE_MISSED = 1, 2, 3, 4


class Refusal(Exception):
    """A request that cannot be done: a code for the program, words for the person."""

    def __init__(self, code, text):
        super().__init__(text)
        self.code, self.text = code, text


def log(text):
    print(text, file=sys.stderr, flush=True)


def vendor_code(text):
    """The code of a message of the vendor's library (2.22.6)."""
    for part, code in (
        ("No Time Tagger attached", "no_device"),
        ("is not a valid Time Tagger serial number", "no_device"),
        ("No license file found", "no_licence"),
        ("Could not connect to Time Tagger server", "no_server"),
        ("could not open file", "bad_file"),
        ("could not be opened", "bad_file"),
        ("Incorrect Header", "bad_file"),
    ):
        if part in text:
            return code
    return "vendor"


class Output:
    """Frames on the real standard output; descriptor 1 becomes the log, so that nobody else can write between them."""

    def __init__(self):
        self.fd = os.dup(1)
        os.dup2(2, 1)
        self.number = 0

    def frame(self, kind, payload):
        head = struct.pack("<IcI", len(payload), kind, self.number)
        self.number = (self.number + 1) & 0xFFFFFFFF
        crc = zlib.crc32(payload, zlib.crc32(head))
        rest = memoryview(head + payload + struct.pack("<I", crc))
        while rest:
            rest = rest[os.write(self.fd, rest):]

    def json(self, value):
        self.frame(b"J", json.dumps(value, separators=(",", ":")).encode())


class Vendor:
    """The vendor's package, its statistics off, its log here."""

    def __init__(self, name, path):
        # The folder in which the user happens to be must not stand in for packages.
        sys.path = [entry for entry in sys.path if entry]
        if path:
            sys.path.insert(0, path)
        try:
            self.tt = importlib.import_module(name)
            import numpy
        except Exception as error:  # a broken package may raise anything
            raise Refusal("no_module", f"{type(error).__name__}: {error} (Python: {sys.executable})")
        self.np, self.errors = numpy, []
        off = self.tt.UsageStatisticsStatus_Disabled
        self.tt.setUsageStatisticsStatus(off)
        if self.tt.getUsageStatisticsStatus() != off:
            raise Refusal("statistics", "the package's usage statistics cannot be switched off")
        self.tt.setLogger(self.logged)

    def logged(self, level, text):
        log(f"vendor: {text}")
        if level >= getattr(self.tt, "LOGGER_ERROR", 40):
            del self.errors[:-20]
            self.errors.append(text)

    def records(self, buffer):
        """The 16-byte records of a buffer of tags, and their types."""
        np = self.np
        kinds = np.asarray(buffer.getEventTypes())
        records = np.zeros(len(kinds), np.dtype("<u1,<u1,<u2,<i4,<i8"))
        records["f0"] = kinds
        records["f2"] = buffer.getMissedEvents()
        records["f3"] = buffer.getChannels()
        records["f4"] = buffer.getTimestamps()
        return records, kinds


class Counting:
    """Finished bins, each handed over once, with what was missed meanwhile."""

    def __init__(self, bridge, channels, width, missed):
        self.bridge, self.channels, self.width = bridge, channels, width
        tt, tagger = bridge.vendor.tt, bridge.tagger
        bins = int(min(max(math.ceil(RING_S * 1e12 / width), FEWEST_BINS), MOST_BINS))
        self.counter = tt.Counter(tagger, channels, width, bins)
        self.stream = tt.TimeTagStream(tagger, STREAM_EVENTS, channels) if missed else None
        self.reports = []  # (time, type, channel, missed), not yet in a bin
        self.lost = False

    def stop(self):
        self.counter.stop()
        if self.stream:
            self.stream.stop()

    def collect(self):
        if not self.stream:
            return
        buffer = self.stream.getData()
        records, kinds = self.bridge.vendor.records(buffer)
        self.lost = self.lost or len(kinds) >= STREAM_EVENTS
        for i in self.bridge.vendor.np.flatnonzero(kinds):
            kind, _, missed, channel, at = records[i].item()
            self.reports.append((at, kind, channel, missed))
        self.reports.sort()

    def poll(self):
        data = self.counter.getDataObject(remove=True)
        read_ns = time.time_ns()
        # After the counter, so that what was reported within its bins has come.
        self.collect()
        size = int(data.size)
        if not size:
            return
        starts, counts, mask = data.getTime(), data.getData(), data.getOverflowMask()
        for i in range(size):
            start = int(starts[i])
            flags = OVERFLOW if mask[i] else 0
            missed = [0] * len(self.channels)
            # A report that comes late is booked in the bin that is next: none is lost, none counts twice.
            while self.reports and self.reports[0][0] < start + self.width:
                _, kind, channel, events = self.reports.pop(0)
                if kind == TYPE_MISSED and channel in self.channels:
                    missed[self.channels.index(channel)] += events
                elif kind == TYPE_ERROR:
                    flags |= ERROR
                else:
                    flags |= OVERFLOW
            if self.lost:
                flags |= LOST
                self.lost = False
            n = len(self.channels)
            values = [int(counts[c][i]) for c in range(n)]
            head = struct.pack("<qqqII", start, self.width, read_ns, flags, n)
            self.bridge.out.frame(b"C", head + struct.pack(f"<{2 * n}Q", *values, *missed))


class Streaming:
    """Raw tags; with `stretches`, after each look how far they are all there."""

    def __init__(self, bridge, channels, stretches):
        self.bridge, self.stretches, self.until = bridge, stretches, None
        self.stream = bridge.vendor.tt.TimeTagStream(bridge.tagger, STREAM_EVENTS, channels)

    def stop(self):
        self.stream.stop()

    def poll(self):
        buffer = self.stream.getData()
        read_ns = time.time_ns()
        records, _ = self.bridge.vendor.records(buffer)
        if len(records) >= STREAM_EVENTS:
            # Tags between this buffer and the next were not kept: that is an overflow, and it is data.
            log("the tag stream's buffer was full: tags were lost")
            gap = self.bridge.vendor.np.zeros(2, records.dtype)
            gap["f0"] = TYPE_BEGIN, TYPE_END
            gap["f4"] = records["f4"][-1], max(int(buffer.tGetData), int(records["f4"][-1]))
            records = self.bridge.vendor.np.concatenate([records, gap])
        self.bridge.tags(records)
        if self.stretches:
            self.stretch(int(buffer.tGetData), read_ns)

    def stretch(self, until, read_ns):
        # The first, 1 ps long, says where the stream's time stands.
        since = until - 1 if self.until is None else self.until
        if until != since:
            self.bridge.out.frame(b"C", struct.pack("<qqqII", since, until - since, read_ns, 0, 0))
            self.until = until


class Bridge:
    def __init__(self, arguments, out):
        self.arguments, self.out = arguments, out
        self.vendor = self.tagger = self.activity = None
        self.requests = queue.Queue()
        self.closing = False

    def read(self):
        """Requests, in a thread of its own."""
        while True:
            line = sys.stdin.buffer.readline(LONGEST_LINE)
            self.requests.put(line if line.endswith(b"\n") else None)
            if not line.endswith(b"\n"):
                return

    def run(self):
        threading.Thread(target=self.read, daemon=True).start()
        while not self.closing:
            try:
                line = self.requests.get(timeout=POLL_S if self.activity else None)
            except queue.Empty:
                self.poll()
                continue
            if line is None:
                break
            self.handle(line)
            if self.activity:
                self.poll()
        self.close({})

    def poll(self):
        try:
            self.activity.poll()
        except Exception as error:  # the vendor's library raises RuntimeError and others
            self.activity = None
            self.out.json({"id": None, "error": {"code": vendor_code(str(error)), "text": str(error)}})

    def request(self, line):
        text, _, crc = line.rstrip(b"\n").rpartition(b" ")
        if crc != b"%08x" % zlib.crc32(text):
            raise Refusal("bad_request", "a request came damaged")
        return json.loads(text)

    def handle(self, line):
        number = None
        try:
            request = self.request(line)
            number = request["id"]
            operation = getattr(self, "op_" + str(request["op"]), None)
            if operation is None:
                raise Refusal("bad_request", f"no operation {request['op']}")
            self.out.json({"id": number, "ok": operation(request)})
        except Refusal as refusal:
            self.out.json({"id": number, "error": {"code": refusal.code, "text": refusal.text}})
        except OSError:
            raise  # the host has gone
        except (KeyError, TypeError, ValueError) as error:
            text = f"{type(error).__name__}: {error}"
            self.out.json({"id": number, "error": {"code": "bad_request", "text": text}})
        except Exception as error:  # what the vendor's library raises
            text = str(error)
            self.out.json({"id": number, "error": {"code": vendor_code(text), "text": text}})

    def tags(self, records):
        for start in range(0, len(records), BLOCK):
            self.out.frame(b"T", records[start:start + BLOCK].tobytes())

    def need_tagger(self):
        if self.tagger is None:
            raise Refusal("not_open", "no Time Tagger is open")
        return self.tagger

    def known(self, channel):
        if channel not in self.opened:
            raise Refusal("no_channel", f"channel {channel} was not opened")
        return channel

    def op_hello(self, request):
        if request["protocol"] != PROTOCOL:
            raise Refusal("wrong_version", f"this bridge speaks version {PROTOCOL}, not {request['protocol']}")
        if self.vendor is None:
            self.vendor = Vendor(self.arguments.module, self.arguments.path)
        return {
            "protocol": PROTOCOL,
            "module": self.arguments.module,
            "version": str(self.vendor.tt.getVersion()),
            "statistics": "off",
        }

    def op_open(self, request):
        if self.vendor is None:
            raise Refusal("bad_request", "hello comes first")
        self.close({})
        channels = [int(channel) for channel in request["channels"]]
        tt = self.vendor.tt
        if request.get("address"):
            self.tagger = tt.createTimeTaggerNetwork(request["address"])
        else:
            self.tagger = tt.createTimeTagger(request.get("serial") or "")
        tagger = self.tagger
        there = [int(channel) for channel in tagger.getChannelList()]
        wrong = [channel for channel in channels if channel not in there]
        if wrong:
            self.close({})
            raise Refusal("no_channel", f"it has no channel {wrong[0]}, but {' '.join(map(str, there))}")
        self.opened = channels
        return {
            "serial": str(tagger.getSerial()),
            "model": str(tagger.getModel()),
            "firmware": str(tagger.getFirmwareVersion()),
        }

    def op_set(self, request):
        tagger, channel, value = self.need_tagger(), self.known(request["channel"]), request["value"]
        name = request["name"]
        if name == "trigger_level_v":
            tagger.setTriggerLevel(channel, float(value))
        elif name == "input_delay_ps":
            tagger.setInputDelay(channel, int(value))
        elif name == "dead_time_ps":
            tagger.setDeadtime(channel, int(value))
        elif name == "test_signal":
            tagger.setTestSignal(channel, bool(value))
        else:
            raise Refusal("bad_request", f"no setting {name}")
        return {"channel": channel, "value": self.settings(channel)[name]}

    def settings(self, channel):
        tagger = self.tagger
        return {
            "trigger_level_v": float(tagger.getTriggerLevel(channel)),
            "input_delay_ps": int(tagger.getInputDelay(channel)),
            "dead_time_ps": int(tagger.getDeadtime(channel)),
            "test_signal": bool(tagger.getTestSignal(channel)),
        }

    def op_settings(self, request):
        overflows = int(self.need_tagger().getOverflows())
        return {"channels": [self.settings(channel) for channel in self.opened], "overflows": overflows}

    def idle(self):
        self.need_tagger()
        if self.activity:
            raise Refusal("busy", "it counts or streams already: stop first")

    def op_counter(self, request):
        self.idle()
        width = int(request["binwidth_ps"])
        if width <= 0:
            raise Refusal("bad_request", f"a bin of {width} ps")
        self.activity = Counting(self, self.opened, width, bool(request["missed"]))
        return {"binwidth_ps": width, "channels": self.opened}

    def op_stream(self, request):
        self.idle()
        stretches = bool(request.get("stretches"))
        self.activity = Streaming(self, self.opened, stretches)
        return {"channels": self.opened, "stretches": stretches} if stretches else {"channels": self.opened}

    def op_stop(self, request):
        if self.activity:
            self.activity.stop()
            # What was measured up to now is handed over too.
            self.activity.poll()
        self.activity = None
        return {}

    def close(self, request):
        self.op_stop(request)
        if self.tagger is not None:
            tagger, self.tagger = self.tagger, None
            self.vendor.tt.freeTimeTagger(tagger)

    def op_close(self, request):
        self.close(request)
        self.closing = True
        return {}

    def op_convert(self, request):
        """A .ttbin file as tags. A damaged one seems to have data for ever (2.22.6): the vendor's log says what is wrong."""
        if self.vendor is None or self.activity:
            raise Refusal("busy", "say hello first, and stop what is measured")
        path, vendor = request["file"], self.vendor
        if not os.path.isfile(path):
            raise Refusal("bad_file", f"{path} is no file")
        del vendor.errors[:]
        reader = vendor.tt.FileReader(path)
        try:
            reader.getConfiguration()
        except ValueError:
            vendor.errors.append("it has no configuration")
        records = photons = 0
        while not vendor.errors and reader.hasData():
            block, kinds = vendor.records(reader.getData(BLOCK))
            if not len(block):
                vendor.errors.append("it says that there is more, and gives nothing")
                break
            self.tags(block)
            records += len(block)
            photons += len(block) - int(vendor.np.count_nonzero(kinds))
            if not self.requests.empty():
                raise Refusal("cancelled", f"stopped after {records} events")
        if vendor.errors:
            raise Refusal("bad_file", f"{path}, after {records} events: {vendor.errors[0]}")
        if not records:
            raise Refusal("bad_file", f"{path} holds no events")
        return {"records": records, "photons": photons}


def main():
    parser = argparse.ArgumentParser(description="sunglint's bridge to Swabian Time Taggers")
    parser.add_argument("--module", default="Swabian.TimeTagger", help="stand-in for the vendor's package, for tests")
    parser.add_argument("--path", default="", help="folder of the stand-in")
    arguments = parser.parse_args()
    # The host decides when it ends: Ctrl-C reaches every process of a terminal.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        Bridge(arguments, Output()).run()
    except BrokenPipeError:
        log("the host has gone")


if __name__ == "__main__":
    main()
