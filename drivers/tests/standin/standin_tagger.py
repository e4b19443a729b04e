"""A stand-in for the vendor's package `Swabian.TimeTagger`, for tests of the bridge's plumbing. It is ours: what it does says
nothing about a real Time Tagger. Names and shapes are those of version 2.22.6.

Its clock is the computer's, from the moment of opening on. In each bin channel c counts 1000 * c + the bin's number; a
stream has a tag on each channel every millisecond. In the fourth bin of a counter there is an overflow in which channel 2
misses 77 events; the report of 5 more comes late. It also prints to standard output, as a library may.
"""

import os
import time

import numpy as np

UsageStatisticsStatus_Disabled = 0
LOGGER_ERROR = 40
_status = 2
_logger = None
MS = 1_000_000_000


def getVersion():
    return "0.0-standin"


def setUsageStatisticsStatus(status):
    global _status
    if os.environ.get("STANDIN") != "statistics":
        _status = status


def getUsageStatisticsStatus():
    return _status


def setLogger(callback):
    global _logger
    _logger = callback


class Tagger:
    def __init__(self, serial):
        self.serial, self.begun = serial, time.monotonic_ns()
        self.levels, self.delays, self.dead, self.tests = {}, {}, {}, {}
        self.stream = None

    def now(self):
        return (time.monotonic_ns() - self.begun) * 1000

    def getChannelList(self):
        return [c for n in range(1, 19) for c in (n, -n)]

    def getSerial(self):
        return self.serial

    def getModel(self):
        return "Time Tagger Stand-in"

    def getFirmwareVersion(self):
        return "fw 0"

    def getOverflows(self):
        return 1

    def setTriggerLevel(self, channel, level):
        if abs(level) > 2.5:
            raise RuntimeError(f"Trigger level {level} V is out of range for channel {channel}.")
        self.levels[channel] = round(level * 1000) / 1000

    def getTriggerLevel(self, channel):
        return self.levels.get(channel, 0.5)

    def setInputDelay(self, channel, delay):
        self.delays[channel] = delay

    def getInputDelay(self, channel):
        return self.delays.get(channel, 0)

    def setDeadtime(self, channel, value):
        self.dead[channel] = max(2100, value)
        return self.dead[channel]

    def getDeadtime(self, channel):
        return self.dead.get(channel, 2100)

    def setTestSignal(self, channel, on):
        self.tests[channel] = on

    def getTestSignal(self, channel):
        return self.tests.get(channel, False)


def createTimeTagger(serial=""):
    print("this line must not come between the frames")
    os.system("echo neither must this one")
    if serial == "crash":
        os.write(2, b"terminate called after throwing an instance of 'TimeTaggerError'\n")
        os.abort()
    if serial not in ("", "standin"):
        raise RuntimeError("No Time Tagger attached or already in use. Got the USB error 'Failed'.")
    return Tagger("standin")


def createTimeTaggerNetwork(address):
    raise RuntimeError(f"Could not connect to Time Tagger server at {address}.")


def freeTimeTagger(tagger):
    # The host has closed the input, or asked for it: that this ran can be seen.
    if os.environ.get("STANDIN_FREED"):
        with open(os.environ["STANDIN_FREED"], "w") as file:
            file.write("freed")


class Buffer:
    def __init__(self, events, now):
        self.events, self.size, self.tGetData = events, len(events), now

    def column(self, i, dtype):
        return np.array([event[i] for event in self.events], dtype)

    def getTimestamps(self):
        return self.column(0, np.int64)

    def getEventTypes(self):
        return self.column(1, np.uint8)

    def getChannels(self):
        return self.column(2, np.int32)

    def getMissedEvents(self):
        return self.column(3, np.uint16)


class TimeTagStream:
    def __init__(self, tagger, n_max_events, channels):
        self.tagger, self.channels, self.at = tagger, channels, tagger.now() // MS + 1
        self.extra = []
        tagger.stream = self

    def getData(self):
        now = self.tagger.now()
        events, self.extra = self.extra, []
        while self.at * MS < now:
            events += [(self.at * MS, 0, channel, 0) for channel in self.channels]
            self.at += 1
        return Buffer(sorted(events), now)

    def stop(self):
        pass


class CounterData:
    def __init__(self, bins):
        self.bins, self.size, self.dropped_bins = bins, len(bins), 0

    def getTime(self):
        return np.array([b[0] for b in self.bins], np.int64)

    def getOverflowMask(self):
        return np.array([b[1] for b in self.bins], np.int8)

    def getData(self):
        return np.array([b[2] for b in self.bins], np.int32).T


class Counter:
    def __init__(self, tagger, channels, binwidth, n_values):
        self.tagger, self.channels, self.width = tagger, channels, binwidth
        self.begun, self.number = tagger.now(), 0

    def getDataObject(self, remove=False):
        assert remove, "a look without taking would count twice"
        bins = []
        while self.begun + (self.number + 1) * self.width <= self.tagger.now():
            n, start = self.number, self.begun + self.number * self.width
            bins.append((start, n == 3, [1000 * abs(c) + n for c in self.channels]))
            if n == 3 and self.tagger.stream:
                middle = start + self.width // 2
                self.tagger.stream.extra += [(middle, 2, 0, 0), (middle + 1, 4, 2, 77), (middle + 2, 3, 0, 0)]
            if n == 5 and self.tagger.stream:
                # A report that lies in a bin that was handed over long ago.
                self.tagger.stream.extra.append((start - self.width, 4, 2, 5))
            self.number += 1
        return CounterData(bins)

    def stop(self):
        pass


class FileReader:
    """Files: `good` has 100,000 tags, `damaged` says that it holds data, as the vendor's does (2.22.6)."""

    def __init__(self, path):
        self.kind, self.left = open(path).read().strip(), 100_000

    def getConfiguration(self):
        if self.kind == "damaged":
            _logger(LOGGER_ERROR, "Incorrect Header (TimeTaggerFileIO.cpp:465)")
            raise ValueError("Expecting value: line 1 column 1 (char 0)")
        return {}

    def hasData(self):
        return self.kind == "damaged" or (self.kind == "good" and self.left > 0)

    def getData(self, n):
        n = min(n, self.left)
        first = 100_000 - self.left
        self.left -= n
        events = [(i * 10, 4 if i == 500 else 0, 1 + i % 3, 9 if i == 500 else 0) for i in range(first, first + n)]
        return Buffer(events, 0)
