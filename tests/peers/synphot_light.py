# Rates, magnitudes and irradiances of the Sun and of Vega by synphot, from the tables that `sunglint tables NAME -o NAME.csv` wrote into a folder:
# a circle of 0.5 m, efficiency 0.5 from 500 to 600 nm; Johnson V.
import json
import sys

import numpy
import synphot
from astropy import units as u
from synphot import Observation, SourceSpectrum, SpectralElement, units
from synphot.models import Empirical1D


def table(name, band=None):
    lines = [line for line in open(f"{sys.argv[1]}/{name}.csv") if not line.startswith("#")][1:]
    rows = [line.strip().split(",") for line in lines]
    rows = [row[1:] for row in rows if row[0] == band] if band else rows
    return numpy.array([[float(v) for v in row] for row in rows]).T


def light(name):
    nm, irradiance = table(name)
    flux = units.convert_flux(10 * nm * u.AA, 100 * irradiance * units.FLAM, units.PHOTLAM)
    return SourceSpectrum(Empirical1D, points=10 * nm * u.AA, lookup_table=flux)


nm, throughput = table("johnson_ubv", "JOHNSON_V")
v = SpectralElement(Empirical1D, points=10 * nm * u.AA, lookup_table=throughput)
box = SpectralElement(
    Empirical1D, points=[4999.9, 5000, 6000, 6000.1] * u.AA, lookup_table=[0, 0.5, 0.5, 0]
)
area = numpy.pi * 25**2 * u.cm**2
vega = light("vega")


def of(source):
    seen = Observation(source, box, binset=numpy.arange(4990, 6010, 0.05))
    band = Observation(source, v)
    return {
        "rate_hz": seen.countrate(area).value,
        "v_mag": band.effstim("vegamag", vegaspec=vega).value + 0.03,
        "ab_mag": band.effstim("abmag").value,
        "irradiance": band.effstim("flam").value / 100,
    }


print(json.dumps({"version": synphot.__version__, "sun": of(light("sun")), "vega": of(vega)}))
