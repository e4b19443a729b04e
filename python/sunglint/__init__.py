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
from collections.abc import Mapping as _Mapping
from dataclasses import dataclass as _dataclass

import numpy as _np

from . import _core
from ._core import Error, __version__

__all__ = [
    "Applied",
    "ArchiveResult",
    "Assembled",
    "Body",
    "Brdf",
    "Calibration",
    "Curve",
    "Device",
    "Engine",
    "Error",
    "Field",
    "FitResult",
    "Frame",
    "Light",
    "Material",
    "MaterialLight",
    "Night",
    "Readings",
    "Reduced",
    "Result",
    "Scene",
    "Session",
    "StudyResult",
    "Table",
    "air",
    "aperture",
    "apply",
    "archive",
    "assemble",
    "attitude",
    "body_map",
    "calibrate",
    "compare",
    "demo_night",
    "detect",
    "devices",
    "drivers",
    "fit",
    "fit_material",
    "fold",
    "ndf",
    "passes",
    "period",
    "plan",
    "read_photometry",
    "read_table",
    "reduce",
    "retro",
    "star",
    "study",
    "track",
    "unmix",
    "virtual_night",
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
    return _os.fsdecode(path)


def _whole(value, name, least=0):
    """A whole number that is no less than ``least``."""
    import operator

    number = operator.index(value)
    if number < least:
        raise Error(f"{name} is {number}, expected a whole number of {least} or more")
    return number


def _unmasked(of):
    """An array whose masked elements are NaN; anything else as it is."""
    if not _np.ma.isMaskedArray(of):
        return of
    return of.astype(float).filled(_np.nan) if _np.ma.is_masked(of) else of.data


def _utc(when):
    """ISO 8601 in UTC of a text, a datetime64, a datetime or an astropy Time."""
    if when is None or isinstance(when, str):
        return when
    if hasattr(when, "utc") and hasattr(when, "isot"):
        moment = when.utc.copy()
        moment.precision = 9
        return str(moment.isot) + "Z"
    if isinstance(when, _np.datetime64):
        # Nanoseconds reach from 1678 to 2262 only, and wrap around beyond.
        year = str(when.astype("datetime64[Y]"))
        if not ("1700" <= year <= "2200" and len(year) == 4):
            raise ValueError(f"the time {when} is of the year {year}, expected 1972 to 2100")
        return str(when.astype("datetime64[ns]")) + "Z"
    if hasattr(when, "astimezone"):
        import datetime

        if when.tzinfo is None:
            raise ValueError(f"{when!r} has no time zone: give one, or a text that ends with Z")
        return when.astimezone(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    raise TypeError(f"{type(when).__name__} is no time: expected text, datetime64, datetime or astropy Time")


def _value(quantity, unit):
    """A float or an array of a number or an astropy Quantity; what is masked is NaN."""
    if quantity is not None and hasattr(quantity, "to_value"):
        quantity = quantity.to_value(unit)
    return _unmasked(quantity)


def _vectors(of):
    """(n, 3) float64 of an array, a list or an astropy CartesianRepresentation."""
    if hasattr(of, "cartesian"):
        of = of.cartesian
    if hasattr(of, "xyz"):
        xyz = of.xyz
        of = _np.asarray(getattr(xyz, "value", xyz)).T
    array = _np.ascontiguousarray(_unmasked(of), dtype=_np.float64)
    if array.shape == (3,):
        return array.reshape(1, 3)
    if array.ndim != 2:
        raise Error(f"directions have the shape {array.shape}, expected (n, 3)")
    return array


def _distances(range_m, n):
    """Distances of n observers, m."""
    distances = _np.ascontiguousarray(_np.broadcast_to(_value(range_m, "m"), (n,)), dtype=float)
    bad = ~(distances > 0)
    if bad.any():
        row = int(_np.argmax(bad))
        raise Error(f"range_m: row {row} is {distances[row]}, expected a number above 0")
    return distances


class Table(dict):
    """Columns of a result: a dict of names and arrays, with ``units``, ``descriptions`` and ``meta``.

    Arrays are read-only: take a copy to change one. Texts are object arrays; times are ISO 8601 texts in UTC, which :meth:`times` turns into ``datetime64[ns]``.
    A table is also a callable that gives itself: ``result.table()`` and ``result.table`` are the same.

    Parameters
    ----------
    name : str
    columns : sequence of dict
        ``name``, ``unit``, ``description`` and ``values`` of each column.
    meta : dict or str
        Metadata, or its JSON.
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
            # What is computed from a result goes by its file: a change here would change nothing there.
            values = values.view()
            values.flags.writeable = False
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

    def __call__(self):
        return self

    @property
    def rows(self):
        """Number of rows."""
        return len(next(iter(self.values()))) if self else 0

    def times(self, column="time_utc"):
        """A column of times as ``datetime64[ns]`` (UTC; within a leap second the last nanosecond before it).

        Parameters
        ----------
        column : str
        """
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
        """An ``astropy.table.QTable``: columns with units are quantities, those of times in UTC are ``Time``."""
        from astropy import units
        from astropy.table import QTable
        from astropy.time import Time

        table = QTable(meta=dict(self.meta))
        for name, values in self.items():
            unit = self.units[name]
            numeric = getattr(values, "dtype", None) is not None and values.dtype != object
            if name.endswith("_utc") and not numeric and len(values) and all(isinstance(v, str) and v for v in values):
                table[name] = Time([v.rstrip("Z") for v in values], format="isot", scale="utc", precision=9)
            else:
                table[name] = values * units.Unit(unit) if unit and numeric else (values if numeric else values.astype(str))
        return table

    def _repr_html_(self):
        import html

        rows = []
        for name, values in self.items():
            unit = html.escape(self.units[name] or "")
            if getattr(values, "ndim", 1) == 1 and getattr(values, "dtype", object) != object and values.dtype.kind in "fiu":
                good = values[_np.isfinite(values)] if values.dtype.kind == "f" else values
                span = f"{good.min():.6g} … {good.max():.6g}" if len(good) else "no value"
                what = f"<td>{span}</td><td>{_small_curve(values)}</td>"
            else:
                ends = [str(values[0]), str(values[-1])] if len(values) else ["no value"]
                what = f"<td colspan=2>{html.escape(' … '.join(dict.fromkeys(ends)))}</td>"
            rows.append(f"<tr><td>{html.escape(name)}</td><td>{unit}</td>{what}</tr>")
        return f"<p>{html.escape(self.name)}: {self.rows} rows</p><table>{''.join(rows)}</table>"

    def __repr__(self):
        return f"<sunglint.Table {self.name}: {self.rows} rows, columns {', '.join(self)}>"


def _small_curve(values):
    """A column as a line of 120 by 24 pixels, SVG."""
    values = _np.asarray(values, dtype=float)
    places = _np.unique(_np.linspace(0, max(len(values) - 1, 0), 120).round().astype(int)) if len(values) else []
    points = [(k, values[k]) for k in places if _np.isfinite(values[k])]
    if len(points) < 2:
        return ""
    low, high = min(v for _, v in points), max(v for _, v in points)
    last = max(len(values) - 1, 1)
    line = " ".join(f"{118 * k / last + 1:.1f},{23 - 22 * ((v - low) / (high - low) if high > low else 0.5):.1f}" for k, v in points)
    return f'<svg width="120" height="24"><polyline points="{line}" fill="none" stroke="#0072b2"/></svg>'


def _draw_panel(panel, ax):
    """A panel of the program's figure on matplotlib's axes."""
    from matplotlib import colors

    for label, first, last, colour in panel["spans"]:
        known = label in ax.get_legend_handles_labels()[1]
        ax.axvspan(first, last, color=_np.array(colour) / 255, zorder=0, label=None if known else label)
    heat = panel.get("heat")
    if heat is not None:
        shape = (len(heat["x_edges"]) - 1, len(heat["y_edges"]) - 1)
        most = _np.nanmax(heat["values"])
        norm = colors.Normalize(0, most) if heat["decades"] is None else colors.LogNorm(most / 10 ** heat["decades"], most)
        mesh = ax.pcolormesh(heat["x_edges"], heat["y_edges"], heat["values"].reshape(shape).T, norm=norm)
        ax.figure.colorbar(mesh, ax=ax, label=heat["label"])
    for series in panel["series"]:
        colour, label = _np.array(series["colour"]) / 255, series["label"] or None
        if series["style"] == "dots":
            ax.plot(series["x"], series["y"], ".", ms=3, color=colour, label=label)
        elif series["style"] == "area":
            ax.fill_between(series["x"], series["y"], color=colour, label=label)
        else:
            ax.plot(series["x"], series["y"], ("-", "--", ":", "-.")[series["dash"] % 4], color=colour, label=label)
    for axis, scale, limit, named in ((panel["x"], ax.set_xscale, ax.set_xlim, ax.set_xlabel), (panel["y"], ax.set_yscale, ax.set_ylim, ax.set_ylabel)):
        named(axis["label"])
        if axis["log"]:
            scale("log")
        if axis["range"] is not None:
            limit(*axis["range"])
    if panel["x"]["inverted"]:
        ax.invert_xaxis()
    if panel["y"]["inverted"]:
        ax.invert_yaxis()
    if ax.get_legend_handles_labels()[1]:
        ax.legend(fontsize="small")


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

    def keys(self):
        """The keys of the summary."""
        return self.summary.keys()

    def get(self, key, default=None):
        """An item of the summary, or something else where it has none.

        Parameters
        ----------
        key : str
        default : object, optional
        """
        return self[key] if key in self else default

    def __iter__(self):
        return iter(self.keys())

    def __contains__(self, key):
        return key in self.keys()

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
        """The bytes of a form: ``ecsv``, ``csv``, ``fits``, ``json``, ``html``, ``png`` or ``svg``.

        Parameters
        ----------
        form : str
        """
        if self._state is not None:
            if form == "json":
                return self.to_json().encode()
            if form in self._state["forms"]:
                return self._state["forms"][form]
            raise Error(f"an unpickled result has no {form}; it has {', '.join(self._state['forms'])}")
        return bytes(self._outcome.encode(form))

    def write(self, path):
        """Writes the form that the ending of the path names; what is there is not overwritten.

        Parameters
        ----------
        path : str or path
        """
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

    @property
    def _panels(self):
        return self._state["panels"] if self._state is not None else self._outcome.panels()

    def plot(self, ax=None):
        """Draws the figure's panels with matplotlib.

        Parameters
        ----------
        ax : Axes or sequence of Axes, optional
            Where to draw: one for each panel; a single one gets the first panel. New ones without it.

        Returns
        -------
        Axes or ndarray of Axes
            One for one panel, else one for each. A result that is a picture is shown as it is.
        """
        import io

        from matplotlib import pyplot

        panels = self._panels
        if not panels:
            picture = pyplot.imread(io.BytesIO(self.encode("png")), format="png")
            if ax is None:
                _, ax = pyplot.subplots(figsize=(picture.shape[1] / 200, picture.shape[0] / 200))
            ax.imshow(picture)
            ax.set_axis_off()
            return ax
        if ax is None:
            figure, axes = pyplot.subplots(len(panels), squeeze=False, figsize=(8, 1 + 2.6 * len(panels)), layout="constrained")
            axes = axes[:, 0]
            figure.suptitle(self._get("title") or self.name)
        else:
            axes = _np.atleast_1d(_np.asarray(ax, dtype=object))
            panels = panels[:1] if len(axes) == 1 else panels
            if len(axes) != len(panels):
                raise ValueError(f"{len(axes)} axes for {len(panels)} panels")
        for panel, one in zip(panels, axes):
            _draw_panel(panel, one)
        return axes[0] if len(axes) == 1 else axes

    @property
    def _has_figure(self):
        return self._get("has_figure")

    def __reduce__(self):
        forms = {}
        for form in ("ecsv", "csv", "fits", *(("svg", "png") if self._has_figure else ())):
            try:
                forms[form] = self.encode(form)
            except Error:
                pass
        state = {k: self._get(k) for k in ("name", "text", "warnings", "files", "has_figure", "title")}
        state.update(json=self.to_json(), forms=forms, panels=self._panels)
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


@_dataclass(frozen=True, eq=False)
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


@_dataclass(frozen=True, eq=False)
class MaterialLight:
    """The light of a body for n geometries at one wavelength, by the m materials that sent it.

    It is an array of shape (n, m) wherever numpy takes one: ``numpy.asarray(light)``.

    Attributes
    ----------
    materials : list of str
        Names of the columns.
    per_irradiance_m2_per_sr : ndarray (n, m)
        Radiant intensity over the Sun's irradiance, m² sr⁻¹, of the light that the material sent last and alone.
    error_m2_per_sr : ndarray (n, m)
        Stated error of it, a bound.
    several_m2_per_sr, several_error_m2_per_sr : ndarray (n,)
        Light that went by several materials, and what else is stated as an error.
    wavelength_nm : float
    warnings : list of str
    """

    materials: list
    per_irradiance_m2_per_sr: _np.ndarray
    error_m2_per_sr: _np.ndarray
    several_m2_per_sr: _np.ndarray
    several_error_m2_per_sr: _np.ndarray
    wavelength_nm: float
    warnings: list

    @property
    def shape(self):
        """The shape (n, m)."""
        return self.per_irradiance_m2_per_sr.shape

    def __len__(self):
        return len(self.per_irradiance_m2_per_sr)

    def __array__(self, dtype=None, copy=None):
        return _np.array(self.per_irradiance_m2_per_sr, dtype=dtype, copy=bool(copy) or None)


class Body:
    """A body that reflects: a built-in target (``box_wing``, ``hexagon`` …) or the file of one.

    Parameters
    ----------
    model : str or path
    """

    def __init__(self, model):
        self._model = _path(model)
        self._body = _core.Body(self._model)

    @classmethod
    def of_scene(cls, path):
        """The body of a scene's file.

        Parameters
        ----------
        path : str or path
        """
        body = cls.__new__(cls)
        body._model = None
        body._scene = _path(path)
        body._body = _core.Body.of_scene(body._scene)
        return body

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
        progress : callable (stage, done, of) or tqdm bar, optional

        Returns
        -------
        Light
        """
        wavelengths = _np.atleast_1d(_value(wavelength_nm, "nm")).astype(float).tolist()
        distances = None
        sun, observer = _vectors(sun), _vectors(observer)
        if range_m is not None:
            distances = _distances(range_m, len(sun))
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

    def light_by_material(self, sun, observer, wavelength_nm=550.0, range_m=None, tolerance=None, budget_s=None, progress=None):
        """The light at one wavelength by the material that sent it.

        Parameters
        ----------
        sun, observer : array_like (n, 3)
            Unit vectors, body axes.
        wavelength_nm : float or Quantity
            Vacuum wavelength.
        range_m : array_like (n,) or Quantity, optional
            Distances to the observer; without them it is far away.
        tolerance, budget_s : float, optional
            As for :meth:`light`.
        progress : callable (stage, done, of) or tqdm bar, optional

        Returns
        -------
        MaterialLight
        """
        sun, observer = _vectors(sun), _vectors(observer)
        if range_m is not None:
            range_m = _distances(range_m, len(sun))
        nm = float(_value(wavelength_nm, "nm"))
        light, error, warnings = self._body.light_by_material(sun, observer, nm, range_m, tolerance, budget_s, _callback(progress))
        return MaterialLight(self.materials, light[:, :-1], error[:, :-1], light[:, -1], error[:, -1], nm, warnings)

    def picture(self, size_px=320):
        """A picture of the body in the colours of sunlight, as the bytes of a PNG file.

        Parameters
        ----------
        size_px : int
            Pixels across and down.
        """
        return bytes(self._body.picture(_whole(size_px, "size_px", 1)))

    def _repr_png_(self):
        return self.picture()

    def __reduce__(self):
        if self._model is None:
            return (Body.of_scene, (self._scene,))
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
                range_m = _distances(range_m, len(_vectors(sun)))
            return self._light(_vectors(sun), _vectors(observer), range_m)

    def __reduce__(self):
        return (Engine, (self.body, *self._args))

    def __repr__(self):
        return f"<sunglint.Engine of {self.body.name} at {', '.join(f'{nm:g}' for nm in self.wavelength_nm)} nm>"


def _wavelength(wavelength_nm):
    """A wavelength of light, nm."""
    nm = float(_value(wavelength_nm, "nm"))
    if not 100 <= nm <= 30000:
        raise Error(f"wavelength_nm is {nm:g}, expected 100 to 30000 (nanometres)")
    return nm


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
        """The BRDF, sr⁻¹, for (n, 3) unit vectors to light and observer; z is the normal, x the tangent. Below the surface it is 0.

        Beyond the wavelengths that the material is known at it has the value at the last of them.

        Parameters
        ----------
        wavelength_nm : float or Quantity
            Vacuum wavelength.
        light, observer : array_like (n, 3)
            Unit vectors.
        """
        return self._brdf.evaluate(_wavelength(wavelength_nm), _vectors(light), _vectors(observer))

    def albedo(self, wavelength_nm, theta_i_deg=0.0):
        """Hemispherical reflectance for light at an angle of incidence.

        Parameters
        ----------
        wavelength_nm : float or Quantity
            Vacuum wavelength.
        theta_i_deg : float or Quantity
        """
        theta = float(_value(theta_i_deg, "deg"))
        if not 0 <= theta < 90:
            raise Error(f"theta_i_deg is {theta}, expected 0 to less than 90")
        return self._brdf.albedo(_wavelength(wavelength_nm), theta)

    def show(self, phi_i_deg=0.0):
        """What the material does at the wavelength that it was read for: reflectance, peak and width by angle of incidence, with a figure.

        Parameters
        ----------
        phi_i_deg : float or Quantity
            Azimuth of the light.

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
        target : str, optional
            Name of the target.
        """
        import csv

        if hasattr(time_utc, "isot"):
            moment = time_utc.utc.copy()
            moment.precision = 9
            times = [str(t) + "Z" for t in _np.atleast_1d(moment.isot)]
        else:
            if hasattr(time_utc, "dt") and hasattr(time_utc, "to_numpy"):
                # A pandas Series: without a zone it is UTC, as datetime64 is.
                time_utc = time_utc.to_numpy(dtype="datetime64[ns]")
            times = [_utc(t) for t in ([time_utc] if isinstance(time_utc, str) else time_utc)]
        n = len(times)

        def column(name, value, unit):
            value = _np.asarray(_value(value, unit), dtype=float)
            if value.ndim > 1 or value.shape not in ((), (1,), (n,)):
                raise Error(f"{name} has the shape {value.shape}, expected {n} values, as many as there are times")
            return _np.broadcast_to(value, (n,))

        columns = {"time_utc": times, "magnitude": column("magnitude", magnitude, "mag")}
        if sigma_mag is not None:
            columns["sigma_mag"] = column("sigma_mag", sigma_mag, "mag")
            bad = ~(columns["sigma_mag"] >= 0) & ~_np.isnan(columns["sigma_mag"]) | _np.isinf(columns["sigma_mag"])
            if bad.any():
                row = int(_np.argmax(bad))
                raise Error(f"sigma_mag: sample {row} is {columns['sigma_mag'][row]}, expected an uncertainty of 0 or more, or nan")
        if exposure_s is not None:
            columns["exposure_s"] = column("exposure_s", exposure_s, "s")
        if filter is not None:
            columns["filter"] = [filter] * n if isinstance(filter, str) else [str(f) for f in filter]
            if len(columns["filter"]) != n:
                raise Error(f"filter has {len(columns['filter'])} names, expected {n}, as many as there are times")
        keep = _tempfile.TemporaryDirectory(prefix="sunglint-")
        stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in target)[:60] or "curve"
        path = _os.path.join(keep.name, f"{stem}.csv")
        with open(path, "w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(columns)
            rows.writerows([v if isinstance(v, str) else repr(float(v)) for v in row] for row in zip(*columns.values()))
        curve = read_photometry(path, _keep=keep)
        curve.target = target or curve.target
        return curve

    def plot(self, ax=None):
        """Draws magnitudes against seconds with matplotlib, a colour for each filter; gives the axes.

        Parameters
        ----------
        ax : Axes, optional
        """
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
        return (_curve_again, (_os.path.basename(self.path), data, self._reading, self.target))

    def __repr__(self):
        return f"<sunglint.Curve {self.path}: {self.format}, {self.table.rows} samples>"


def _curve_again(name, data, reading, target):
    """A curve in another process: its file travels with it."""
    keep = _tempfile.TemporaryDirectory(prefix="sunglint-")
    path = _os.path.join(keep.name, name)
    with open(path, "wb") as file:
        file.write(data)
    curve = Curve(path, reading, _core.read_photometry(path, reading), keep)
    curve.target = target
    return curve


def _reading(time_column=None, time_scale=None, time_format=None, magnitude_column=None, sigma_column=None, magnitudes_as=None, sigma_mag=None, object=None):
    return dict(
        time_column=time_column,
        time_scale=time_scale,
        time_format=time_format,
        magnitude_column=magnitude_column,
        sigma_column=sigma_column,
        magnitudes_as=magnitudes_as,
        sigma_mag=sigma_mag,
        object=object,
    )


def read_photometry(path, time_column=None, time_scale=None, magnitude_column=None, sigma_column=None, time_format=None, object=None, _keep=None):
    """Reads a light curve of any program: ECSV, CSV, FITS tables, EOSSA, VOTable, TDM, ALCDEF, MMT-9.

    Parameters
    ----------
    path : str or path
    time_column, magnitude_column, sigma_column : str, optional
        Columns of a table whose names do not tell.
    time_scale : {'utc', 'tai', 'tt', 'tdb', 'gps'}, optional
        Of times whose column names no scale.
    time_format : {'jd', 'mjd', 'unix', 's', 'd', 'iso'}, optional
        Of times as numbers whose column's name does not say what they are.
    object : str, optional
        Of a table of several objects: the one whose rows are taken.

    Returns
    -------
    Curve
    """
    reading = _reading(time_column, time_scale, time_format, magnitude_column, sigma_column, object=object)
    path = _path(path)
    return Curve(path, reading, _core.read_photometry(path, reading), _keep)


def read_table(path):
    """Reads a table in ECSV, as the program writes them.

    Parameters
    ----------
    path : str or path

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
    if not isinstance(known["aerosol"], (str, type(None))):
        known["aerosol"] = tuple(float(v) for v in known["aerosol"])
    return known


def _place(of):
    """Right ascension and declination, degrees, of a pair or an astropy SkyCoord."""
    if of is None:
        return None
    if hasattr(of, "icrs"):
        of = (of.icrs.ra.deg, of.icrs.dec.deg)
    if isinstance(of, str):
        raise Error(f"the place {of!r} is a text, expected two numbers, right ascension and declination in degrees, or a SkyCoord")
    if len(of) != 2:
        raise Error(f"a place has {len(of)} numbers, expected two: right ascension and declination, degrees")
    return tuple(float(_np.squeeze(_value(v, "deg"))) for v in of)


def _pair(of, name):
    """Two numbers, or None."""
    if of is None:
        return None
    numbers = [float(v) for v in of]
    if len(numbers) != 2 or not all(map(_np.isfinite, numbers)):
        raise Error(f"{name} is {of}, expected two numbers")
    return numbers


def _several(of):
    """A list; a text, a path, a curve, a result or a scene is one thing, not its parts."""
    return [of] if isinstance(of, (str, bytes, _os.PathLike, Curve, Result, Scene)) else list(of)


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
        """The same as ``Scene(path, station)``.

        Parameters
        ----------
        path : str or path
        station : str, optional
        """
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
        """What the pass needs, effect by effect, with bounds, reasons and costs.

        Parameters
        ----------
        tolerance : float, optional
            Model what may change the light by more than this share; 0.001.
        """
        return Result(_core.needs(self.path, self.station, tolerance))

    def compare(self, curve, **options):
        """The same as ``compare(curve, scene)``.

        Parameters
        ----------
        curve : Curve or path
        **options
            Those of :func:`compare`.
        """
        return compare(curve, self, **options)

    @property
    def body(self):
        """The scene's body."""
        if "_body" not in self.__dict__:
            self._body = Body.of_scene(self.path)
        return self._body

    def light(self, sun, observer, wavelength_nm=550.0, **options):
        """The light of the scene's body by the material that sent it.

        Parameters
        ----------
        sun, observer : array_like (n, 3)
            Unit vectors, body axes.
        wavelength_nm : float or Quantity
            Vacuum wavelength.
        **options
            Those of :meth:`Body.light_by_material`.

        Returns
        -------
        MaterialLight
            (n, materials), with errors.
        """
        return self.body.light_by_material(sun, observer, wavelength_nm, **options)

    def _repr_html_(self):
        import base64
        import html

        picture = base64.b64encode(self.body.picture()).decode()
        return f'<pre>{html.escape(repr(self))}\n{html.escape(repr(self.body))}</pre><img src="data:image/png;base64,{picture}" alt="the body">'

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
        ``time_column``, ``time_scale``, ``time_format``, ``magnitude_column``, ``sigma_column``, ``magnitudes_as`` ('apparent', 'ground', '1000km', 'standard').
    tolerance : float, optional
        Model what may change the light by more than this share; 0.001.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Result
    """
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    path, reading = _file_and_reading(curve, reading)
    return Result(_core.compare(path, scene.path, reading, scene.station, _several(channels), tolerance, _callback(progress)))


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
        What is searched for: ``"albedo"``, ``"attitude.period_s"``, ``"size=0.5..2"`` …; beside those of ``[fit]`` of the scene.
        ``"attitude.spin_axis"`` stands for the axis' two angles, ``"attitude.axis_ra_deg"`` and ``"attitude.axis_dec_deg"``.
    per_pass : sequence of str
        Parameters of which each curve has its own.
    seed : int
        Seed of the places that are looked at first.
    **reading
        ``time_column``, ``time_scale``, ``time_format``, ``magnitude_column``, ``sigma_column``, ``magnitudes_as``, ``sigma_mag``, and ``object``: the one whose rows are taken of a table of several.
    channels : sequence of str
        Only these.
    largest_albedo : float, optional
        Bound of albedos; 1.
    scintillation : float, optional
        Coefficient of the air's scintillation that is added to the noise.
    places, starts, iterations : int, optional
        How many places are looked at first, from how many of them the search descends, and how many steps a descent has at most.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    FitResult
    """
    inputs, how, station = _with_scenes(scene, curves, reading)
    free = _several(free)
    axis = ("attitude.axis_ra_deg", "attitude.axis_dec_deg")
    free = [one for name in free for one in (axis if name == "attitude.spin_axis" else (name,))]
    outcome, converged = _core.fit(
        inputs,
        how,
        free,
        _several(per_pass),
        _several(channels),
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
    channels : sequence of str
        Only these.
    progress : callable (stage, done, of) or tqdm bar, optional
    **reading
        ``time_column``, ``time_scale``, ``time_format``, ``magnitude_column``, ``sigma_column``, ``magnitudes_as``, ``sigma_mag``: see :func:`read_photometry`; and ``object``: the one whose rows are taken of a table of several.

    Returns
    -------
    Result
        ``result["verdict"]`` and the candidates; the table is the periodogram.
    """
    paths, how = _paths(curves, reading)
    return Result(
        _core.period(
            paths, how, _several(channels), _value(shortest_s, "s"), _value(longest_s, "s"), _value(gap_s, "s"), _whole(harmonics, "harmonics", 1), sessions, station, _callback(progress)
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


def detect(pixels, fwhm_px=None, point_sigma=None, streak_sigma=None, shortest_px=None, aperture_px=None, saturation_adu=None, gain_e_per_adu=None, bayer=None):
    """Finds points and streaks in a frame.

    Parameters
    ----------
    pixels : array_like (rows, columns)
        ADU; NaN is masked.
    gain_e_per_adu : float, optional
        With it the noise of the light itself is counted.
    fwhm_px : float, optional
        Width of a point; as the frame's own points show it.
    point_sigma, streak_sigma : float, optional
        Standard deviations by which points and streaks stand out.
    shortest_px : float, optional
        Length of the shortest streak.
    aperture_px : float, optional
        Radius of the aperture of points; 1.5 times their width.
    saturation_adu : float, optional
    bayer : str, optional
        Colours of the first 2 x 2 pixels (RGGB, GRBG, GBRG, BGGR): the green light is measured.

    Returns
    -------
    Field
    """
    pixels = _np.ascontiguousarray(_value(pixels, "adu"), dtype=_np.float32)
    if pixels.ndim != 2:
        raise ValueError(f"pixels have {pixels.ndim} axes, expected 2: rows, columns")
    return Field(_core.detect(pixels, fwhm_px, point_sigma, streak_sigma, shortest_px, aperture_px, saturation_adu, gain_e_per_adu, bayer))


def reduce(frames, place_px=None, along=1, darks=(), flats=(), fwhm_px=None, aperture_px=None, streak_sigma=None, catalogue=None, catalogue_mag=None, catalogue_colour=None, catalogue_system=None, near_deg=None, scale_arcsec=None, target_colour=None, colour_term=None, name=None, progress=None, gain_e_per_adu=None):
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
    darks, flats : sequence of paths
        Frames to calibrate with.
    fwhm_px, aperture_px : float, optional
        Width of a point and radius of the aperture; as the frames show it.
    streak_sigma : float, optional
        Standard deviations by which streaks stand out.
    catalogue_mag : str, optional
        Column of the catalogue's magnitudes.
    catalogue_colour : (str, str), optional
        Two columns whose difference is a colour.
    catalogue_system : {'Vega', 'AB'}, optional
    scale_arcsec : float or Quantity, optional
        Width of a pixel on the sky.
    target_colour : (float, float), optional
        Colour of the target, and its uncertainty.
    colour_term : float, optional
    gain_e_per_adu : float, optional
        Electrons of a count of frames whose headers do not say it (``EGAIN``): without, uncertainties lack the target's own photon noise, with a warning.
    name : str, optional
        Name of the result.
    progress : callable (stage, done, of) or tqdm bar, optional

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
    scale_arcsec = _value(scale_arcsec, "arcsec")
    if scale_arcsec is not None and not 0 < scale_arcsec < _np.inf:
        raise Error(f"scale_arcsec is {scale_arcsec}, expected a number above 0")
    return Result(
        _core.reduce(
            [_path(f) for f in frames],
            _pair(place_px, "place_px"),
            along,
            [_path(f) for f in _several(darks)],
            [_path(f) for f in _several(flats)],
            fwhm_px,
            aperture_px,
            streak_sigma,
            catalogue and _path(catalogue),
            catalogue_mag,
            catalogue_colour and _several(catalogue_colour),
            catalogue_system,
            near_deg and list(near_deg),
            scale_arcsec,
            _pair(target_colour, "target_colour"),
            colour_term,
            name,
            _callback(progress),
            gain_e_per_adu,
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
        parts = max(1, min(shards, 2 * sum(client.nthreads().values())))
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
        Parts with a client: as many as the study has shards, at most 2 a thread of the workers (each has a third of a second to begin with).
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
        channel=_several(channel),
        kind=_several(kind),
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
    v_mag, b_minus_v_mag : float, optional
    spectral_type : str, optional

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
    altitude_m : float or Quantity, optional

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
    attitude : str or path
        Law of the body's attitude, or a scene with one.
    tolerance : float
    exposure_s : float or Quantity
    zero_point : str
        ``vega=0.03`` or ``ab``.
    air : dict, optional
        See :func:`star`.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Result
        The figure is the plot of the sky.
    """
    numbers = [norad_id] if isinstance(norad_id, (int, str)) else list(norad_id)
    wanted = dict(
        norad_id=[str(n) for n in numbers],
        name=_several(name),
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

    Attributes
    ----------
    plan, folder : str
        The plan, and the folder where it lies with what it names.
    """

    _keep = None

    def __init__(self, plan):
        self.plan = _path(plan)
        self.folder = _os.path.dirname(_os.path.abspath(self.plan))
        if not _os.path.exists(self.plan):
            raise Error(f"{self.plan}: there is no such file")

    def observe(self, output=None, progress=None):
        """Observes the night, as fast as the computer can, into a folder that is not there yet.

        Parameters
        ----------
        output : path, optional
            The folder; ``session`` beside the plan.
        progress : callable (stage, done, of) or tqdm bar, optional

        Returns
        -------
        Session
        """
        output = _os.path.join(self.folder, "session") if output is None else output
        observed = Result(_core.observe_virtual(self.plan, _path(output), _callback(progress)))
        session = Session(output, observed)
        # A night in a folder that nobody named goes with the last that needs it.
        session._keep = self._keep
        return session

    def __repr__(self):
        return f"<sunglint.Night {self.plan}>"


def _write_night(folder, files, scenes, progress):
    """Writes a night's files and simulates the light of its scenes; the night."""
    folder = _path(folder)
    _os.makedirs(_os.path.join(folder, "simulated"), exist_ok=True)
    for name, text in files:
        with open(_os.path.join(folder, name), "x", encoding="utf-8") as file:
            file.write(text)
    for name in scenes:
        simulated = Scene(_os.path.join(folder, name)).simulate(progress=progress)
        simulated.write(_os.path.join(folder, "simulated", f"{simulated.name}.ecsv"))
    return Night(_os.path.join(folder, "night.toml"))


def demo_night(folder, seed=0, progress=None):
    """The demonstration's night: two satellites that are made up cross an hour with stars to calibrate by.

    Writes plan, scenes and elements into a folder, and simulates the light of both scenes.

    Parameters
    ----------
    folder : path
        Made where it is not there; files in it are not overwritten.
    seed : int
        The same seed gives the same night, that of ``sunglint --seed N demo``.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Night
    """
    return _write_night(folder, _core.demo_files(seed), ("pass.toml", "sphere.toml"), progress)


def virtual_night(seed=0, folder=None, progress=None):
    """A short virtual night: one satellite, ``demo-sat``, and stars to calibrate by, in half an hour.

    The satellite is a cube that turns, with diffuse faces of four materials; ``pass.toml`` in the night's folder is its scene.

    Parameters
    ----------
    seed : int
        The same seed gives the same night.
    folder : path, optional
        Where its files are written; files that are there are not overwritten. Without it, a folder that goes when night and session are gone.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Night
    """
    keep = None
    if folder is None:
        keep = _tempfile.TemporaryDirectory(prefix="sunglint-")
        folder = keep.name
    night = _write_night(folder, _core.short_files(seed), ("pass.toml",), progress)
    night._keep = keep
    return night


class Frame:
    """A frame of a recorded session.

    Made by :meth:`Session.frames`; the file is read when something of it is asked for.

    Attributes
    ----------
    number : int
        Counts from 1; a missing number is a lost frame.
    path : str
    """

    def __init__(self, number, path):
        self.number = number
        self.path = _path(path)

    def _read(self):
        if "_pixels" not in self.__dict__:
            self._pixels, self._about = _core.read_frame(self.path)
        return self._about

    @property
    def pixels(self):
        """The pixels in ADU: uint16, (rows, columns)."""
        self._read()
        return self._pixels

    @property
    def about(self):
        """What is known of it: start, exposure, gain, saturation, temperature, origin and binning on the sensor, target, filter."""
        return dict(self._read())

    @property
    def time(self):
        """Start of the exposure, ``datetime64[ns]``, UTC."""
        return _np.datetime64(self._read()["start_utc"].rstrip("Z"), "ns")

    def __repr__(self):
        return f"<sunglint.Frame {self.number}: {self.path}>"


class Session:
    """A recorded night: the folder that ``sunglint observe`` makes.

    Parameters
    ----------
    folder : str or path
    """

    _keep = None

    def __init__(self, folder, _observed=None):
        self.folder = _path(folder)
        if not _os.path.exists(_os.path.join(self.folder, "session.toml")):
            raise Error(f"{self.folder}: there is no session (no session.toml)")
        self.observed = _observed

    @property
    def station(self):
        """Name or file of the station that it was recorded with; None where neither is known."""
        return _core.session_parts(self.folder)[0]

    @property
    def counters(self):
        """Names of its photon counters."""
        return _core.session_parts(self.folder)[1]

    @property
    def cameras(self):
        """Names of its cameras."""
        return _core.session_parts(self.folder)[2]

    def counts(self, counter=None):
        """The bins of a counter as a table.

        Parameters
        ----------
        counter : str, optional
            Name of the counter; the only one.

        Returns
        -------
        Table
            ``start_utc`` (datetime64[ns]; a leap second repeats the one before it), ``start_ps`` and ``length_ps`` by the counter's clock, ``flags``, and for each
            channel ``NAME_counts`` and ``NAME_missed``.
        """
        found = _core.session_counts(self.folder, self._one("counter", counter, self.counters))

        def column(name, unit, values):
            return dict(name=name, unit=unit, description=None, values=values)

        columns = [column("start_utc", None, found["start_utc_ns"].view("datetime64[ns]"))]
        columns += [column("start_ps", "ps", found["start_ps"]), column("length_ps", "ps", found["length_ps"]), column("flags", None, found["flags"])]
        for k, channel in enumerate(found["channels"]):
            columns += [column(f"{channel}_counts", None, found["counts"][:, k]), column(f"{channel}_missed", None, found["missed"][:, k])]
        return Table("counts", columns, {"channels": found["channels"]})

    def frames(self, camera=None):
        """The frames of a camera, in their order.

        Parameters
        ----------
        camera : str, optional
            Name of the camera; the only one.

        Returns
        -------
        list of Frame
        """
        return [Frame(number, path) for number, path in _core.session_frames(self.folder, self._one("camera", camera, self.cameras))]

    def _one(self, what, name, names):
        if name is None and len(names) != 1:
            raise ValueError(f"{self.folder} has {len(names)} {what}s ({', '.join(names)}): name one")
        return names[0] if name is None else name

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

    def reduce(self, target=None, station=None, aperture_px=None, fwhm_px=None, gate=1.0, raw=False, timing=None, progress=None):
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
        timing : path, optional
            When the cameras expose, as ``sunglint timing --timing-out`` measured it: is taken off the frames' times.
        progress : callable (stage, done, of) or tqdm bar, optional

        Returns
        -------
        Reduced
        """
        outcome, curves = _core.reduce_session(self.folder, target, station and _path(station), aperture_px, fwhm_px, gate, raw, timing and _path(timing), _callback(progress))
        reduced = Reduced(outcome, curves, station or self.station)
        # The copy of the station may lie in a folder that nobody named.
        reduced._kept_session = self._keep
        return reduced

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
        """The same as ``calibrate(reduced, station)``; the station is by default the one of the reduction, or that of the session.

        Parameters
        ----------
        station : str or path, optional
        **options
            Those of :func:`calibrate`.
        """
        return calibrate(self, station or self.station, **options)

    def __getitem__(self, key):
        return self.curves[key] if key in self.curves else super().__getitem__(key)

    def keys(self):
        """Names of the curves, and the keys of the summary."""
        return [*self.curves, *super().keys()]


class Calibration(Result):
    """What channels and nights are worth: a :class:`Result` that makes linear curves calibrated ones."""

    _reduced = None

    def __init__(self, outcome, station=None, reduced=None):
        super().__init__(outcome)
        self.station = station
        self._reduced = reduced

    def apply(self, curve=None, **options):
        """The same as ``apply(calibration, curve, station)``.

        Parameters
        ----------
        curve : Result, path or str, optional
            A name is that of a curve of the reduction. Without it, all of them.
        **options
            Those of :func:`apply`.

        Returns
        -------
        Result or Applied
        """
        if curve is None:
            return Applied(self, options)
        if isinstance(curve, str) and self._reduced is not None and not _os.path.exists(curve):
            if curve not in self._reduced.curves:
                return Applied(self, options)[curve]
            curve = self._reduced.curves[curve]
        return apply(self, curve, self.station, **options)


class Applied(_Mapping):
    """The calibrated curves of a reduction, by the names of their visits (``demo-sat_1``) or of their targets (``demo-sat``).

    Made by :meth:`Calibration.apply` without a curve. A curve is calibrated when it is first asked for.

    Parameters
    ----------
    calibration : Calibration
        One that was made of a :class:`Reduced`.
    options : dict
        Options of :func:`apply`.
    """

    def __init__(self, calibration, options):
        if calibration._reduced is None:
            raise ValueError("the calibration knows no curves (it was read, or unpickled): give the curve to apply it to")
        self._calibration = calibration
        self._options = options
        self._done = {}
        self._names = [n for n, c in calibration._reduced.curves.items() if not c._get("name").endswith(("_frames", "_raw"))]

    def __getitem__(self, name):
        found = [name] if name in self._names else [n for n in self._names if n.rpartition("_")[0] == name]
        if not found:
            raise KeyError(f"there is no curve {name!r}: {', '.join(self._names)}")
        if len(found) > 1:
            raise KeyError(f"{name!r} has {len(found)} visits, name one: {', '.join(found)}")
        if found[0] not in self._done:
            self._done[found[0]] = self._calibration.apply(found[0], **self._options)
        return self._done[found[0]]

    def __iter__(self):
        return iter(self._names)

    def __len__(self):
        return len(self._names)

    def __repr__(self):
        return f"<sunglint.Applied: {', '.join(self._names)}>"


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
    scintillation : float, optional
        Coefficient of the air's scintillation.
    zero_point : str
        ``vega=0.03`` or ``ab``.

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
    zero_point : str
        ``vega=0.03`` or ``ab``.

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
    bins : int
    channels : sequence of str
        Only these.
    station : str, optional
        Whose air is removed from rates.
    **reading
        ``time_column``, ``time_scale``, ``time_format``, ``magnitude_column``, ``sigma_column``, ``magnitudes_as``, ``sigma_mag``: see :func:`read_photometry`; and ``object``: the one whose rows are taken of a table of several.

    Returns
    -------
    Result
    """
    paths, how = _paths(curves, reading)
    if isinstance(scene, Scene):
        scene, station = scene.path, station or scene.station
    return Result(
        _core.fold(
            paths, how, _air(air), _value(period_s, "s"), _value(period_sigma_s, "s"), _utc(epoch), scene and _path(scene), _place(axis), _whole(bins, "bins", 1), _several(channels), station, _several(keep)
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
    if how is None:
        raise Error("there is no curve: expected one or more")
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
    station : str, optional
    no_air : bool
        The curve is one above the air.
    unweighted : bool
        All samples count alike.

    Returns
    -------
    Result
    """
    if isinstance(scene, Scene):
        scene, station = scene.path, station or scene.station
    return Result(
        _core.unmix(_file(curve), [_path(e) for e in _several(endmembers)], _air(air), scene and _path(scene), station, no_air, total_m2_sr, unweighted, confusion)
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
            [_path(e) for e in _several(endmembers)],
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
    channels : sequence of str
        Only these.
    direct_only : bool
        Without light between surfaces.
    seed : int
        Seed of the search.
    progress : callable (stage, done, of) or tqdm bar, optional
    **reading
        ``time_column``, ``time_scale``, ``time_format``, ``magnitude_column``, ``sigma_column``, ``magnitudes_as``, ``sigma_mag``: see :func:`read_photometry`; and ``object``: the one whose rows are taken of a table of several.

    Returns
    -------
    Result
        ``files`` holds the scene with the spin that was found.
    """
    inputs, how, station = _with_scenes(scene, curves, reading)
    return Result(
        _core.attitude(
            inputs, how, _several(known), period_s and tuple(map(float, period_s)), sense, scale, _several(channels), axes, direct_only, station, seed, _callback(progress)
        )
    )


class Material(Result):
    """A fitted material: a :class:`Result` with the text of its ``material.toml``."""

    @property
    def toml(self):
        """Text of the material's file; None where the fit is not faithful and was not accepted."""
        return self.files.get("material.toml")

    def brdf(self, wavelength_nm=550.0):
        """The material as a :class:`Brdf`.

        Parameters
        ----------
        wavelength_nm : float or Quantity
        """
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
    zero_deg : float or Quantity, optional
        Angle of the stage at which light comes back along the normal; found without it.
    most_offset_deg : float or Quantity
        Farthest from 0 that it is looked for.
    median : int, optional
        Width of a running median over angles.
    elevations, azimuths : int, optional
        Nodes of the density.
    resamplings : int
        Of the bootstrap.
    seed : int
        Of the bootstrap.

    Returns
    -------
    Result
    """
    return Result(
        _core.ndf(_file(table), _value(zero_deg, "deg"), _value(most_offset_deg, "deg"), median, tail, elevations, azimuths, resamplings, diffuse, seed)
    )


def fit_material(table, wavelength_nm=None, floor_per_sr=None, laws=(), cone_deg=None, source_deg=None, theta_most_deg=85.0, most_lobes=3, name="fitted", accept=False, progress=None):
    """A material law through measured BRDF values.

    Parameters
    ----------
    table : path or Result
        Samples of a BRDF.
    laws : sequence of {'lambert', 'phong', 'abg', 'ward', 'beckmann', 'ggx', 'maxwell-beard'}, optional
        The best of these, with one lobe; without them a composite of up to ``most_lobes`` lobes.
    cone_deg, source_deg : float or Quantity, optional
        Half-angles of detector and source; by default those of the table's instrument, or 0.24 and 0.
    accept : bool
        Give the material although its peak or hemispherical reflectance are off.
    wavelength_nm : float or Quantity, optional
        Which rows, of a table with several wavelengths.
    floor_per_sr : float, optional
        Least noise of a sample.
    theta_most_deg : float or Quantity
        Samples at larger angles are left out.
    most_lobes : int
    name : str
        Name of the material.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Material
    """
    return Material(
        _core.fit_material(
            _file(table),
            _value(wavelength_nm, "nm"),
            floor_per_sr,
            _several(laws),
            _value(cone_deg, "deg"),
            _value(source_deg, "deg"),
            _value(theta_most_deg, "deg"),
            most_lobes,
            name,
            accept,
            _callback(progress),
        )
    )


class Assembled(Material):
    """A material of measured values: a :class:`Result` with the bytes of its ``.bsdf`` file.

    Attributes
    ----------
    bsdf : bytes
        The file, as ``sunglint brdf assemble`` writes it.
    """

    def __init__(self, outcome, bsdf):
        super().__init__(outcome)
        self.bsdf = bsdf

    def write(self, path):
        """Writes the ``.bsdf`` with the TOML that names it beside it, or another form of the result; what is there is not overwritten.

        Parameters
        ----------
        path : str or path
        """
        path = _path(path)
        stem, ending = _os.path.splitext(path)
        if ending.lower() != ".bsdf":
            super().write(path)
            return
        name = _json.dumps(_os.path.basename(stem))
        toml = f'[[material]]\nname = {name}\nmodel = "measured"\nfile = {_json.dumps(_os.path.basename(path))}\n'
        with open(path, "xb") as file:
            file.write(self.bsdf)
        with open(f"{stem}.toml", "x", encoding="utf-8") as file:
            file.write(toml)

    def brdf(self, wavelength_nm=550.0):
        """The material as a :class:`Brdf`.

        Parameters
        ----------
        wavelength_nm : float or Quantity
        """
        folder = _tempfile.TemporaryDirectory(prefix="sunglint-")
        path = _os.path.join(folder.name, "material.bsdf")
        with open(path, "wb") as file:
            file.write(self.bsdf)
        brdf = Brdf(path, wavelength_nm)
        brdf._kept = folder
        return brdf


def plan(ndf, theta_i=8, phi_i=9, quarter=False, side=None, normals=128, wide=0.25, most_theta_i_deg=None, rig=None):
    """Where to measure a sample, by its density of microfacet normals.

    Parameters
    ----------
    ndf : path or Result
        As :func:`ndf` gives it.
    theta_i, phi_i : int
        Incident elevations, and azimuths of an anisotropic sample.
    quarter : bool
        The sample is symmetric about its axes: a quarter of the circle says all.
    side : int, optional
        Side of the grid of outgoing directions; 32, or 33 with a rig.
    normals : int
        Nodes of the densities in elevation and azimuth.
    wide : float
        Share of the directions that is spread over all tilts, for the lobe's tails.
    most_theta_i_deg : float or Quantity, optional
        Largest angle of incidence; 89.9, or 55 with a rig.
    rig : bool or dict, optional
        A rig that turns in the plane of incidence, by hand to marks; a dict may have ``least_phase_deg``, ``most_theta_o_deg`` and ``mark_deg``.

    Returns
    -------
    Result
        The table is the directions in the order in which to measure them.
    """
    known = ("least_phase_deg", "most_theta_o_deg", "mark_deg")
    given = dict(rig) if isinstance(rig, _Mapping) else {}
    for key in given:
        if key not in known:
            raise ValueError(f"rig has no {key!r}; it has {', '.join(known)}")
    of_rig = [_value(given.get(key), "deg") for key in known] if rig else None
    return Result(_core.plan(_file(ndf), theta_i, phi_i, quarter, side, normals, wide, _value(most_theta_i_deg, "deg"), of_rig))


def assemble(samples, ndf, plan=None, wavelength_nm=None, theta_i=72, phi_i=17, side=None, normals=128, progress=None):
    """A material of measured values and the sample's density of microfacet normals.

    Parameters
    ----------
    samples : path or Result
        Measured values of the BRDF.
    ndf : path or Result
        As :func:`ndf` gives it.
    plan : path or Result, optional
        The plan of these measurements: what of it is missing is told.
    wavelength_nm : float or Quantity, optional
        Of a table that does not say it.
    theta_i, phi_i : int
        Incident elevations of the file, and azimuths of an anisotropic sample.
    side : int, optional
        Side of the file's grid of values, best odd; the finest of 129, 97, 65 and 33 with which all take at most 256 MB.
    normals : int
        Nodes of the file's warps.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Assembled
    """
    planned = None if plan is None else _file(plan)
    return Assembled(*_core.assemble(_file(samples), _file(ndf), planned, _value(wavelength_nm, "nm"), theta_i, phi_i, side, normals, _callback(progress)))


def retro(plan, folder, reduce=False, progress=None):
    """Retro-reflection against angle: measured by a virtual rig, or reduced from the folder of a run.

    Parameters
    ----------
    plan : path
        RUN.toml. A run on devices is done by the program (``sunglint brdf retro``), which asks the person at the rig.
    folder : path
        The run's readings: made by a virtual rig, there already with ``reduce``.
    reduce : bool
        Measure nothing.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Result
        The table is what :func:`ndf` takes.
    """
    return Result(_core.retro(_path(plan), _path(folder), reduce, _callback(progress)))


def aperture(pixels, places_px, radius_px=8.0, annulus_px=(12.0, 20.0), fwhm_px=4.0, exposure_s=1.0, gain_e_per_adu=None, read_noise_e=0.0, saturation_adu=None):
    """Light within round apertures at given places of a frame, above the background of a ring around each.

    Parameters
    ----------
    pixels : array_like (rows, columns)
        ADU, whole numbers from 0 to 65,535; masked ones are left out.
    places_px : array_like (n, 2)
        Columns and rows; the middle of the first pixel is (0, 0).
    radius_px : float
        Of the apertures. Pixels on the edge count by their share.
    annulus_px : (float, float)
        Inner and outer radius of the ring, whose clipped median is the background.
    fwhm_px : float
        Width of a point; says how much of its light masked pixels hide.
    exposure_s : float or Quantity
    gain_e_per_adu : float, optional
        With it the noise of the target's own photons is stated, and the median of the ring is corrected for the lean of a Poisson distribution, up to 0.2 e⁻ a pixel.
        Without it the noise is that of the ring's pixels alone.
    read_noise_e : float
        Part of the ring's scatter that is no photons' noise; goes with the gain.
    saturation_adu : float, optional
        From where on a pixel counts as saturated.

    Returns
    -------
    Table
        ``rate_adu_per_s``, ``sigma_adu_per_s``, ``background_adu``, ``background_sigma_adu``, ``area_px2``, ``masked_fraction``, ``saturated_pixels``, ``flags``.
    """
    masked = _np.ma.getmaskarray(pixels) if _np.ma.isMaskedArray(pixels) else None
    given = _np.asarray(pixels.filled(0) if masked is not None else _value(pixels, "adu"))
    if given.ndim != 2:
        raise ValueError(f"pixels have {given.ndim} axes, expected 2: rows, columns")
    if given.dtype != _np.uint16:
        if given.size and not (_np.all(_np.isfinite(given)) and given.min() >= 0 and given.max() <= 65535 and _np.all(given == _np.floor(given))):
            raise ValueError("pixels are not whole numbers from 0 to 65535")
        given = given.astype(_np.uint16)
    places = _np.atleast_2d(_np.ascontiguousarray(places_px, dtype=float))
    found = _core.aperture(
        _np.ascontiguousarray(given), places, radius_px, list(annulus_px), fwhm_px, float(_value(exposure_s, "s")), gain_e_per_adu, read_noise_e, saturation_adu, masked
    )
    units = {"rate_adu_per_s": "adu / s", "sigma_adu_per_s": "adu / s", "background_adu": "adu", "background_sigma_adu": "adu", "area_px2": "pix2"}
    return Table("apertures", [dict(name=n, unit=units.get(n), description=None, values=v) for n, v in found.items()], {})


def track(elements, name, at, station=None, mount="virtual", dry_run=False, min_elevation_deg=10.0, for_s=None, sun_limit_deg=30.0, latency_s=0.25, past_meridian_deg=0.0, slew_deg_s=None, late_s=0.0, progress=None):
    """A telescope follows a satellite: the plan, or a rehearsal with a virtual mount.

    Real mounts are driven by the program (``sunglint track``), which has a watchdog beside it.

    Parameters
    ----------
    elements : path
        Two lines or OMM, or positions (OEM, CPF, ECSV).
    name : str or int
        The object: its catalogue number, or a part of its name.
    at : str, datetime, datetime64 or astropy Time
        The pass that is on then, or the first after it.
    station : str or path, optional
        Else that of the environment, or ``./station.toml``.
    mount : {'virtual', 'virtual-equatorial', 'virtual-german'}
    dry_run : bool
        Only the plan: slew, flip, keyhole, distance from the Sun.
    min_elevation_deg, sun_limit_deg : float or Quantity
        Lowest altitude that is followed, least distance from the Sun.
    for_s : float or Quantity, optional
        Stop after so many seconds of the pass.
    latency_s, late_s : float or Quantity
        From a command to the mount's doing it; how much later than predicted the target comes.
    past_meridian_deg : float or Quantity
        Hour angle up to which a German mount follows past the meridian.
    slew_deg_s : float, optional
        Speed of the mount's slews.
    progress : callable (stage, done, of) or tqdm bar, optional

    Returns
    -------
    Result
        The table has the steps, where there are some.
    """
    wanted = dict(
        min_elevation_deg=_value(min_elevation_deg, "deg"),
        for_s=_value(for_s, "s"),
        sun_limit_deg=_value(sun_limit_deg, "deg"),
        latency_s=_value(latency_s, "s"),
        past_meridian_deg=_value(past_meridian_deg, "deg"),
        slew_deg_s=slew_deg_s,
        late_s=_value(late_s, "s"),
    )
    return Result(_core.track(_path(elements), str(name), _utc(at), wanted, mount, station and _path(station), dry_run, _callback(progress)))


class Readings(Result):
    """Readings of a device: a :class:`Result` with the frames of a camera.

    Attributes
    ----------
    frames : list of ndarray (rows, columns), uint16
    """

    def __init__(self, outcome, frames):
        super().__init__(outcome)
        self.frames = frames


class Device:
    """An instrument, by the address that ``sunglint devices`` takes (``sim-pm100``, ``tmcl:/dev/ttyACM0``).

    It stays open until :meth:`close`, or the end of a ``with`` block. Ctrl-C stops a motor, and closes the device.

    Parameters
    ----------
    address : str
        ``DRIVER[:WHERE]``; :func:`drivers` lists them.
    options : dict or sequence of str
        Options of the driver: ``{"gear": 10}``, or ``["gear=10"]``.
    timeout_s : float or Quantity, optional
        How long a step may take.
    record : path, optional
        Writes every byte that is said into a file, for ``sunglint devices replay``.
    """

    def __init__(self, address, options=(), timeout_s=None, record=None):
        pairs = [f"{k}={v}" for k, v in options.items()] if isinstance(options, _Mapping) else list(options)
        self.address = address
        self._device = _core.Device(address, pairs, _value(timeout_s, "s"), None if record is None else _path(record))

    @property
    def kind(self):
        """Kind of the device: power meter, rotation stage, filter wheel, camera and others."""
        return self._device.kind

    def read(self, count=1, every_s=None, exposure_s=0.1):
        """Reads what the device measures: power, counts, an angle, a slot, frames.

        Parameters
        ----------
        count : int
        every_s : float or Quantity, optional
            From the begin of one reading to that of the next.
        exposure_s : float or Quantity
            Of a camera's frames, or length of a counter's bins.

        Returns
        -------
        Readings
        """
        return Readings(*self._device.read(count, _value(every_s, "s"), _value(exposure_s, "s")))

    def move(self, *targets):
        """Turns a stage to angles (degrees, ``"home"``, ``"stop"``), a wheel to slots, a focuser to positions, one after the other.

        Parameters
        ----------
        *targets : float, Quantity or str

        Returns
        -------
        Result
        """
        return Result(self._device.move([str(_value(t, "deg")) for t in targets]))

    def set(self, **settings):
        """Makes settings, and reads them back; without any, says what can be set.

        Parameters
        ----------
        **settings
            Names and values.

        Returns
        -------
        Result
        """
        return Result(self._device.set([(k, str(v)) for k, v in settings.items()]))

    def close(self):
        """Closes the line; a recording is whole then."""
        self._device.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def __repr__(self):
        return f"<sunglint.Device {self._device.title}>"


def devices(all=False, indi=(), alpaca=(), timeout_s=10.0):
    """Instruments that are plugged in, which driver recognises them, and whether you may use them.

    Parameters
    ----------
    all : bool
        Also USB and HID devices that no driver recognises.
    indi, alpaca : str or sequence of str
        Servers, ``HOST[:PORT]``, whose devices are listed, too.
    timeout_s : float or Quantity
        How long a server may take.

    Returns
    -------
    Result
    """
    hosts = [[h] if isinstance(h, str) else list(h) for h in (indi, alpaca)]
    return Result(_core.list_devices(all, *hosts, _value(timeout_s, "s")))


def drivers():
    """The drivers: their addresses, options, and what they were tried with.

    Returns
    -------
    Result
    """
    return Result(_core.drivers())
