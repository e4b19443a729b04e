# Types of the public names; python/tests/test_stubs.py holds them to the module.
import datetime
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

_Path: TypeAlias = str | os.PathLike[str]
# A moment: text in ISO 8601 (UTC), datetime with a time zone, datetime64, or astropy's Time.
_Moment: TypeAlias = str | datetime.datetime | np.datetime64 | Any
# A number, or astropy's Quantity.
_Number: TypeAlias = float | Any
# _Numbers, or astropy's Quantity.
_Numbers: TypeAlias = ArrayLike | Any
# Right ascension and declination, degrees, or astropy's SkyCoord.
_Place: TypeAlias = tuple[float, float] | Any
# A callable (stage, done, of), or a tqdm bar.
_Progress: TypeAlias = Callable[[str, int, int | None], object] | Any
_CurveLike: TypeAlias = Curve | Result | _Path

class Error(Exception):
    file: str | None
    line: int | None
    field: str | None
    hint: str | None

class Table(dict[str, NDArray[Any]]):
    name: str
    units: dict[str, str | None]
    descriptions: dict[str, str | None]
    meta: dict[str, Any]
    def __init__(self, name: str, columns: Sequence[Mapping[str, Any]], meta: str | dict[str, Any]) -> None: ...
    @property
    def rows(self) -> int: ...
    def __call__(self) -> Table: ...
    def times(self, column: str = "time_utc") -> NDArray[np.datetime64]: ...
    def to_pandas(self) -> Any: ...
    def to_astropy(self) -> Any: ...

class Result:
    def __init__(self, outcome: Any) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def files(self) -> dict[str, str]: ...
    @property
    def summary(self) -> dict[str, Any]: ...
    @property
    def tables(self) -> dict[str, Table]: ...
    @property
    def table(self) -> Table: ...
    def __getitem__(self, key: str) -> Any: ...
    def keys(self) -> Collection[str]: ...
    def get(self, key: str, default: Any = None) -> Any: ...
    def __iter__(self) -> Iterator[str]: ...
    def __contains__(self, key: object) -> bool: ...
    def to_dict(self) -> dict[str, Any]: ...
    def to_json(self) -> str: ...
    def to_pandas(self) -> Any: ...
    def to_astropy(self) -> Any: ...
    def encode(self, form: str) -> bytes: ...
    def write(self, path: _Path) -> None: ...
    def plot(self, ax: Any = None) -> Any: ...

class FitResult(Result):
    converged: bool
    def __init__(self, outcome: Any, converged: bool) -> None: ...
    @property
    def scenes(self) -> dict[str, str]: ...

class Reduced(Result):
    station: _Path | None
    curves: dict[str, Result]
    def __init__(self, outcome: Any, curves: Sequence[Any], station: _Path | None = None) -> None: ...
    def calibrate(self, station: _Path | None = None, **options: Any) -> Calibration: ...

class Calibration(Result):
    station: _Path | None
    def __init__(self, outcome: Any, station: _Path | None = None, reduced: Reduced | None = None) -> None: ...
    @overload
    def apply(self, curve: None = None, **options: Any) -> Applied: ...
    @overload
    def apply(self, curve: _CurveLike, **options: Any) -> Result: ...

class Applied(Mapping[str, Result]):
    def __init__(self, calibration: Calibration, options: Mapping[str, Any]) -> None: ...
    def __getitem__(self, name: str) -> Result: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...

class Material(Result):
    @property
    def toml(self) -> str | None: ...
    def brdf(self, wavelength_nm: _Number = 550.0) -> Brdf: ...

@dataclass(frozen=True)
class Light:
    per_irradiance_m2_per_sr: NDArray[np.float64]
    error_m2_per_sr: NDArray[np.float64]
    intensity_w_per_sr_nm: NDArray[np.float64]
    phase_deg: NDArray[np.float64]
    met: NDArray[np.bool_]
    warnings: list[str]
    def __len__(self) -> int: ...

class Assembled(Material):
    bsdf: bytes
    def __init__(self, outcome: Any, bsdf: bytes) -> None: ...

@dataclass(frozen=True)
class MaterialLight:
    materials: list[str]
    per_irradiance_m2_per_sr: NDArray[np.float64]
    error_m2_per_sr: NDArray[np.float64]
    several_m2_per_sr: NDArray[np.float64]
    several_error_m2_per_sr: NDArray[np.float64]
    wavelength_nm: float
    warnings: list[str]
    @property
    def shape(self) -> tuple[int, ...]: ...
    def __len__(self) -> int: ...
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]: ...

class Body:
    def __init__(self, model: _Path) -> None: ...
    @classmethod
    def of_scene(cls, path: _Path) -> Body: ...
    def light_by_material(
        self,
        sun: _Numbers,
        observer: _Numbers,
        wavelength_nm: _Number = 550.0,
        range_m: _Numbers | None = None,
        tolerance: float | None = None,
        budget_s: float | None = None,
        progress: _Progress | None = None,
    ) -> MaterialLight: ...
    def picture(self, size_px: int = 320) -> bytes: ...
    @property
    def name(self) -> str: ...
    @property
    def materials(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...
    def light(
        self,
        sun: _Numbers,
        observer: _Numbers,
        wavelength_nm: _Numbers = (550.0,),
        range_m: _Numbers | None = None,
        sun_distance_au: _Number | None = None,
        tolerance: float | None = None,
        budget_s: float | None = None,
        progress: _Progress | None = None,
    ) -> Light: ...
    def engine(
        self,
        wavelength_nm: _Numbers = (550.0,),
        range_m: _Number | None = None,
        sun_distance_au: _Number | None = None,
        tolerance: float | None = None,
        budget_s: float | None = None,
    ) -> Engine: ...

class Engine:
    body: Body
    wavelength_nm: NDArray[np.float64]
    def __init__(
        self,
        body: Body,
        wavelength_nm: list[float],
        range_m: float | None,
        sun_distance_au: float | None,
        tolerance: float | None,
        budget_s: float | None,
    ) -> None: ...
    def __call__(
        self, sun: _Numbers, observer: _Numbers, range_m: _Numbers | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

class Brdf:
    def __init__(self, name: _Path, wavelength_nm: _Number = 550.0) -> None: ...
    def evaluate(self, wavelength_nm: _Number, light: _Numbers, observer: _Numbers) -> NDArray[np.float64]: ...
    def albedo(self, wavelength_nm: _Number, theta_i_deg: _Number = 0.0) -> float: ...
    def show(self, phi_i_deg: _Number = 0.0) -> Result: ...

class Curve:
    path: str
    format: str
    target: str
    is_relative: bool
    notes: list[str]
    def __init__(self, path: str, reading: dict[str, Any], read: dict[str, Any], keep: Any = None) -> None: ...
    @property
    def table(self) -> Table: ...
    def to_pandas(self) -> Any: ...
    def plot(self, ax: Any = None) -> Any: ...
    @classmethod
    def from_arrays(
        cls,
        time_utc: Any,
        magnitude: _Numbers,
        sigma_mag: _Numbers | None = None,
        filter: str | Sequence[str] | None = None,
        target: str = "",
        exposure_s: _Numbers | None = None,
    ) -> Curve: ...

class Field:
    points: list[dict[str, Any]]
    streaks: list[dict[str, Any]]
    fwhm_px: float
    background_adu: float
    noise_adu: float
    star_trails: Any
    def __init__(self, found: str) -> None: ...

class Scene:
    path: str
    station: str | None
    def __init__(self, path: _Path, station: str | None = None) -> None: ...
    @classmethod
    def load(cls, path: _Path, station: str | None = None) -> Scene: ...
    def simulate(
        self,
        start: _Moment | None = None,
        end: _Moment | None = None,
        step_s: _Number | None = None,
        tolerance: float | None = None,
        budget_s: float | None = None,
        progress: _Progress | None = None,
    ) -> Result: ...
    def explain(self, tolerance: float | None = None) -> Result: ...
    def compare(self, curve: _CurveLike, **options: Any) -> Result: ...
    @property
    def body(self) -> Body: ...
    def light(
        self, sun: _Numbers, observer: _Numbers, wavelength_nm: _Number = 550.0, **options: Any
    ) -> MaterialLight: ...

class Night:
    plan: str
    folder: str
    def __init__(self, plan: _Path) -> None: ...
    def observe(self, output: _Path | None = None, progress: _Progress | None = None) -> Session: ...

class Frame:
    number: int
    path: str
    def __init__(self, number: int, path: _Path) -> None: ...
    @property
    def pixels(self) -> NDArray[np.uint16]: ...
    @property
    def about(self) -> dict[str, Any]: ...
    @property
    def time(self) -> np.datetime64: ...

class Session:
    folder: str
    observed: Result | None
    def __init__(self, folder: _Path, _observed: Result | None = None) -> None: ...
    @property
    def station(self) -> str | None: ...
    @property
    def counters(self) -> list[str]: ...
    @property
    def cameras(self) -> list[str]: ...
    def counts(self, counter: str | None = None) -> Table: ...
    def frames(self, camera: str | None = None) -> list[Frame]: ...
    def check(self) -> Result: ...
    def reduce(
        self,
        target: str | None = None,
        station: _Path | None = None,
        aperture_px: float | None = None,
        fwhm_px: float | None = None,
        gate: float | None = 1.0,
        raw: bool = False,
        timing: _Path | None = None,
        progress: _Progress | None = None,
    ) -> Reduced: ...

class ArchiveResult(Result):
    paths: list[str]
    asked: tuple[str, dict[str, Any], str | None]
    def __init__(self, outcome: Any, asked: tuple[str, dict[str, Any], str | None]) -> None: ...
    def curve(self) -> Result: ...

class Readings(Result):
    frames: list[NDArray[np.uint16]]
    def __init__(self, outcome: Any, frames: list[NDArray[np.uint16]]) -> None: ...

class Device:
    address: str
    def __init__(
        self,
        address: str,
        options: Mapping[str, Any] | Sequence[str] = (),
        timeout_s: _Number | None = None,
        record: _Path | None = None,
    ) -> None: ...
    @property
    def kind(self) -> str: ...
    def read(self, count: int = 1, every_s: _Number | None = None, exposure_s: _Number = 0.1) -> Readings: ...
    def move(self, *targets: _Number | str) -> Result: ...
    def set(self, **settings: Any) -> Result: ...
    def close(self) -> None: ...
    def __enter__(self) -> Device: ...
    def __exit__(self, *_: object) -> None: ...

class StudyResult:
    folder: str
    report: dict[str, Any]
    def __init__(self, folder: str, report: dict[str, Any]) -> None: ...
    def summary(self) -> Any: ...
    def samples(self) -> Any: ...

def air(
    zenith_deg: _Numbers = (0, 30, 45, 60, 70, 80),
    wavelength_nm: _Numbers | None = None,
    mean_nm: _Number | None = None,
    station: _Path | None = None,
    altitude_m: _Number | None = None,
    apparent: bool = False,
    components: bool = False,
    **known: Any,
) -> Result: ...
def apply(
    calibration: Result | _Path,
    curve: _CurveLike,
    station: _Path,
    night: str | None = None,
    spectrum: _Path | None = None,
    magnitudes: str | None = None,
    phase_law: Literal["lambert", "illuminated"] = "lambert",
    zero_point: str = "vega=0.03",
    air: Mapping[str, Any] | None = None,
) -> Result: ...
def attitude(
    scene: Scene | _Path | Sequence[Scene | _Path],
    curves: _CurveLike | Sequence[_CurveLike],
    known: str | Sequence[str] = (),
    period_s: tuple[float, float] | None = None,
    sense: Literal["both", "right", "left"] = "both",
    scale: Literal["none", "grey", "channel", "material"] = "none",
    channels: Sequence[str] = (),
    axes: int = 640,
    direct_only: bool = False,
    seed: int = 0,
    progress: _Progress | None = None,
    **reading: Any,
) -> Result: ...
def body_map(
    scene: Scene | _Path,
    curve: _CurveLike | None = None,
    endmembers: Sequence[_Path] = (),
    step_deg: _Number = 5.0,
    phase_deg: _Number | None = None,
    along: bool = False,
    ranges_nm: _Number | None = None,
) -> Result: ...
def calibrate(
    curves: Reduced | _CurveLike | Sequence[_CurveLike],
    station: _Path,
    floor: float | None = None,
    clip_sigma: float | None = None,
    confidence: float | None = None,
    fit_aerosol: bool = False,
    scintillation: float | None = None,
    zero_point: str = "vega=0.03",
    seed: int = 0,
    air: Mapping[str, Any] | None = None,
) -> Calibration: ...
def compare(
    curve: _CurveLike,
    scene: Scene | _Path,
    channels: Sequence[str] = (),
    tolerance: float | None = None,
    progress: _Progress | None = None,
    **reading: Any,
) -> Result: ...
def demo_night(folder: _Path, seed: int = 0, progress: _Progress | None = None) -> Night: ...
def detect(
    pixels: ArrayLike,
    fwhm_px: float | None = None,
    point_sigma: float | None = None,
    streak_sigma: float | None = None,
    shortest_px: float | None = None,
    aperture_px: float | None = None,
    saturation_adu: float | None = None,
    gain_e_per_adu: float | None = None,
    bayer: str | None = None,
) -> Field: ...
def fit(
    scene: Scene | _Path | Sequence[Scene | _Path],
    curves: _CurveLike | Sequence[_CurveLike],
    free: str | Sequence[str] = (),
    per_pass: Sequence[str] = (),
    channels: Sequence[str] = (),
    largest_albedo: float | None = None,
    scintillation: float | None = None,
    places: int | None = None,
    starts: int | None = None,
    iterations: int | None = None,
    seed: int = 0,
    progress: _Progress | None = None,
    **reading: Any,
) -> FitResult: ...
def fit_material(
    table: _CurveLike,
    wavelength_nm: _Number | None = None,
    floor_per_sr: float | None = None,
    laws: str | Sequence[str] = (),
    cone_deg: _Number | None = None,
    source_deg: _Number | None = None,
    theta_most_deg: _Number = 85.0,
    most_lobes: int = 3,
    name: str = "fitted",
    accept: bool = False,
    progress: _Progress | None = None,
) -> Material: ...
def fold(
    curves: _CurveLike | Sequence[_CurveLike],
    period_s: _Number,
    period_sigma_s: _Number | None = None,
    epoch: _Moment | None = None,
    scene: Scene | _Path | None = None,
    axis: _Place | None = None,
    bins: int = 50,
    channels: Sequence[str] = (),
    station: str | None = None,
    keep: Sequence[str] = (),
    air: Mapping[str, Any] | None = None,
    **reading: Any,
) -> Result: ...
def ndf(
    table: _CurveLike,
    zero_deg: _Number | None = None,
    most_offset_deg: _Number = 5.0,
    median: int | None = None,
    tail: Literal["ggx", "beckmann", "exponential", "linear"] | None = None,
    elevations: int | None = None,
    azimuths: int | None = None,
    resamplings: int = 200,
    diffuse: bool = True,
    seed: int = 0,
) -> Result: ...
def passes(
    elements: _Path | Sequence[_Path],
    start: _Moment,
    station: _Path,
    end: _Moment | None = None,
    norad_id: int | str | Sequence[int | str] = (),
    name: str | Sequence[str] = (),
    min_elevation_deg: _Number = 10.0,
    sun_below_deg: _Number = -6.0,
    min_culmination_deg: _Number = 0.0,
    min_duration_s: _Number = 0.0,
    brighter_than: float | None = None,
    limit: int | None = None,
    diameter_m: _Number = 1.0,
    reflectance: float = 0.2,
    standard_magnitude: float | None = None,
    model: _Path | None = None,
    attitude: _Path = "orbit",
    tolerance: float = 0.01,
    exposure_s: _Number = 0.1,
    zero_point: str = "vega=0.03",
    air: Mapping[str, Any] | None = None,
    progress: _Progress | None = None,
) -> Result: ...
def period(
    curves: _CurveLike | Sequence[_CurveLike],
    channels: Sequence[str] = (),
    shortest_s: _Number | None = None,
    longest_s: _Number | None = None,
    gap_s: _Number | None = None,
    harmonics: int = 1,
    sessions: Literal["auto", "joined", "apart"] = "auto",
    station: str | None = None,
    progress: _Progress | None = None,
    **reading: Any,
) -> Result: ...
def read_photometry(
    path: _Path,
    time_column: str | None = None,
    time_scale: Literal["utc", "tai", "tt", "tdb", "gps"] | None = None,
    magnitude_column: str | None = None,
    sigma_column: str | None = None,
    time_format: Literal["jd", "mjd", "unix", "s", "d", "iso"] | None = None,
    object: str | None = None,
    _keep: Any = None,
) -> Curve: ...
def read_table(path: _Path) -> Table: ...
def reduce(
    frames: _Path | Sequence[_Path],
    place_px: tuple[float, float] | None = None,
    along: int = 1,
    darks: Sequence[_Path] = (),
    flats: Sequence[_Path] = (),
    fwhm_px: float | None = None,
    aperture_px: float | None = None,
    streak_sigma: float | None = None,
    catalogue: _Path | None = None,
    catalogue_mag: str | None = None,
    catalogue_colour: tuple[str, str] | None = None,
    catalogue_system: Literal["Vega", "AB"] | None = None,
    near_deg: _Place | None = None,
    scale_arcsec: _Number | None = None,
    target_colour: tuple[float, float] | None = None,
    colour_term: float | None = None,
    name: str | None = None,
    progress: _Progress | None = None,
    gain_e_per_adu: float | None = None,
) -> Result: ...
def star(
    name: str,
    at: _Moment,
    station: _Path,
    to: _Moment | None = None,
    step_s: _Number = 60.0,
    exposure_s: _Number = 0.1,
    place: _Place | None = None,
    v_mag: float | None = None,
    b_minus_v_mag: float | None = None,
    spectral_type: str | None = None,
    air: Mapping[str, Any] | None = None,
    zero_point: str = "vega=0.03",
) -> Result: ...
def archive(
    folder: _Path,
    object: int | str | None = None,
    channel: str | Sequence[str] = (),
    kind: str | Sequence[str] = (),
    station: str | None = None,
    start: _Moment | None = None,
    end: _Moment | None = None,
    phase_below_deg: _Number | None = None,
    phase_above_deg: _Number | None = None,
    min_samples: int | None = None,
    index: _Path | None = None,
    fresh: bool = False,
    progress: _Progress | None = None,
) -> ArchiveResult: ...
def study(
    study: _Path,
    output: _Path,
    station: str | None = None,
    part: tuple[int, int] | None = None,
    client: Any = None,
    parts: int | None = None,
    progress: _Progress | None = None,
) -> StudyResult: ...
def unmix(
    curve: _CurveLike,
    endmembers: Sequence[_Path],
    scene: Scene | _Path | None = None,
    station: str | None = None,
    no_air: bool = False,
    total_m2_sr: _Number | None = None,
    unweighted: bool = False,
    confusion: bool = False,
    air: Mapping[str, Any] | None = None,
) -> Result: ...
def virtual_night(seed: int = 0, folder: _Path | None = None, progress: _Progress | None = None) -> Night: ...
def plan(
    ndf: Result | _Path,
    theta_i: int = 8,
    phi_i: int = 9,
    quarter: bool = False,
    side: int | None = None,
    normals: int = 128,
    wide: float = 0.25,
    most_theta_i_deg: _Number | None = None,
    rig: bool | Mapping[str, _Number] | None = None,
) -> Result: ...
def assemble(
    samples: Result | _Path,
    ndf: Result | _Path,
    plan: Result | _Path | None = None,
    wavelength_nm: _Number | None = None,
    theta_i: int = 72,
    phi_i: int = 17,
    side: int | None = None,
    normals: int = 128,
    progress: _Progress | None = None,
) -> Assembled: ...
def retro(plan: _Path, folder: _Path, reduce: bool = False, progress: _Progress | None = None) -> Result: ...
def aperture(
    pixels: ArrayLike,
    places_px: ArrayLike,
    radius_px: float = 8.0,
    annulus_px: tuple[float, float] = (12.0, 20.0),
    fwhm_px: float = 4.0,
    exposure_s: _Number = 1.0,
    gain_e_per_adu: float | None = None,
    read_noise_e: float = 0.0,
    saturation_adu: float | None = None,
) -> Table: ...
def track(
    elements: _Path,
    name: str | int,
    at: _Moment,
    station: _Path | None = None,
    mount: str = "virtual",
    dry_run: bool = False,
    min_elevation_deg: _Number = 10.0,
    for_s: _Number | None = None,
    sun_limit_deg: _Number = 30.0,
    latency_s: _Number = 0.25,
    past_meridian_deg: _Number = 0.0,
    slew_deg_s: float | None = None,
    late_s: _Number = 0.0,
    progress: _Progress | None = None,
) -> Result: ...
def devices(
    all: bool = False,
    indi: str | Sequence[str] = (),
    alpaca: str | Sequence[str] = (),
    timeout_s: _Number = 10.0,
) -> Result: ...
def drivers() -> Result: ...
