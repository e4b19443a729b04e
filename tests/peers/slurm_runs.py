"""The runs of slurm_study, which sets up Slurm: slurm_runs.py PROGRAM OBJECTS TASKS LEAST, in the folder for its files."""

import pathlib
import subprocess
import sys
import time

import cluster


def workers():
    """The tasks that run: all processes here are slurm_study's own."""
    for of in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            words = (of / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if words[0].endswith(b"sunglint") and b"--part" in words:
            yield int(of.name)


def main():
    program, objects, tasks, least = sys.argv[1], int(sys.argv[2]), sys.argv[3], float(sys.argv[4])
    work = pathlib.Path.cwd()
    study = cluster.inputs(work, objects)
    cpu_s = cluster.alone([program, "study", study, "-o", work / "alone", "--threads", "1", "-q"])
    seconds = {}
    for name, over in (("peace", cluster.Waits(workers)), ("killed", cluster.Kills(workers))):
        begun = time.monotonic()
        command = [program, "study", study, "-o", work / name, "--slurm", "--slurm-tasks", tasks, "--threads", "1", "-q"]
        with over:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            seconds[name] = time.monotonic() - begun
        if name == "peace":
            waits = over
        arrays = {path.name.split("_")[0] for path in (work / name / "log").iterdir()}
        print(f"{name}: arrays {len(arrays)}, of {tasks} tasks at most", flush=True)
    return cluster.verdict("Slurm, a slurmctld and a slurmd with two cores", work, objects, cpu_s, seconds["peace"], waits, seconds["killed"], over.count, least)


if __name__ == "__main__":
    sys.exit(main())
