"""What slurm_study and dask_study share: the study, who waited for a core, whether all is there once, and the verdict."""

import hashlib
import json
import os
import pathlib
import random
import resource
import signal
import subprocess
import threading
import time

SCENE = """
target = { name = "sphere", sphere = { radius_m = 1.0, reflectance = 0.3 } }
orbit = { tle = "catalogue.tle", norad_id = 10000 }
attitude = { law = "orbit" }
station = { name = "ufo" }
[times]
from = 2008-09-21T18:45:00Z
to = 2008-09-21T18:52:00Z
step_s = 20
"""
STUDY = """
[study]
scene = "pass.toml"
keep = ["summary", "samples"]
[passes]
elements = ["catalogue.tle"]
from = 2008-09-21T16:00:00Z
to = 2008-09-22T05:00:00Z
step_s = 1.0
"""
OBJECTS = 11200
MOST_KILLS = 12
WHAT = "a pass: a diffuse sphere on an orbit like the ISS's, looked for in 13 hours, a sample a second, six channels through the air"


def inputs(folder, objects):
    """Writes study, scene and a made-up catalogue (synthetic: the same orbit with other nodes, mean anomalies and numbers); the study's path."""

    def summed(line):
        return line + str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10) + "\n"

    with open(folder / "catalogue.tle", "w") as file:
        for i in range(objects):
            n = 10000 + i
            file.write(summed(f"1 {n:05d}U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  292"))
            file.write(summed(f"2 {n:05d}  51.6416 {(i * 137.508) % 360:8.4f} 0006703 130.5360 {(i * 61.8034) % 360:8.4f} 15.7212539156353"))
    (folder / "pass.toml").write_text(SCENE)
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


def alone(command):
    """Runs the study without a cluster; seconds of CPU, user and system."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


class Waits(threading.Thread):
    """CPU time of processes, and the time for which they wanted a core that somebody else had (/proc/PID/task/TID/schedstat), in seconds.

    On a machine that others use, too, the clock says little of a cluster: what the work waited for others is no loss of the cluster's. Looked at five times a second; what
    a process does after the last look is not seen, so that the waits are rather too short. Of the threads of a process the one counts that waited most between two looks:
    each process of the work has one that works.

    Parameters
    ----------
    pids : callable
        Gives the processes of the work at this moment.
    """

    def __init__(self, pids):
        super().__init__(daemon=True)
        self.pids, self.ended, self.seen = pids, threading.Event(), None
        self.cpu_s = self.waited_s = 0.0

    def look(self):
        seen = {}
        for pid in self.pids():
            waited = [0.0]
            try:
                for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
                    now = seen[task] = [1e-9 * int(ns) for ns in (task / "schedstat").read_text().split()[:2]]
                    # All that a thread did that is new; at the first look what was before is nobody's business.
                    before = now if self.seen is None else self.seen.get(task, (0.0, 0.0))
                    self.cpu_s += now[0] - before[0]
                    waited.append(now[1] - before[1])
            except (OSError, ValueError):
                pass  # It has ended.
            self.waited_s += max(waited)
        self.seen = seen

    def run(self):
        while not self.ended.wait(0.2):
            self.look()

    def __enter__(self):
        self.look()
        self.start()
        return self

    def __exit__(self, *_):
        self.ended.set()
        self.join()
        self.look()


class Kills(threading.Thread):
    """Kills a random worker (SIGKILL) twelve times at most: the first soon, the others after longer than a shard takes. Whoever kills faster, or for ever on a machine
    where a shard takes long, stops any program.

    Parameters
    ----------
    pids : callable
        Gives the workers that may be killed at this moment.
    """

    def __init__(self, pids):
        super().__init__(daemon=True)
        self.pids, self.ended, self.count = pids, threading.Event(), 0

    def run(self):
        while self.count < MOST_KILLS and not self.ended.wait(random.uniform(3, 6) if self.count else 0.1):
            alive = list(self.pids())
            if alive:
                # It has work under way.
                self.ended.wait(random.uniform(0.1, 0.4))
                try:
                    os.kill(random.choice(alive), signal.SIGKILL)
                    self.count += 1
                except ProcessLookupError:
                    pass

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.ended.set()
        self.join()


def digest(folder):
    """SHA-256 over the names and bytes of all tables."""
    whole = hashlib.sha256()
    for path in sorted(pathlib.Path(folder).rglob("*.parquet")):
        whole.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return whole.hexdigest()


def passes(folder, objects):
    """How many passes the tables hold; an error where a task is missing or failed, a pass or a sample stands there twice, or samples are missing."""
    import pyarrow.dataset

    summary = pyarrow.dataset.dataset(folder / "summary").to_table(["task", "pass", "norad_id", "status", "from_utc", "samples"]).to_pylist()
    assert {row["task"] for row in summary} == set(range(objects)), "tasks are missing"
    assert {row["status"] for row in summary} <= {"done", "no pass"}, "tasks failed"
    done = [row for row in summary if row["status"] == "done"]
    assert len({(row["norad_id"], row["from_utc"]) for row in done}) == len(done), "a pass twice"
    assert len({(row["task"], row["pass"]) for row in summary}) == len(summary), "a row twice"
    samples = pyarrow.dataset.dataset(folder / "samples").to_table(["task", "pass", "time_utc"])
    assert samples.num_rows == sum(row["samples"] for row in done), "samples are missing, or too many"
    assert samples.group_by(["task", "pass", "time_utc"]).aggregate([]).num_rows == samples.num_rows, "a sample twice"
    return len(done)


def verdict(name, work, objects, cpu_s, wall_s, waits, killed_s, kills, least):
    """Prints what was measured; 0 where all is there once, with the same bytes, and the efficiency is `least` or more.

    Parameters
    ----------
    cpu_s : float
        CPU time of the study in the folder ``alone``.
    wall_s, waits : float, Waits
        Those of the run in the folder ``peace``.
    killed_s, kills : float, int
        Those of the run in the folder ``killed``.
    """
    tables = {folder: digest(work / folder) for folder in ("alone", "peace", "killed")}
    same = len(set(tables.values())) == 1
    many = passes(work / "killed", objects)
    clock = cpu_s / (2 * wall_s)
    own = cpu_s / (2 * wall_s - waits.waited_s)
    said = {
        "cluster": name,
        "pass": WHAT,
        "objects": objects,
        "passes": many,
        "alone_cpu_s": round(cpu_s, 1),
        "two_cores_s": round(wall_s, 1),
        "workers_cpu_s": round(waits.cpu_s, 1),
        "workers_waited_for_others_s": round(waits.waited_s, 1),
        "efficiency": round(own, 3),
        "efficiency_by_the_clock": round(clock, 3),
        "expected": least,
        "workers_killed": kills,
        "with_kills_s": round(killed_s, 1),
        "same_bytes": same,
        "load": [round(load, 1) for load in os.getloadavg()],
    }
    print(json.dumps(said, indent=2))
    return 0 if same and own >= least and kills > 0 else 1
