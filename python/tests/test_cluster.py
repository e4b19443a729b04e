"""Dask: a cluster of processes makes a study, its workers are killed, the bytes are the same (python/check runs this)."""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import threading

import pytest

import sunglint as sg

dask = pytest.importorskip("dask.distributed")

PEERS = pathlib.Path(__file__).parent.parent.parent / "tests" / "peers"
sys.path.insert(0, str(PEERS))
import cluster


def files_of(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*.parquet")}


@pytest.fixture
def study(tmp_path):
    """A sphere for 40 radii, a pass each."""
    sg.demo_night(tmp_path)
    values = [round(0.1 + 0.05 * k, 2) for k in range(40)]
    (tmp_path / "study.toml").write_text(
        f'[study]\nscene = "sphere.toml"\nkeep = ["summary", "samples"]\ntasks_a_shard = 1\n[[parameter]]\nkey = "target.sphere.radius_m"\nvalues = {json.dumps(values)}\n'
    )
    return tmp_path / "study.toml"


@pytest.mark.parametrize("failures", [3, 0], ids=["dask tries again", "each kill fails a part"])
def test_workers_of_dask_make_the_same_bytes_and_may_be_killed(study, tmp_path, failures):
    """Truth: the same study in this process. Three kills of a random worker while parts are under way."""
    sg.study(study, tmp_path / "alone")
    import dask as settings

    with (
        settings.config.set({"distributed.scheduler.allowed-failures": failures}),
        dask.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None) as cluster,
        dask.Client(cluster) as client,
    ):
        ended = threading.Event()
        killed = []

        def kill():
            # The first within the first parts: all of them may be made in less than a second.
            while not ended.wait(1.0 if killed else 0.1) and len(killed) < 3:
                workers = [w.pid for w in cluster.workers.values() if w.pid]
                if workers:
                    killed.append(workers[len(killed) % len(workers)])
                    os.kill(killed[-1], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        try:
            made = sg.study(study, tmp_path / "dask", client=client, parts=20)
        finally:
            ended.set()
            killer.join()
    assert killed
    assert made.report["missing"] == 0 and made.report["failed"] == 0
    mine, theirs = files_of(tmp_path / "alone"), files_of(tmp_path / "dask")
    assert len(mine) == 80 and mine == theirs
    # Complete, no doubles: a row a value.
    table = made.summary()
    assert sorted(table["target.sphere.radius_m"]) == sorted(set(table["target.sphere.radius_m"])) and len(table) == 40


def test_a_worker_that_cannot_is_told(study, tmp_path):
    """A folder that only the client sees: an error with the worker's own, not the whole work done here."""
    with (
        dask.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None) as cluster,
        dask.Client(cluster) as client,
    ):
        def breaks():
            import sunglint

            def refuses(*_):
                raise OSError("this node sees no such folder")

            sunglint._core.run_study = refuses

        client.run(breaks)
        with pytest.raises(sg.Error, match="40 of 40 shards are missing after 2 rounds.*sees no such folder"):
            sg.study(study, tmp_path / "out", client=client, parts=4)
    assert not list((tmp_path / "out" / "summary").iterdir())


def test_what_is_missing_or_there_twice_is_seen(tmp_path):
    """The campaigns' own check (tests/peers/cluster.py) on twelve objects, whose shards are then lost, given twice, and cut."""
    made = sg.study(cluster.inputs(tmp_path, 12), tmp_path / "out")
    assert made.report["missing"] == 0
    many = cluster.passes(tmp_path / "out", 12)
    assert 0 < many == sum(made.summary()["status"] == "done")
    with pytest.raises(AssertionError, match="tasks are missing"):
        cluster.passes(tmp_path / "out", 13)
    summary, samples = (sorted((tmp_path / "out" / table).iterdir()) for table in ("summary", "samples"))
    full = max(range(len(samples)), key=lambda k: samples[k].stat().st_size)
    for file, table in ((summary[full], "summary"), (samples[full], "samples")):
        again = tmp_path / "out" / table / "again.parquet"
        shutil.copy(file, again)
        with pytest.raises(AssertionError, match="twice|too many"):
            cluster.passes(tmp_path / "out", 12)
        again.unlink()
    samples[full].unlink()
    with pytest.raises(AssertionError, match="samples are missing"):
        cluster.passes(tmp_path / "out", 12)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no cores to choose")
def test_waiting_is_told_from_working():
    """Two processes on one core, each with half a second of work. Truth: their own clocks of CPU time (5 %), and that one waits while the other works: half a second or more
    for both (less a fifth: the second begins later)."""
    code = "import time; input()\nwhile time.process_time() < 0.5: pass\nprint(time.process_time(), flush=True); input()"
    core = {min(os.sched_getaffinity(0))}
    children = [
        subprocess.Popen([sys.executable, "-S", "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, preexec_fn=lambda: os.sched_setaffinity(0, core))
        for _ in range(2)
    ]
    try:
        with cluster.Waits(lambda: [c.pid for c in children]) as waits:
            for child in children:
                child.stdin.write("\n")
                child.stdin.flush()
            own = sum(float(c.stdout.readline()) for c in children)
    finally:
        for child in children:
            child.kill()
            child.communicate()
    # What they took before the first look, to start, is theirs and not seen: less than a fifth.
    assert 0.8 * own < waits.cpu_s < 1.05 * own and waits.waited_s > 0.4, (own, waits.cpu_s, waits.waited_s)
