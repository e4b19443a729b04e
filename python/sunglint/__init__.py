"""Light curves of satellites and debris: simulate, reduce, compare, fit.

The workflows of the program ``sunglint`` on numpy arrays. Every number is the program's, to the last bit: both call the same Rust libraries.

Long calls run without the interpreter's lock, end at Ctrl-C, and take ``progress=``: a callable ``(stage, done, of)``, or a tqdm bar. Errors are :class:`Error`, with the attributes
``file``, ``line``, ``field`` and ``hint`` where they are known.

>>> import sunglint as sg
>>> body = sg.Body("box_wing")
>>> light = body.light(sun=[[1.0, 0.0, 0.0]], observer=[[0.0, 1.0, 0.0]])
>>> light.per_irradiance_m2_per_sr.shape
(1, 1)
"""

from __future__ import annotations

import json as _json
import os as _os
import tempfile as _tempfile
from dataclasses import dataclass as _dataclass

import numpy as _np

from . import _core
from ._core import Error, __version__

__all__ = [
    "ArchiveResult",
    "Body",
    "Brdf",
    "Calibration",
    "Curve",
    "Engine",
    "Error",
    "Field",
    "FitResult",
    "Light",
    "Material",
    "Night",
    "Reduced",
    "Result",
    "Scene",
    "Session",
    "StudyResult",
    "Table",
    "air",
    "apply",
    "archive",
    "attitude",
    "body_map",
    "calibrate",
    "compare",
    "demo_night",
    "detect",
    "fit",
    "fit_material",
    "fold",
    "ndf",
    "passes",
    "period",
    "read_photometry",
    "read_table",
    "reduce",
    "star",
    "study",
    "unmix",
    "__version__",
]


def _callback(progress):
    """A callable (stage, done, of) of a callable, a tqdm bar or None."""
    if progress is None or not hasattr(progress, "update"):
        return progress

    def tell(stage, done, of):
        if getattr(progress, "desc", None) != stage:
            progress.set_description(stage, refresh=False)
        progress.total = of
        progress.n = done
        progress.refresh()

    return tell


def _path(path):
    return _os.fspath(path)


def _utc(when):
    """ISO 8601 in UTC of a text, a datetime64, a datetime or an astropy Time."""
    if when is None or isinstance(when, str):
        return when
    if hasattr(when, "utc") and hasattr(when, "isot"):
        moment = when.utc.copy()
        moment.precision = 9
        return str(moment.isot) + "Z"
    if isinstance(when, _np.datetime64):
        return str(when.astype("datetime64[ns]")) + "Z"
    if hasattr(when, "astimezone"):
        import datetime

        if when.tzinfo is None:
            raise ValueError(f"{when!r} has no time zone: give one, or a text that ends with Z")
        return when.astimezone(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    raise TypeError(f"{type(when).__name__} is no time: expected text, datetime64, datetime or astropy Time")


def _value(quantity, unit):
    """A float or an array of a number or an astropy Quantity."""
    if quantity is not None and hasattr(quantity, "to_value"):
        return quantity.to_value(unit)
    return quantity


def _vectors(of):
    """(n, 3) float64 of an array, a list or an astropy CartesianRepresentation."""
    if hasattr(of, "cartesian"):
        of = of.cartesian
    if hasattr(of, "xyz"):
        xyz = of.xyz
        of = _np.asarray(getattr(xyz, "value", xyz)).T
    array = _np.ascontiguousarray(of, dtype=_np.float64)
    return array.reshape(1, 3) if array.shape == (3,) else array


class Table(dict):
    """Columns of a result: a dict of names and arrays, with ``units``, ``descriptions`` and ``meta``.

    Texts are object arrays; times are ISO 8601 texts in UTC, which :meth:`times` turns into ``datetime64[ns]``.
    """

    def __init__(self, name, columns, meta):
        super().__init__()
        self.name = name
        self.units = {}
        self.descriptions = {}
        self.meta = _json.loads(meta) if isinstance(meta, str) else meta
        for column in columns:
            values = column["values"]
            if isinstance(values, list):
                kinds = {type(v) for v in values}
                values = _np.array(values, dtype=bool if kinds == {bool} else object)
            self[column["name"]] = values
            self.units[column["name"]] = column["unit"]
            self.descriptions[column["name"]] = column["description"]

    def __reduce__(self):
        columns = [
            {"name": n, "unit": self.units[n], "description": self.descriptions[n], "values": v}
            for n, v in self.items()
        ]
        return (Table, (self.name, columns, self.meta))

    def __len__(self):
        return super().__len__()

    @property
    def rows(self):
        """Number of rows."""
        return len(next(iter(self.values()))) if self else 0

    def times(self, column="time_utc"):
        """A column of times as ``datetime64[ns]`` (UTC; within a leap second the last nanosecond before it)."""
        texts = [str(t).rstrip("Z") for t in self[column]]
        clean = [t.replace(":60", ":59.999999999", 1).split(".999999999.")[0] if ":60" in t[-13:] else t for t in texts]
        return _np.array(clean, dtype="datetime64[ns]")

    def to_pandas(self):
        """A ``pandas.DataFrame``; columns of vectors become one column for each component."""
        import pandas

        flat = {}
        for name, values in self.items():
            if getattr(values, "ndim", 1) == 2:
                for k in range(values.shape[1]):
                    flat[f"{name}_{k}"] = values[:, k]
            else:
                flat[name] = values
        return pandas.DataFrame(flat)

    def to_astropy(self):
        """An ``astropy.table.QTable`` with units."""
        from astropy import units
        from astropy.table import QTable

        table = QTable(meta=dict(self.meta))
        for name, values in self.items():
            unit = self.units[name]
            numeric = getattr(values, "dtype", None) is not None and values.dtype != object
            table[name] = values * units.Unit(unit) if unit and numeric else (values if numeric else values.astype(str))
        return table

    def __repr__(self):
        return f"<sunglint.Table {self.name}: {self.rows} rows, columns {', '.join(self)}>"


class Result:
    """A result: ``table`` (arrays), ``summary`` (the program's JSON), ``text``, ``warnings``, a figure.

    Attributes
    ----------
    name : str
        Name of the result, that of its files.
    table : Table
        Its main table; ``tables`` holds all, by name.
    summary : dict
        The document that the program prints with ``--json``; its keys are also items of the result.
    text : str
        What the program prints.
    warnings : list of str
        What a person should read before believing it.
    """

    def __init__(self, outcome):
        self._outcome = outcome
        self._state = None

    def _get(self, key):
        if self._state is not None:
            return self._state[key]
        return getattr(self._outcome, key)

    @property
    def name(self):
        """Name of the result."""
        return self._get("name")

    @property
    def text(self):
        """The summary that the program prints."""
        return self._get("text")

    @property
    def warnings(self):
        """Warnings that a person should read first."""
        return self._get("warnings")

    @property
    def files(self):
        """Other files of the result: a dict of names and texts."""
        return dict(self._get("files"))

    @property
    def summary(self):
        """The program's JSON as a dict."""
        return _json.loads(self.to_json())

    @property
    def tables(self):
        """All tables, by name."""
        if "_tables" not in self.__dict__:
            self._tables = {n: Table(n, c, m) for n, c, m in self._outcome.tables()}
        return self._tables

    @property
    def table(self):
        """The main table."""
        if not self.tables:
            raise Error(f"{self.name} has no table")
        return next(iter(self.tables.values()))

    def __getitem__(self, key):
        return self.summary[key]

    def to_dict(self):
        """The summary as a dict."""
        return self.summary

    def to_json(self):
        """The summary as JSON text, that of ``--json``."""
        return self._state["json"] if self._state is not None else self._outcome.json()

    def to_pandas(self):
        """The main table as a ``pandas.DataFrame``."""
        return self.table.to_pandas()

    def to_astropy(self):
        """The main table as an ``astropy.table.QTable``."""
        return self.table.to_astropy()

    def encode(self, form):
        """The bytes of a form: ``ecsv``, ``csv``, ``fits``, ``json``, ``html``, ``png`` or ``svg``."""
        if self._state is not None:
            if form in self._state["forms"]:
                return self._state["forms"][form]
            raise Error(f"an unpickled result has no {form}; it has {', '.join(self._state['forms'])}")
        return bytes(self._outcome.encode(form))

    def write(self, path):
        """Writes the form that the ending of the path names; what is there is not overwritten."""
        path = _path(path)
        data = self.encode(path.rsplit(".", 1)[-1].lower())
        with open(path, "xb") as file:
            file.write(data)

    def _file(self):
        """The main table as a file that lives as long as the result."""
        if "_kept" not in self.__dict__:
            self._kept = _tempfile.TemporaryDirectory(prefix="sunglint-")
            stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in self.name) or "result"
            self._path = _os.path.join(self._kept.name, f"{stem}.ecsv")
            with open(self._path, "wb") as file:
                file.write(self.encode("ecsv"))
        return self._path

    def plot(self, ax=None):
        """Draws the figure with matplotlib, as the program draws it; gives the axes."""
        import io

        from matplotlib import pyplot

        picture = pyplot.imread(io.BytesIO(self.encode("png")), format="png")
        if ax is None:
            _, ax = pyplot.subplots(figsize=(picture.shape[1] / 200, picture.shape[0] / 200))
        ax.imshow(picture)
        ax.set_axis_off()
        return ax

    @property
    def _has_figure(self):
        return self._get("has_figure")

    def __reduce__(self):
        forms = {}
        for form in ("ecsv", "svg", "png") if self._has_figure else ("ecsv",):
            try:
                forms[form] = self.encode(form)
            except Error:
                pass
        state = {k: self._get(k) for k in ("name", "text", "warnings", "files", "has_figure")}
        state.update(json=self.to_json(), forms=forms)
        return (_restored, (type(self), state, self.tables, {k: v for k, v in self.__dict__.items() if not k.startswith("_")}))

    def __repr__(self):
        return f"<sunglint.{type(self).__name__} {self.name}>"

    def __str__(self):
        return self.text

    def _repr_html_(self):
        import html

        figure = self.encode("svg").decode() if self._has_figure else ""
        return f"<pre>{html.escape(self.text)}</pre>{figure}"


def _restored(kind, state, tables, others):
    result = kind.__new__(kind)
    result._outcome = None
    result._state = state
    result._tables = tables
    result.__dict__.update(others)
    return result


class FitResult(Result):
    """A fit: a :class:`Result` with ``converged`` and the scenes with what was found.

    Attributes
    ----------
    converged : bool
        Whether the search ended at a minimum. If not, its intervals mean nothing.
    """

    def __init__(self, outcome, converged):
        super().__init__(outcome)
        self.converged = converged

    @property
    def scenes(self):
        """The scenes with what was found: a dict of file names and texts, which :class:`Scene` reads again."""
        return self.files


@_dataclass(frozen=True)
class Light:
    """The light of a body for n geometries at w wavelengths.

    Attributes
    ----------
    per_irradiance_m2_per_sr : ndarray (n, w)
        Radiant intensity over the Sun's irradiance, m² sr⁻¹.
    error_m2_per_sr : ndarray (n, w)
        Stated error of it, a bound.
    intensity_w_per_sr_nm : ndarray (n, w)
        Spectral radiant intensity under the Sun at its distance, W sr⁻¹ nm⁻¹.
    phase_deg : ndarray (n,)
        Phase angle.
    met : ndarray (n,) of bool
        Whether the stated error is within the tolerance.
    warnings : list of str
    """

    per_irradiance_m2_per_sr: _np.ndarray
    error_m2_per_sr: _np.ndarray
    intensity_w_per_sr_nm: _np.ndarray
    phase_deg: _np.ndarray
    met: _np.ndarray
    warnings: list

    def __len__(self):
        return len(self.phase_deg)


class Body:
    """A body that reflects: a built-in target (``box_wing``, ``hexagon`` …) or the file of one.

    Parameters
    ----------
    model : str or path
    """

    def __init__(self, model):
        self._model = _path(model)
        self._body = _core.Body(self._model)

    @property
    def name(self):
        """Name of the body."""
        return self._body.name

    @property
    def materials(self):
        """Names of its materials."""
        return self._body.materials

    @property
    def warnings(self):
        """Warnings of its file."""
        return self._body.warnings

    def light(self, sun, observer, wavelength_nm=(550.0,), range_m=None, sun_distance_au=None, tolerance=None, budget_s=None, progress=None):
        """The light for unit vectors to Sun and observer, body axes.

        Parameters
        ----------
        sun, observer : array_like (n, 3)
            Unit vectors; arrays of float64 are not copied. An astropy CartesianRepresentation will do.
        wavelength_nm : array_like or Quantity
            Vacuum wavelengths.
        range_m : array_like (n,) or Quantity, optional
            Distances to the observer; without them it is far away.
        sun_distance_au : float, optional
            Distance of the Sun; 1.
        tolerance : float, optional
            Model what may change the light by more than this share; 0.001.
        budget_s : float, optional
            Work that a geometry's light between surfaces may cost, CPU seconds.

        Returns
        -------
        Light
        """
        wavelengths = _np.atleast_1d(_value(wavelength_nm, "nm")).astype(float).tolist()
        distances = None
        sun, observer = _vectors(sun), _vectors(observer)
        if range_m is not None:
            distances = _np.ascontiguousarray(_np.broadcast_to(_value(range_m, "m"), (len(sun),)), dtype=float)
        found = self._body.light(
            sun, observer, wavelengths, distances, _value(sun_distance_au, "AU"), tolerance, budget_s, _callback(progress)
        )
        return Light(**found)

    def engine(self, wavelength_nm=(550.0,), range_m=None, sun_distance_au=None, tolerance=None, budget_s=None):
        """The light engine made once, for many calls with few geometries each.

        Parameters
        ----------
        wavelength_nm : array_like or Quantity
            Vacuum wavelengths.
        range_m : float or Quantity, optional
            The nearest distance of an observer; without it all are far away.
        sun_distance_au, tolerance, budget_s : float, optional
            As for :meth:`light`.

        Returns
        -------
        Engine
        """
        wavelengths = _np.atleast_1d(_value(wavelength_nm, "nm")).astype(float).tolist()
        return Engine(self, wavelengths, _value(range_m, "m"), _value(sun_distance_au, "AU"), tolerance, budget_s)

    def __reduce__(self):
        return (Body, (self._model,))

    def __repr__(self):
        return f"<sunglint.Body {self.name}: {', '.join(self.materials)}>"


class Engine:
    """A body's light engine for wavelengths: call it with (n, 3) unit vectors to Sun and observer.

    ``engine(sun, observer)`` gives a pair of arrays (n, w): radiant intensity over the Sun's irradiance, m² sr⁻¹, and its stated error. It keeps what
    :meth:`Body.light` makes anew for each call, and runs in the thread that calls: a call with one geometry costs microseconds.
    Many threads may call the same engine; the interpreter's lock is released for calls with more than a few geometries.

    Made by :meth:`Body.engine`.
    """

    def __init__(self, body, wavelength_nm, range_m, sun_distance_au, tolerance, budget_s):
        self._args = (wavelength_nm, range_m, sun_distance_au, tolerance, budget_s)
        self.body = body
        self.wavelength_nm = _np.array(wavelength_nm)
        self._engine = body._body.engine(*self._args)
        self._light = self._engine.light

    def __call__(self, sun, observer, range_m=None):
        """The light: arrays (n, w) of radiant intensity over irradiance, m² sr⁻¹, and of its stated error.

        Parameters
        ----------
        sun, observer : ndarray (n, 3) of float64
            Unit vectors, body axes. Other shapes and types are converted, which costs more than a geometry.
        range_m : ndarray (n,), optional
            Distances to the observer.
        """
        try:
            return self._light(sun, observer, range_m)
        except TypeError:
            if range_m is not None:
                range_m = _np.ascontiguousarray(_np.broadcast_to(_value(range_m, "m"), (len(_vectors(sun)),)), dtype=float)
            return self._light(_vectors(sun), _vectors(observer), range_m)

    def __reduce__(self):
        return (Engine, (self.body, *self._args))

    def __repr__(self):
        return f"<sunglint.Engine of {self.body.name} at {', '.join(f'{nm:g}' for nm in self.wavelength_nm)} nm>"


class Brdf:
    """A material as ``sunglint brdf show`` takes it: a ``.bsdf`` file, ``material.toml#name``, a table of samples.

    Parameters
    ----------
    name : str or path
    wavelength_nm : float
        Of a table that holds several wavelengths: which rows to read.
    """

    def __init__(self, name, wavelength_nm=550.0):
        self._args = (_path(name), float(_value(wavelength_nm, "nm")))
        self._brdf = _core.Brdf(*self._args)

    def evaluate(self, wavelength_nm, light, observer):
        """The BRDF, sr⁻¹, for (n, 3) unit vectors to light and observer; z is the normal, x the tangent. Below the surface it is 0."""
        return self._brdf.evaluate(float(_value(wavelength_nm, "nm")), _vectors(light), _vectors(observer))

    def albedo(self, wavelength_nm, theta_i_deg=0.0):
        """Hemispherical reflectance for light at an angle of incidence."""
        return self._brdf.albedo(float(_value(wavelength_nm, "nm")), float(_value(theta_i_deg, "deg")))

    def show(self, phi_i_deg=0.0):
        """What the material does at the wavelength that it was read for: reflectance, peak and width by angle of incidence, with a figure.

        Returns
        -------
        Result
        """
        name, nm = self._args
        return Result(_core.show_material(name, nm, float(_value(phi_i_deg, "deg"))))

    def _repr_html_(self):
        return self.show()._repr_html_()

    def __reduce__(self):
        return (Brdf, self._args)

    def __repr__(self):
        return f"<sunglint.Brdf {self._args[0]}>"


class Curve:
    """A measured light curve: a file of any kind that ``sunglint import`` understands, or arrays.

    Attributes
    ----------
    table : Table
        Columns ``time_utc``, ``magnitude`` and what else there is.
    format, target : str
    is_relative : bool
        Whether the zero point is unknown.
    notes : list of str
    """

    def __init__(self, path, reading, read, keep=None):
        self.path = path
        self._reading = reading
        self._keep = keep
        self.format = read["format"]
        self.target = read["target"]
        self.is_relative = read["is_relative"]
        self.notes = read["notes"]
        self._result = Result(read["outcome"])

    @property
    def table(self):
        """The samples."""
        return self._result.table

    def to_pandas(self):
        """The samples as a ``pandas.DataFrame``."""
        return self.table.to_pandas()

    @classmethod
    def from_arrays(cls, time_utc, magnitude, sigma_mag=None, filter=None, target="", exposure_s=None):
        """A curve of magnitudes in memory.

        Parameters
        ----------
        time_utc : sequence of str, datetime64 or astropy Time
        magnitude : array_like (n,)
        sigma_mag, exposure_s : array_like (n,) or float, optional
        filter : sequence of str or str, optional
        """
        if hasattr(time_utc, "isot"):
            moment = time_utc.utc.copy()
            moment.precision = 9
            times = [str(t) + "Z" for t in _np.atleast_1d(moment.isot)]
        else:
            times = [_utc(t) for t in time_utc]
        n = len(times)
        columns = {"time_utc": times, "magnitude": _np.broadcast_to(_value(magnitude, "mag"), (n,))}
        if sigma_mag is not None:
            columns["sigma_mag"] = _np.broadcast_to(_value(sigma_mag, "mag"), (n,))
        if exposure_s is not None:
            columns["exposure_s"] = _np.broadcast_to(_value(exposure_s, "s"), (n,))
        if filter is not None:
            columns["filter"] = [filter] * n if isinstance(filter, str) else list(filter)
        keep = _tempfile.TemporaryDirectory(prefix="sunglint-")
        stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in target) or "curve"
        path = _os.path.join(keep.name, f"{stem}.csv")
        with open(path, "w", encoding="utf-8") as file:
            file.write(",".join(columns) + "\n")
            for row in zip(*columns.values()):
                file.write(",".join(v if isinstance(v, str) else repr(float(v)) for v in row) + "\n")
        return read_photometry(path, _keep=keep)

    def plot(self, ax=None):
        """Draws magnitudes against seconds with matplotlib, a colour for each filter; gives the axes."""
        from matplotlib import pyplot

        if ax is None:
            _, ax = pyplot.subplots()
        times = self.table.times()
        seconds = (times - times.min()) / _np.timedelta64(1, "s")
        filters = self.table.get("filter")
        for name in sorted(set(filters)) if filters is not None else [None]:
            these = _np.ones(len(times), bool) if name is None else filters == name
            ax.plot(seconds[these], self.table["magnitude"][these], ".", ms=3, label=name)
        if filters is not None:
            ax.legend()
        ax.invert_yaxis()
        ax.set_xlabel(f"s after {times.min()}Z")
        ax.set_ylabel("magnitude")
        return ax

    def _repr_html_(self):
        import html

        return f"<pre>{html.escape(repr(self))}</pre>{self._result._repr_html_()}"

    def __reduce__(self):
        with open(self.path, "rb") as file:
            data = file.read()
        return (_curve_again, (_os.path.basename(self.path), data, self._reading))

    def __repr__(self):
        return f"<sunglint.Curve {self.path}: {self.format}, {self.table.rows} samples>"


def _curve_again(name, data, reading):
    """A curve in another process: its file travels with it."""
    keep = _tempfile.TemporaryDirectory(prefix="sunglint-")
    path = _os.path.join(keep.name, name)
    with open(path, "wb") as file:
        file.write(data)
    return Curve(path, reading, _core.read_photometry(path, reading), keep)


def _reading(time_column=None, time_scale=None, magnitude_column=None, sigma_column=None, magnitudes_as=None, sigma_mag=None):
    return dict(
        time_column=time_column,
        time_scale=time_scale,
        magnitude_column=magnitude_column,
        sigma_column=sigma_column,
        magnitudes_as=magnitudes_as,
        sigma_mag=sigma_mag,
    )


def read_photometry(path, time_column=None, time_scale=None, magnitude_column=None, sigma_column=None, _keep=None):
    """Reads a light curve of any program: ECSV, CSV, FITS tables, EOSSA, VOTable, TDM, ALCDEF, MMT-9.

    Parameters
    ----------
    path : str or path
    time_column, magnitude_column, sigma_column : str, optional
        Columns of a table whose names do not tell.
    time_scale : {'utc', 'tai', 'tt', 'tdb'}, optional
        Of times whose column names no scale.

    Returns
    -------
    Curve
    """
    reading = _reading(time_column, time_scale, magnitude_column, sigma_column)
    path = _path(path)
    return Curve(path, reading, _core.read_photometry(path, reading), _keep)


def read_table(path):
    """Reads a table in ECSV, as the program writes them.

    Returns
    -------
    Table
    """
    path = _path(path)
    columns, meta = _core.read_table(path)
    return Table(_os.path.basename(path), columns, meta)


def _file_and_reading(curve, options):
    """The file of a curve, and how it is read: options overrule what it was read with."""
    reading = _reading(**options)
    if isinstance(curve, Curve):
        reading = {k: v if v is not None else curve._reading[k] for k, v in reading.items()}
        return curve.path, reading
    return _file(curve), reading


def _file(of):
    """The path of a file, of a curve, or of a result, which is written for as long as it lives."""
    if isinstance(of, Curve):
        return of.path
    if isinstance(of, Result):
        return of._file()
    return _path(of)


def _air(air):
    """The air as the module takes it: every property, None where it is the station's own."""
    known = dict.fromkeys(("profile", "pressure_hpa", "ozone_du", "water_mm", "co2_ppm", "aerosol", "refraction"))
    units = {"pressure_hpa": "hPa", "water_mm": "mm"}
    for key, value in (air or {}).items():
        if key not in known:
            raise ValueError(f"air has no {key!r}; it has {', '.join(known)}")
        known[key] = _value(value, units[key]) if key in units else value
    return known


def _place(of):
    """Right ascension and declination, degrees, of a pair or an astropy SkyCoord."""
    if of is not None and hasattr(of, "icrs"):
        return (float(of.icrs.ra.deg), float(of.icrs.dec.deg))
    return of and (float(of[0]), float(of[1]))


def _several(of):
    return list(of) if isinstance(of, (list, tuple)) else [of]


class Scene:
    """A pass to simulate, compare and fit: a file ``PASS.toml``.

    Parameters
    ----------
    path : str or path
    station : str, optional
        A built-in name (``ufo``), a station.toml or its folder; the scene's own where it names one.
    """

    def __init__(self, path, station=None):
        self.path = _path(path)
        self.station = station
        if not _os.path.exists(self.path):
            raise Error(f"{self.path}: there is no such file")

    @classmethod
    def load(cls, path, station=None):
        """The same as ``Scene(path, station)``."""
        return cls(path, station)

    def simulate(self, start=None, end=None, step_s=None, tolerance=None, budget_s=None, progress=None):
        """Simulates the pass.

        Parameters
        ----------
        start, end : str, datetime, datetime64 or astropy Time, optional
            In place of the scene's.
        step_s : float or Quantity, optional
        tolerance : float, optional
            Model what may change the light by more than this share; 0.001.
        budget_s : float, optional
            Work that an epoch's light between surfaces may cost, CPU seconds.
        progress : callable or tqdm bar, optional

        Returns
        -------
        Result
            ``table`` has the magnitudes, rates and stated errors of each channel.
        """
        return Result(
            _core.simulate(
                self.path, self.station, _utc(start), _utc(end), _value(step_s, "s"), tolerance, budget_s, _callback(progress)
            )
        )

    def explain(self, tolerance=None):
        """What the pass needs, effect by effect, with bounds, reasons and costs."""
        return Result(_core.needs(self.path, self.station, tolerance))

    def compare(self, curve, **options):
        """The same as ``compare(curve, scene)``."""
        return compare(curve, self, **options)

    def __repr__(self):
        return f"<sunglint.Scene {self.path}>"


def compare(curve, scene, channels=(), tolerance=None, progress=None, **reading):
    """A measured pass beside the simulated one.

    Parameters
    ----------
    curve : Curve or path
    scene : Scene or path
    channels : sequence of str
        Only these.
    **reading
        ``time_column``, ``time_scale``, ``magnitude_column``, ``sigma_column``, ``magnitudes_as`` ('apparent', 'ground', '1000km', 'standard').

    Returns
    -------
    Result
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    path, reading = _file_and_reading(curve, reading)
    return Result(_core.compare(path, scene.path, reading, scene.station, list(channels), tolerance, _callback(progress)))


def _with_scenes(scene, curves, reading):
    """The files of curves and scenes in the order that the program takes them, how the curves are read, and the station."""
    curves, scenes = _several(curves), _several(scene)
    scenes = [s if isinstance(s, Scene) else Scene(s) for s in scenes]
    if len(scenes) not in (1, len(curves)):
        raise ValueError(f"{len(scenes)} scenes and {len(curves)} curves: expected one scene, or one for each curve")
    paths, how = _paths(curves, reading)
    if len(scenes) == 1:
        return [*paths, scenes[0].path], how, scenes[0].station
    return [f for path, scene in zip(paths, scenes) for f in (path, scene.path)], how, scenes[0].station


def fit(scene, curves, free=(), per_pass=(), channels=(), largest_albedo=None, scintillation=None, places=None, starts=None, iterations=None, seed=0, progress=None, **reading):
    """Fits a scene to measured passes.

    Parameters
    ----------
    scene : Scene or path, or a sequence with one for each curve
    curves : Curve or path, or a sequence of them
    free : sequence of str
        What is searched for: ``"albedo"``, ``"attitude.spin_axis"``, ``"size=0.5..2"`` …; beside those of ``[fit]`` of the scene.
    per_pass : sequence of str
        Parameters of which each curve has its own.
    seed : int
        Seed of the places that are looked at first.
    **reading
        ``time_column``, ``time_scale``, ``magnitude_column``, ``magnitudes_as``, ``sigma_mag``.

    Returns
    -------
    FitResult
    """
    inputs, how, station = _with_scenes(scene, curves, reading)
    outcome, converged = _core.fit(
        inputs,
        how,
        [free] if isinstance(free, str) else list(free),
        list(per_pass),
        list(channels),
        station,
        largest_albedo,
        scintillation,
        places,
        starts,
        iterations,
        seed,
        _callback(progress),
    )
    return FitResult(outcome, converged)


def period(curves, channels=(), shortest_s=None, longest_s=None, gap_s=None, harmonics=1, sessions="auto", station=None, progress=None, **reading):
    """The period of curves, with a verdict.

    Parameters
    ----------
    curves : Curve or path, or a sequence of them
    shortest_s, longest_s, gap_s : float or Quantity, optional
    harmonics : int
        Of the periodogram in table and figure.
    sessions : {'auto', 'joined', 'apart'}
        Whether several nights share a period with a zero point for each.
    station : str, optional
        Whose air is removed from rates.

    Returns
    -------
    Result
        ``result["verdict"]`` and the candidates; the table is the periodogram.
    """
    paths, how = _paths(curves, reading)
    return Result(
        _core.period(
            paths, how, list(channels), _value(shortest_s, "s"), _value(longest_s, "s"), _value(gap_s, "s"), harmonics, sessions, station, _callback(progress)
        )
    )


class Field:
    """Points and streaks of a frame.

    Attributes
    ----------
    points, streaks : list of dict
        The keys are those of ``sunglint detect --json``.
    fwhm_px, background_adu, noise_adu : float
    star_trails : tuple or None
        Length and direction of trailed stars, px and deg.
    """

    def __init__(self, found):
        self.__dict__.update(_json.loads(found))

    def __repr__(self):
        return f"<sunglint.Field: {len(self.points)} points, {len(self.streaks)} streaks>"


def detect(pixels, fwhm_px=None, point_sigma=None, streak_sigma=None, shortest_px=None, aperture_px=None, saturation_adu=None, gain_e_per_adu=None, is_mosaic=False):
    """Finds points and streaks in a frame.

    Parameters
    ----------
    pixels : array_like (rows, columns)
        ADU; NaN is masked.
    gain_e_per_adu : float, optional
        With it the noise of the light itself is counted.

    Returns
    -------
    Field
    """
    pixels = _np.ascontiguousarray(pixels, dtype=_np.float32)
    if pixels.ndim != 2:
        raise ValueError(f"pixels have {pixels.ndim} axes, expected 2: rows, columns")
    return Field(_core.detect(pixels, fwhm_px, point_sigma, streak_sigma, shortest_px, aperture_px, saturation_adu, gain_e_per_adu, is_mosaic))


def reduce(frames, place_px=None, along=1, darks=(), flats=(), fwhm_px=None, aperture_px=None, streak_sigma=None, catalogue=None, catalogue_mag=None, catalogue_colour=None, catalogue_system=None, near_deg=None, scale_arcsec=None, target_colour=None, colour_term=None, name=None, progress=None):
    """Reduces frames (FITS) of any program to a light curve.

    Parameters
    ----------
    frames : folder, or sequence of files
    place_px : (column, row), optional
        Place of the target in the first frame; else it is chosen by its motion.
    along : int
        Samples along each streak.
    catalogue : path, optional
        Stars with right ascension, declination and magnitudes: makes rates magnitudes.
    near_deg : (ra, dec) or SkyCoord, optional
        Place near the frames' middle, where their headers do not say it.

    Returns
    -------
    Result
        ``table`` has magnitudes, or rates without a catalogue; ``tables["frames"]`` the frames.
    """
    if isinstance(frames, (str, _os.PathLike)):
        top = _path(frames)
        if _os.path.isdir(top):
            endings = (".fits", ".fit", ".fts", ".fits.gz", ".fit.gz", ".fts.gz", ".fz")
            frames = []
            for folder, folders, files in _os.walk(top):
                folders.sort()
                if _os.path.relpath(folder, top).count(_os.sep) >= 3:
                    folders.clear()
                frames += [_os.path.join(folder, f) for f in sorted(files) if f.lower().endswith(endings)]
            if not frames:
                raise Error(f"{top}: no frame there; names of frames end with .fits, .fit or .fts")
            name = name or top
        else:
            frames = [top]
    near_deg = _place(near_deg)
    return Result(
        _core.reduce(
            [_path(f) for f in frames],
            place_px and list(place_px),
            along,
            [_path(f) for f in darks],
            [_path(f) for f in flats],
            fwhm_px,
            aperture_px,
            streak_sigma,
            catalogue and _path(catalogue),
            catalogue_mag,
            catalogue_colour and list(catalogue_colour),
            catalogue_system,
            near_deg and list(near_deg),
            _value(scale_arcsec, "arcsec"),
            target_colour and list(target_colour),
            colour_term,
            name,
            _callback(progress),
        )
    )


class StudyResult:
    """A study in its folder.

    Attributes
    ----------
    folder : str
    report : dict
        Points, tasks, shards, how many of them are missing, failed tasks, files with their SHA-256; of a part, its own alone.
    """

    def __init__(self, folder, report):
        self.folder = folder
        self.report = report

    def __repr__(self):
        if "part" in self.report:
            return f"<study {self.report['study']}, part {self.report['part']}: {self.report['shards']} shards in {self.folder}>"
        made = self.report["shards"] - self.report["missing"]
        return f"<study {self.report['study']}: {made} of {self.report['shards']} shards in {self.folder}>"

    def _table(self, name):
        import pandas

        return pandas.read_parquet(_os.path.join(self.folder, name))

    def summary(self):
        """A row a pass (or a task), as a pandas.DataFrame; needs pandas and pyarrow."""
        return self._table("summary")

    def samples(self):
        """A row a sample, as a pandas.DataFrame, of a study that keeps them; needs pandas and pyarrow."""
        return self._table("samples")


# Seconds that shards of parts that are done have to appear: NFS keeps a folder's names for up to a minute.
_GRACE_S = 65.0
# Rounds of parts one after the other that make no shard, before Dask's workers are given up.
_IDLE_ROUNDS = 2


def _study_part(study, output, station, usual, of, part):
    """One part, in a worker: the results are in the folder, so that nothing has to travel. Dask counts a task as one thread."""
    _core.run_study(study, output, station, usual, part, of, 1, None)
    return part


def _anywhere(station):
    """A station's name as another folder's process finds it."""
    if station is None or _path(station) in _core.built_in_stations():
        return station
    return _os.path.abspath(_path(station)) if _os.path.exists(_path(station)) else station


def _by_workers(client, path, folder, station, usual, parts, tell):
    """Has Dask's workers make the missing shards. A worker that dies loses its part: what is missing then is asked for again."""
    import functools
    import time

    shards, left = _core.missing_shards(path, folder, station, usual)
    if parts is None:
        parts = max(1, min(shards, 4 * sum(client.nthreads().values())))
    idle, rounds, failed = 0, 0, None
    while left and idle < _IDLE_ROUNDS:
        before, rounds = len(left), rounds + 1
        numbers = sorted({shard % parts + 1 for shard in left})
        part = functools.partial(_study_part, path, folder, station, usual, parts)
        work = client.map(part, numbers, pure=False, retries=5)
        try:
            told = None
            # Looked at and not gathered: a part whose workers died again and again must not end the others.
            while (done := sum(f.done() for f in work)) < len(work):
                if tell is not None and done != told:
                    tell("parts", done, len(work))
                    told = done
                time.sleep(0.05)
        except BaseException:
            client.cancel(work)
            raise
        fine = {n for n, f in zip(numbers, work) if f.status == "finished"}
        failed = next((f.exception() for f in work if f.status == "error"), failed)
        until = time.monotonic() + _GRACE_S
        while True:
            _, left = _core.missing_shards(path, folder, station, usual)
            if not any(shard % parts + 1 in fine for shard in left) or time.monotonic() > until:
                break
            time.sleep(0.5)
        idle = idle + 1 if len(left) == before else 0
    if left:
        why = f"; a worker's last error: {failed!r}" if failed is not None else "; they must see the same files under the same names"
        raise Error(f"{len(left)} of {shards} shards are missing after {rounds} rounds of parts, the last {idle} of which made none{why}") from failed


def study(study, output, station=None, part=None, client=None, parts=None, progress=None):
    """Runs a study (STUDY.toml), or goes on with it.

    Parameters
    ----------
    study : path
    output : folder
        What is there of the same study is kept.
    station : str, optional
        Built-in name, file or folder, in place of the scene's.
    part : (k, n), optional
        Only the k-th of n parts; the report is then that of the part.
    client : dask.distributed.Client, optional
        Its workers make the parts; they must see the same files under the same names.
    parts : int, optional
        Parts with a client: as many as the study has shards, at most 4 a thread of the workers.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    StudyResult

    Notes
    -----
    The bytes of the results do not depend on who makes them. A worker that dies loses at most the shard it was at: its part is asked for again.
    Each part takes one thread, as Dask counts it.
    """
    path, folder = _os.path.abspath(_path(study)), _os.path.abspath(_path(output))
    station, usual = _anywhere(station), _anywhere(_core.usual_station())
    if client is not None:
        if part is not None:
            raise Error("part= goes without client=: the client's workers make all parts")
        _by_workers(client, path, folder, station, usual, parts, _callback(progress))
    k, n = part or (1, 1)
    report = _json.loads(_core.run_study(path, folder, station, usual, k, n, None, _callback(progress)))
    return StudyResult(folder, report)


class ArchiveResult(Result):
    """Passes that an archive has: a :class:`Result` whose table has a row for each channel of each pass.

    Attributes
    ----------
    paths : list of str
        The files of the passes, in the order of time.
    """

    def __init__(self, outcome, asked):
        super().__init__(outcome)
        self.asked = asked
        found = self.summary
        self.paths = list(dict.fromkeys(_os.path.join(found["archive"], p["file"]) for p in found["passes"]))

    def curve(self):
        """The light of all these passes as one curve, which stands wherever a file of one is taken.

        Returns
        -------
        Result
        """
        folder, wanted, index = self.asked
        return Result(_core.archive(folder, wanted, index, False, True))


def archive(folder, object=None, channel=(), kind=(), station=None, start=None, end=None, phase_below_deg=None, phase_above_deg=None, min_samples=None, index=None, fresh=False, progress=None):
    """Which passes lie in the files of many nights: sessions, light curves, magnitudes of other programs.

    The first call reads all files, later ones those that changed.

    Parameters
    ----------
    folder : path
    object : int or str, optional
        Number in the catalogue, or the target's name.
    channel : str or sequence of str, optional
        Channels or filters.
    kind : str or sequence, optional
        ``recorded``, ``raw``, ``linear``, ``calibrated``, ``predicted``, ``magnitudes``; all that is measured without it.
    station : str, optional
        Name of the station.
    start, end : str, datetime, datetime64 or astropy Time, optional
        Passes within this time.
    phase_below_deg, phase_above_deg : float or Quantity, optional
        Passes with a sample at such a phase angle.
    min_samples : int, optional
    index : path, optional
        Folder of the index, in place of ``sunglint-archive`` in the folder.
    fresh : bool
        Read all files again.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    ArchiveResult
    """
    wanted = dict(
        object=None if object is None else str(object),
        channel=[channel] if isinstance(channel, str) else list(channel),
        kind=[kind] if isinstance(kind, str) else list(kind),
        station=station,
        start=_utc(start),
        end=_utc(end),
        phase_below_deg=_value(phase_below_deg, "deg"),
        phase_above_deg=_value(phase_above_deg, "deg"),
        min_samples=min_samples,
    )
    asked = (_path(folder), wanted, None if index is None else _path(index))
    return ArchiveResult(_core.archive(*asked, fresh, False, _callback(progress)), asked)


def star(name, at, station, to=None, step_s=60.0, exposure_s=0.1, place=None, v_mag=None, b_minus_v_mag=None, spectral_type=None, air=None, zero_point="vega=0.03"):
    """A star's place, airmass and expected rates: at a moment, or through a night.

    Parameters
    ----------
    name : str
        ``Vega``, ``alp Lyr``, ``HIP 91262``, ``HD 172167``; with ``place`` any name.
    at, to : str, datetime, datetime64 or astropy Time
        The moment, or begin and end of a light curve.
    station : str or path
    step_s, exposure_s : float or Quantity
    place : (ra, dec) in degrees or SkyCoord, optional
        A star of one's own; then ``v_mag`` and ``b_minus_v_mag`` or ``spectral_type`` are needed.
    air : dict, optional
        Known properties of the air: ``profile``, ``pressure_hpa``, ``ozone_du``, ``water_mm``, ``co2_ppm``, ``aerosol`` (a name, or optical depth and
        exponent), ``refraction``.
    zero_point : str
        ``vega=0.03`` or ``ab``.

    Returns
    -------
    Result
    """
    own = dict(place_deg=_place(place), v_mag=v_mag, b_minus_v_mag=b_minus_v_mag, spectral_type=spectral_type)
    return Result(
        _core.star(name, _utc(at), _path(station), own, _air(air), _utc(to), _value(step_s, "s"), _value(exposure_s, "s"), zero_point)
    )


def air(zenith_deg=(0, 30, 45, 60, 70, 80), wavelength_nm=None, mean_nm=None, station=None, altitude_m=None, apparent=False, components=False, **known):
    """What the air leaves of a direct beam.

    Parameters
    ----------
    zenith_deg : array_like or Quantity
    wavelength_nm : array_like or Quantity, optional
        Vacuum wavelengths; 300 to 1240 nm in steps of 1 nm, with means over 1 nm.
    mean_nm : float, optional
        Width of the means about each wavelength; values at the wavelengths without it.
    station : str or path, optional
        Else ``altitude_m`` says where.
    apparent : bool
        The zenith angles are refracted ones.
    components : bool
        Also the transmission of each constituent.
    **known
        Properties of the air, see :func:`star`.

    Returns
    -------
    Result
    """
    if wavelength_nm is None:
        wavelength_nm, mean_nm = _np.arange(300.0, 1241.0), mean_nm or 1.0
    angles = _np.atleast_1d(_value(zenith_deg, "deg")).astype(float).tolist()
    wavelengths = _np.atleast_1d(_value(wavelength_nm, "nm")).astype(float).tolist()
    station = station and _path(station)
    return Result(_core.air(angles, wavelengths, _air(known), _value(mean_nm, "nm"), station, _value(altitude_m, "m"), apparent, components))


def passes(elements, start, station, end=None, norad_id=(), name=(), min_elevation_deg=10.0, sun_below_deg=-6.0, min_culmination_deg=0.0, min_duration_s=0.0, brighter_than=None, limit=None, diameter_m=1.0, reflectance=0.2, standard_magnitude=None, model=None, attitude="orbit", tolerance=0.01, exposure_s=0.1, zero_point="vega=0.03", air=None, progress=None):
    """When satellites can be seen, how bright, and what the channels would count.

    Parameters
    ----------
    elements : path or sequence of paths
        Two lines, or OMM in JSON, CSV, XML or KVN.
    start, end : str, datetime, datetime64 or astropy Time
        A day without an end.
    station : str or path
    norad_id, name : sequence, optional
        Only these objects: by number, by a part of the name.
    min_elevation_deg, sun_below_deg : float or Quantity
        When a target is visible.
    min_culmination_deg, min_duration_s, brighter_than, limit : optional
        Which passes are listed.
    diameter_m, reflectance : float
        A diffuse sphere stands for every target,
    standard_magnitude : float, optional
        or this V at 1,000 km, half lit,
    model : str or path, optional
        or a body, turned by ``attitude``, whose light is calculated to ``tolerance``.

    Returns
    -------
    Result
        The figure is the plot of the sky.
    """
    numbers = [norad_id] if isinstance(norad_id, (int, str)) else list(norad_id)
    wanted = dict(
        norad_id=[str(n) for n in numbers],
        name=[name] if isinstance(name, str) else list(name),
        min_elevation_deg=_value(min_elevation_deg, "deg"),
        sun_below_deg=_value(sun_below_deg, "deg"),
        min_culmination_deg=_value(min_culmination_deg, "deg"),
        min_duration_s=_value(min_duration_s, "s"),
        brighter_than=brighter_than,
        limit=limit,
        diameter_m=_value(diameter_m, "m"),
        reflectance=reflectance,
        standard_magnitude=standard_magnitude,
        model=model and _path(model),
        attitude=_path(attitude),
        tolerance=tolerance,
        exposure_s=_value(exposure_s, "s"),
        zero_point=zero_point,
    )
    files = [_path(f) for f in _several(elements)]
    return Result(_core.passes(files, _utc(start), _utc(end), _path(station), wanted, _air(air), _callback(progress)))


class Night:
    """A virtual night: a plan (NIGHT.toml) that names a virtual observatory.

    Parameters
    ----------
    plan : str or path
        Devices of a real night are driven by the program (``sunglint observe``).
    """

    def __init__(self, plan):
        self.plan = _path(plan)
        if not _os.path.exists(self.plan):
            raise Error(f"{self.plan}: there is no such file")

    def observe(self, output, progress=None):
        """Observes the night, as fast as the computer can, into a folder that is not there yet.

        Returns
        -------
        Session
        """
        observed = Result(_core.observe_virtual(self.plan, _path(output), _callback(progress)))
        return Session(output, observed)

    def __repr__(self):
        return f"<sunglint.Night {self.plan}>"


def demo_night(folder, seed=0, progress=None):
    """The demonstration's night: two satellites that are made up cross an hour with stars to calibrate by.

    Writes plan, scenes and elements into a folder, and simulates the light of both scenes.

    Parameters
    ----------
    folder : path
        Made where it is not there; files in it are not overwritten.
    seed : int
        The same seed gives the same night, that of ``sunglint --seed N demo``.

    Returns
    -------
    Night
    """
    folder = _path(folder)
    _os.makedirs(_os.path.join(folder, "simulated"), exist_ok=True)
    for name, text in _core.demo_files(seed):
        with open(_os.path.join(folder, name), "x", encoding="utf-8") as file:
            file.write(text)
    for name in ("pass.toml", "sphere.toml"):
        simulated = Scene(_os.path.join(folder, name)).simulate(progress=progress)
        simulated.write(_os.path.join(folder, "simulated", f"{simulated.name}.ecsv"))
    return Night(_os.path.join(folder, "night.toml"))


class Session:
    """A recorded night: the folder that ``sunglint observe`` makes.

    Parameters
    ----------
    folder : str or path
    """

    def __init__(self, folder, _observed=None):
        self.folder = _path(folder)
        if not _os.path.exists(_os.path.join(self.folder, "session.toml")):
            raise Error(f"{self.folder}: there is no session (no session.toml)")
        self.observed = _observed

    def check(self):
        """Reads all of it and says what is there and what is missing.

        Returns
        -------
        Result
            ``is_whole`` says whether nothing is missing.
        """
        outcome, is_whole = _core.check_session(self.folder)
        result = Result(outcome)
        result.is_whole = is_whole
        return result

    def reduce(self, target=None, station=None, aperture_px=None, fwhm_px=None, gate=1.0, raw=False, progress=None):
        """Frames and counts become linear light curves, visit by visit.

        Parameters
        ----------
        target : str, optional
            Only the visits of this target.
        station : str or path, optional
            In place of the one that the session was recorded with.
        aperture_px, fwhm_px : float, optional
            As the session's own frames show them.
        gate : float or None
            Samples are kept with the target within this ellipse of the fibre's field.
        raw : bool
            Also the rates as they were counted.

        Returns
        -------
        Reduced
        """
        outcome, curves = _core.reduce_session(self.folder, target, station and _path(station), aperture_px, fwhm_px, gate, raw, _callback(progress))
        return Reduced(outcome, curves, station)

    def __repr__(self):
        return f"<sunglint.Session {self.folder}>"


class Reduced(Result):
    """A reduced session: a :class:`Result` with the linear curves of the visits.

    Attributes
    ----------
    curves : dict of str and Result
        By the names of their files: ``sphere_1`` …
    """

    def __init__(self, outcome, curves, station=None):
        super().__init__(outcome)
        self.station = station
        self.curves = {c.name: c for c in map(Result, curves)}

    def calibrate(self, station=None, **options):
        """The same as ``calibrate(reduced, station)``; the station is by default the one of the reduction."""
        return calibrate(self, station or self.station, **options)

    def __getitem__(self, key):
        return self.curves[key] if key in self.curves else super().__getitem__(key)


class Calibration(Result):
    """What channels and nights are worth: a :class:`Result` that makes linear curves calibrated ones."""

    _reduced = None

    def __init__(self, outcome, station=None, reduced=None):
        super().__init__(outcome)
        self.station = station
        self._reduced = reduced

    def apply(self, curve, **options):
        """The same as ``apply(calibration, curve, station)``; a name is that of a curve of the reduction.

        Returns
        -------
        Result
        """
        if isinstance(curve, str) and self._reduced is not None and curve in self._reduced.curves:
            curve = self._reduced.curves[curve]
        return apply(self, curve, self.station, **options)


def calibrate(curves, station, floor=None, clip_sigma=None, confidence=None, fit_aerosol=False, scintillation=None, zero_point="vega=0.03", seed=0, air=None):
    """The coefficient of every channel and night from visits to stars.

    Parameters
    ----------
    curves : Reduced, path, or a sequence of paths and results
        Linear light curves of stars, or folders of them; others are left out.
    station : str or path
    floor : float, optional
        Relative scatter of catalogued magnitudes and types at least; 0.02.
    clip_sigma : float, optional
        Standard deviations beyond which a visit is an outlier; 4.
    confidence : float, optional
        Coverage of the intervals; 0.95.
    fit_aerosol : bool
        Fit an aerosol's optical depth, too.
    seed : int
        Of the bootstrap.
    air : dict, optional
        See :func:`star`.

    Returns
    -------
    Calibration
    """
    reduced = curves if isinstance(curves, Reduced) else None
    if station is None:
        raise ValueError("station is missing: its built-in name, its file or folder")
    station = _path(station)
    if reduced is not None:
        # In one folder, as the program's: a folder's curves that are no stars' are passed over.
        with _tempfile.TemporaryDirectory(prefix="sunglint-") as folder:
            for name, curve in reduced.curves.items():
                if curve._get("name").endswith(("_frames", "_raw")):
                    continue
                with open(_os.path.join(folder, f"{name}.ecsv"), "wb") as file:
                    file.write(curve.encode("ecsv"))
            outcome = _core.calibrate([folder], station, _air(air), floor, clip_sigma, confidence, fit_aerosol, scintillation, zero_point, seed)
    else:
        files = [_file(c) for c in _several(curves)]
        outcome = _core.calibrate(files, station, _air(air), floor, clip_sigma, confidence, fit_aerosol, scintillation, zero_point, seed)
    return Calibration(outcome, station, reduced)


def apply(calibration, curve, station, night=None, spectrum=None, magnitudes=None, phase_law="lambert", zero_point="vega=0.03", air=None):
    """A linear light curve times its calibration.

    Parameters
    ----------
    calibration : Calibration or path
    curve : Result or path
    station : str or path
    night : str, optional
        Whose coefficient, as ``2020-11-18``; the curve's own.
    spectrum : str or path, optional
        The light's spectrum above the air: ``sun``, a star's type, or a file.
    magnitudes : str, optional
        A band: ``V``, ``Gaia_G`` …
    phase_law : {'lambert', 'illuminated'}
        For magnitudes at a standard phase angle.
    air : dict, optional
        See :func:`star`.

    Returns
    -------
    Result
        The calibrated curve; with ``spectrum`` or ``magnitudes`` its ``photometry`` is the table of magnitudes and irradiances.
    """
    keep = (air or {}).get("aerosol") is not None
    outcome, photometry = _core.apply(
        _file(calibration), _file(curve), _path(station), _air(air), night, spectrum and _path(spectrum), magnitudes, phase_law, keep, zero_point
    )
    result = Result(outcome)
    result.photometry = photometry and Result(photometry)
    return result


def fold(curves, period_s, period_sigma_s=None, epoch=None, scene=None, axis=None, bins=50, channels=(), station=None, keep=(), air=None, **reading):
    """Samples by their phase in a period.

    Parameters
    ----------
    curves : Curve, Result or path, or a sequence of them
    period_s, period_sigma_s : float or Quantity
    epoch : str, datetime, datetime64 or astropy Time, optional
        Where the phase is 0.
    scene : Scene or path, optional
        With ``axis``: phases are of the body, not of the light.
    axis : (ra, dec) in degrees or SkyCoord, optional
    keep : sequence of {'air', 'range', 'phase'}
        What is not divided out.
    air : dict, optional
        See :func:`star`.

    Returns
    -------
    Result
    """
    paths, how = _paths(curves, reading)
    if isinstance(scene, Scene):
        scene, station = scene.path, station or scene.station
    return Result(
        _core.fold(
            paths, how, _air(air), _value(period_s, "s"), _value(period_sigma_s, "s"), _utc(epoch), scene and _path(scene), _place(axis), bins, list(channels), station, list(keep)
        )
    )


def _paths(curves, reading):
    """The files of curves that are all read in one way."""
    paths, how = [], None
    for curve in _several(curves):
        path, this = _file_and_reading(curve, reading)
        if how is not None and this != how:
            raise ValueError("the curves are read in different ways: give the same columns for all")
        how = this
        paths.append(path)
    return paths, how


def unmix(curve, endmembers, scene=None, station=None, no_air=False, total_m2_sr=None, unweighted=False, confusion=False, air=None):
    """How much of a calibrated curve's light comes from which material.

    Parameters
    ----------
    curve : Result or path
    endmembers : sequence of str
        Materials: names or files.
    scene : Scene or path, optional
        Knows range and air; without it the curve and the station say them.
    total_m2_sr : float, optional
        The sum that the amounts have.
    confusion : bool
        Also how materials of the scene would be taken for one another.
    air : dict, optional
        See :func:`star`.

    Returns
    -------
    Result
    """
    if isinstance(scene, Scene):
        scene, station = scene.path, station or scene.station
    return Result(
        _core.unmix(_file(curve), [_path(e) for e in endmembers], _air(air), scene and _path(scene), station, no_air, total_m2_sr, unweighted, confusion)
    )


def body_map(scene, curve=None, endmembers=(), step_deg=5.0, phase_deg=None, along=False, ranges_nm=None):
    """Samples of a curve, or the light into all directions, on the body's frame.

    Parameters
    ----------
    scene : Scene or path
    curve : Result or path, optional
        Without it the scene's body is mapped over all directions.
    endmembers : sequence of str
        Materials whose shares are mapped.
    step_deg, phase_deg : float or Quantity
    along : bool
        Also the curve that the map gives along the pass.
    ranges_nm : float, optional
        Also maps of the range, for a laser of this wavelength.

    Returns
    -------
    Result
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    return Result(
        _core.body_map(
            scene.path,
            None if curve is None else _file(curve),
            [_path(e) for e in endmembers],
            _value(step_deg, "deg"),
            _value(phase_deg, "deg"),
            along,
            _value(ranges_nm, "nm"),
            scene.station,
        )
    )


def attitude(scene, curves, known=(), period_s=None, sense="both", scale="none", channels=(), axes=640, direct_only=False, seed=0, progress=None, **reading):
    """How a body of known shape spins, from its light.

    Parameters
    ----------
    scene : Scene or path, or a sequence with one for each curve
    curves : Curve, Result or path, or a sequence of them
    known : sequence of {'axis', 'phase', 'period'}
        What the scene's ``[attitude]`` gives.
    period_s : (float, float), optional
        The shortest and the longest to look for.
    sense : {'both', 'right', 'left'}
    scale : {'none', 'grey', 'channel', 'material'}
        Free factors of the brightness.
    axes : int
        Axes that are looked at first.

    Returns
    -------
    Result
        ``files`` holds the scene with the spin that was found.
    """
    inputs, how, station = _with_scenes(scene, curves, reading)
    return Result(
        _core.attitude(
            inputs, how, [known] if isinstance(known, str) else list(known), period_s and tuple(map(float, period_s)), sense, scale, list(channels), axes, direct_only, station, seed, _callback(progress)
        )
    )


class Material(Result):
    """A fitted material: a :class:`Result` with the text of its ``material.toml``."""

    @property
    def toml(self):
        """Text of the material's file; None where the fit is not faithful and was not accepted."""
        return self.files.get("material.toml")

    def brdf(self, wavelength_nm=550.0):
        """The material as a :class:`Brdf`."""
        if self.toml is None:
            raise Error(f"{self.name}: there is no material: " + "; ".join(self.warnings))
        folder = _tempfile.TemporaryDirectory(prefix="sunglint-")
        path = _os.path.join(folder.name, "material.toml")
        with open(path, "w", encoding="utf-8") as file:
            file.write(self.toml)
        brdf = Brdf(path, wavelength_nm)
        brdf._kept = folder
        return brdf


def ndf(table, zero_deg=None, most_offset_deg=5.0, median=None, tail=None, elevations=None, azimuths=None, resamplings=200, diffuse=True, seed=0):
    """The density of microfacet normals from a run of retro-reflection.

    Parameters
    ----------
    table : path or Result
        A table of ``sunglint brdf retro``.
    tail : {'ggx', 'beckmann', 'exponential', 'linear'}, optional
        Beyond the last angle; else the one that fits best.
    diffuse : bool
        Look for diffuse light and take it off.

    Returns
    -------
    Result
    """
    return Result(
        _core.ndf(_file(table), _value(zero_deg, "deg"), _value(most_offset_deg, "deg"), median, tail, elevations, azimuths, resamplings, diffuse, seed)
    )


def fit_material(table, wavelength_nm=None, floor_per_sr=None, laws=(), cone_deg=0.24, source_deg=0.0, theta_most_deg=85.0, most_lobes=3, name="fitted", accept=False, progress=None):
    """A material law through measured BRDF values.

    Parameters
    ----------
    table : path or Result
        Samples of a BRDF.
    laws : sequence of {'lambert', 'phong', 'abg', 'ward', 'beckmann', 'ggx', 'maxwell-beard'}, optional
        The best of these, with one lobe; without them a composite of up to ``most_lobes`` lobes.
    cone_deg, source_deg : float or Quantity
        Half-angles of detector and source.
    accept : bool
        Give the material although its peak or hemispherical reflectance are off.

    Returns
    -------
    Material
    """
    return Material(
        _core.fit_material(
            _file(table),
            _value(wavelength_nm, "nm"),
            floor_per_sr,
            [laws] if isinstance(laws, str) else list(laws),
            _value(cone_deg, "deg"),
            _value(source_deg, "deg"),
            _value(theta_most_deg, "deg"),
            most_lobes,
            name,
            accept,
            _callback(progress),
        )
    )
