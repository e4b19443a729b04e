"""Serves alpaca-simulators on 127.0.0.1 with a port of its own, which it prints.

The package's camera asks a catalogue in the internet for its stars. Here they are three dozen Gaussians of numpy instead, as wide as the package's seeing,
which follows its focuser: 1.2 px at position 10,000 and wider by 1.2 px for each 100 steps, up to five times. What is served, how, and in which order, is the package's.
"""
import os
import socket
import sys

import cabaret
import numpy

os.environ["ASTRA_SIMULATORS_CONFIG"] = "config.yaml"


def generate_image(self, ra, dec, exp_time, light=1, **_):
    random = numpy.random.default_rng(7)
    noise = numpy.random.default_rng()
    width, height = self.camera.width, self.camera.height
    sigma = 1.2 * self.site.seeing
    rows, columns = numpy.mgrid[0:height, 0:width]
    frame = noise.normal(200.0, 8.0, (height, width))
    # The first pixels of row 0 count up: which index is the column can be seen.
    for _ in range(36):
        x, y = random.uniform(0, width), random.uniform(0, height)
        flux = random.uniform(3e4, 1.5e5)
        left, right = max(0, int(x - 40)), min(width, int(x + 41))
        low, high = max(0, int(y - 40)), min(height, int(y + 41))
        part = numpy.s_[low:high, left:right]
        spot = numpy.exp(-((columns[part] - x) ** 2 + (rows[part] - y) ** 2) / (2 * sigma**2))
        frame[part] += flux / (2 * numpy.pi * sigma**2) * spot
    frame[0, :5] = [1000, 1001, 1002, 1003, 1004]
    return numpy.clip(numpy.round(frame), 0, 65535).astype(numpy.uint16)


cabaret.Observatory.generate_image = generate_image

import uvicorn  # noqa: E402
from alpaca_simulators.main import app  # noqa: E402
from alpaca_simulators.state import update_device_state  # noqa: E402

listener = socket.socket()
listener.bind(("127.0.0.1", 0))
print(listener.getsockname()[1], flush=True)
if sys.argv[2:]:
    # ASCOM: 2 is a German mount. It starts freed.
    update_device_state("telescope", 0, {"alignmentmode": int(sys.argv[2]), "atpark": False})
config = uvicorn.Config(app, log_level="critical", timeout_keep_alive=int(sys.argv[1]) if sys.argv[1:] else 300)
uvicorn.Server(config).run(sockets=[listener])
