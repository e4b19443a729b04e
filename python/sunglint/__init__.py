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
    "Body",
    "Brdf",
    "Curve",
    "Error",
    "Field",
    "FitResult",
    "Light",
    "Result",
    "Scene",
    "StudyResult",
    "Table",
    "compare",
    "detect",
    "fit",
    "period",
    "read_photometry",
    "read_table",
    "reduce",
    "study",
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

    def __reduce__(self):
        return (Body, (self._model,))

    def __repr__(self):
        return f"<sunglint.Body {self.name}: {', '.join(self.materials)}>"


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

    def __repr__(self):
        return f"<sunglint.Curve {self.path}: {self.format}, {self.table.rows} samples>"


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
    return _path(curve), reading


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
    curves = list(curves) if isinstance(curves, (list, tuple)) else [curves]
    scenes = list(scene) if isinstance(scene, (list, tuple)) else [scene]
    scenes = [s if isinstance(s, Scene) else Scene(s) for s in scenes]
    if len(scenes) not in (1, len(curves)):
        raise ValueError(f"{len(scenes)} scenes and {len(curves)} curves: expected one scene, or one for each curve")
    inputs, how = [], None
    for i, curve in enumerate(curves):
        path, this = _file_and_reading(curve, reading)
        if how is not None and this != how:
            raise ValueError("the curves are read in different ways: give the same columns for all")
        how = this
        inputs.append(path)
        if len(scenes) > 1:
            inputs.append(scenes[i].path)
    if len(scenes) == 1:
        inputs.append(scenes[0].path)
    outcome, converged = _core.fit(
        inputs,
        how,
        [free] if isinstance(free, str) else list(free),
        list(per_pass),
        list(channels),
        scenes[0].station,
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
    curves = list(curves) if isinstance(curves, (list, tuple)) else [curves]
    paths, how = [], None
    for curve in curves:
        path, this = _file_and_reading(curve, reading)
        if how is not None and this != how:
            raise ValueError("the curves are read in different ways: give the same columns for all")
        how = this
        paths.append(path)
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
    if near_deg is not None and hasattr(near_deg, "icrs"):
        near_deg = (near_deg.icrs.ra.deg, near_deg.icrs.dec.deg)
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
            near_deg and [float(v) for v in near_deg],
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
        Points, tasks, shards, how many of them are missing, failed tasks, files with their SHA-256.
    """

    def __init__(self, folder, report):
        self.folder = folder
        self.report = report

    def __repr__(self):
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


def _study_part(study, output, station, part, of):
    """One part, in a worker: the results are in the folder, so that nothing has to travel."""
    _core.run_study(study, output, station, part, of, None)
    return part


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
        Only the k-th of n parts.
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
    The bytes of the results do not depend on who makes them. A worker that dies loses at most the shard it was at: its part is made again.
    """
    path, folder = _os.path.abspath(_path(study)), _os.path.abspath(_path(output))
    if client is not None:
        if part is not None:
            raise Error("part= goes without client=: the client's workers make all parts")
        _, _, shards = _core.size_of_study(path, station)
        if parts is None:
            threads = sum(client.nthreads().values())
            parts = max(1, min(shards, 4 * threads))
        numbers = range(1, parts + 1)
        work = client.map(lambda k: _study_part(path, folder, station, k, parts), numbers, pure=False, retries=5)
        client.gather(work)
    k, n = part or (1, 1)
    report = _json.loads(_core.run_study(path, folder, station, k, n, _callback(progress)))
    return StudyResult(folder, report)
