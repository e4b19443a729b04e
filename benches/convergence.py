#!/usr/bin/env python3
"""Error of light between surfaces against its cost, on concave bodies: stated, true, and the CPU time.

    cargo build --release -p sunglint-simulator --example convergence
    python3 benches/convergence.py target/release/examples/convergence [BUDGET_S] [TOLERANCE,...] [BODY,...]     # g++; a minute a body

The truth is `benches/convergence.cpp`, plain random paths that share no code with the engine; its standard error is beside it. All errors are of direct
and bounced light together, over eight pairs of directions; a sample is covered where it is within its stated error and three of the truth's.
"""
import json, math, os, statistics, subprocess, sys, tempfile

BODIES = "comb,torus,cup,tube,slit,corner,cavity,boxes"
PATHS = "2000000"


def lines(command, **options):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, **options).stdout.splitlines()


def main(program, budget="0.01", tolerances="1e-2,1e-3", bodies=BODIES):
    here = os.path.dirname(os.path.abspath(__file__))
    alone = dict(os.environ, RAYON_NUM_THREADS="1")
    with tempfile.TemporaryDirectory() as folder:
        rays, mesh, pairs = (os.path.join(folder, name) for name in ("rays", "mesh", "pairs"))
        subprocess.run(["g++", "-O3", "-o", rays, os.path.join(here, "convergence.cpp")], check=True)
        print("body    asked | stated: median, most | true: rms, most (sigma) | covered | stated/true | ready s, pair s")
        for body in bodies.split(","):
            with open(mesh, "w") as file:
                file.write("\n".join(lines([program, "mesh", body])))
            truth = None
            for tolerance in tolerances.split(","):
                rows = [json.loads(line) for line in lines([program, "light", body, tolerance, budget], env=alone)]
                if truth is None:
                    with open(pairs, "w") as file:
                        file.writelines(" ".join(map(repr, row["sun"] + row["to"])) + "\n" for row in rows)
                    truth = [tuple(map(float, line.split())) for line in lines([rays, mesh, pairs, PATHS])]
                report(body, tolerance, rows, truth)


def report(body, tolerance, rows, truth):
    most = max(row["direct"] + row["bounced"] for row in rows)
    # Nobody measures a share of next to no light.
    kept = [(row, *t, row["direct"] + t[0]) for row, t in zip(rows, truth) if row["direct"] + t[0] > 0.01 * most]
    stated = [row["stated"] / light for row, _, _, light in kept]
    off = [abs(row["bounced"] - value) / light for row, value, _, light in kept]
    sigma = [s / light for _, _, s, light in kept]
    rms = lambda values: math.sqrt(statistics.mean(v * v for v in values))
    covered = sum(o <= s + 3 * e for o, s, e in zip(off, stated, sigma))
    ratio = statistics.median(s / max(o, 1e-12) for s, o in zip(stated, off))
    print(
        f"{body:7} {tolerance} | {statistics.median(stated):.1e} {max(stated):.1e} | {rms(off):.1e} {max(off):.1e} ({rms(sigma):.0e}) | "
        f"{covered}/{len(kept)} | {ratio:.1f} | {rows[0]['prepared_s']:.2f} {statistics.mean(row['light_s'] for row in rows):.4f}",
        flush=True,
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
