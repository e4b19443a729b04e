"""Dask: a cluster of processes makes a study, its workers are killed, the bytes are the same (python/check runs this)."""

import json
import os
import signal
import threading
import time

import pytest

import sunglint as sg

dask = pytest.importorskip("dask.distributed")


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
