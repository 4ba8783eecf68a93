"""A plant as a stack of physical effects: values, files, and predictions."""

from __future__ import annotations

import copy
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gsid._lib import ffi, version
from gsid.base.arguments import printable_text
from gsid.base.errors import InputError, close
from gsid.base.json_files import listed, number, text
from gsid.base.model_file import FORMAT, read_model_file, write_model_file
from gsid.base.tables import Table, paragraphs
from gsid.effects.custom import entry_keys, of_entry
from gsid.effects.types import EffectParameter, EffectType, find
from gsid.plant.effect import Effect, Param
from gsid.plant.linear_response import LinearView, linear_view
from gsid.plant.periodic import PeriodicPlant, Prediction, input_period
from gsid.plant.units import RADIANS, torque_text
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra

OUTPUTS = ("rate", "angle")


@dataclass(eq=False, repr=False)
class PlantModel:
    """A stack of effects.

    Parameters
    ----------
    fs_hz : float
        Rate at which commands are held and a controller runs [Hz]. A record has its own sample rate.
    effects : list of Effect
        With exactly one rigid_body. Effects act by their stages, and within a stage in this order.
    output : {"rate", "angle"}
        Quantity that y measures.
    angle_unit : {"deg", "rad", "m"}
        Unit of angle. It replaces degrees in the catalogue's units.
    u_unit, y_unit : str
    cov : (n_free, n_free) ndarray or None
        Covariance of the parameters `cov_names`. Use `covariance`, which checks that they are still the free
        ones.
    fit : dict or None
        Summary of the fit; see `gsid.PlantFit.summary`.
    history : list of dict
        Steps by which the stack was built, oldest first.
    cov_names : list of str or None
        Parameters that were free in the fit that gave `cov`; None: those that are free now.
    inertia_kg_m2 : float or None
        Inertia of the axis. The parameters stay divided by it, and are printed as torques too.

    Raises
    ------
    InputError
        An unknown effect; an unknown, missing or impossible value; no rigid body, or two.
    """

    fs_hz: float
    effects: list[Effect]
    output: str = "rate"
    angle_unit: str = "deg"
    u_unit: str = ""
    y_unit: str = ""
    cov: np.ndarray | None = None
    fit: dict[str, Any] | None = None
    history: list[dict[str, Any]] = field(default_factory=list)
    cov_names: list[str] | None = None
    inertia_kg_m2: float | None = None

    def __post_init__(self) -> None:
        self._check("")

    def _check(self, where: str) -> None:
        if not _is_number(self.fs_hz) or not self.fs_hz > 0:
            raise InputError(
                "fs_hz is not a positive number", where, self.fs_hz, "give the rate of the loop [Hz]"
            )
        for name, value, known in (
            ("output", self.output, OUTPUTS),
            ("angle_unit", self.angle_unit, tuple(RADIANS)),
        ):
            if value not in known:
                raise InputError(f"{name} must be one of {', '.join(known)}", where, value)
        for name, value in (("u_unit", self.u_unit), ("y_unit", self.y_unit)):
            printable_text(name, value, where)
        inertia = self.inertia_kg_m2
        if inertia is not None and not (_is_number(inertia) and 0 < inertia < math.inf):
            hint = "give that of the axis in kg m^2, or leave it out"
            raise InputError("inertia_kg_m2 is not a positive number", where, inertia, hint)
        if inertia is not None and self.angle_unit == "m":
            hint = "leave it out: it is for an axis that turns"
            raise InputError("inertia_kg_m2 belongs to an angle", where, self.angle_unit, hint)
        for effect in self.effects:
            _check_params(effect, where)
        n_bodies = sum(effect.id == "rigid_body" for effect in self.effects)
        if n_bodies != 1:
            raise InputError(
                "a plant has exactly one rigid_body",
                where,
                f"{n_bodies} of them",
                "its gain turns commands into torque",
            )

    # ---- parameters ----------------------------------------------------------------------------------

    @property
    def names(self) -> list[str]:
        """All parameters: "effect.parameter"; the second effect of an id is "effect#2"."""
        return [f"{label}.{name}" for label, effect in self.labels() for name in effect.params]

    def labels(self) -> list[tuple[str, Effect]]:
        """The effects with their labels, which precede the point in the names of parameters."""
        seen: dict[str, int] = {}
        labels = []
        for effect in self.effects:
            seen[effect.id] = seen.get(effect.id, 0) + 1
            labels.append((effect.id if seen[effect.id] == 1 else f"{effect.id}#{seen[effect.id]}", effect))
        return labels

    @property
    def free_names(self) -> list[str]:
        """Parameters that a fit may change."""
        return [name for name in self.names if self[name].free]

    @property
    def covariance(self) -> np.ndarray | None:
        """Covariance of the free parameters, (n_free, n_free), in the order of `free_names`.

        None if there is none, or if other parameters were free in the fit that gave it.
        """
        names = self.free_names
        is_current = self.cov is not None and self.cov.shape == (len(names), len(names))
        return self.cov if is_current and self.cov_names in (None, names) else None

    def __getitem__(self, name: str) -> Param:
        """A parameter by "effect.parameter"."""
        effect, parameter = self._find(name)
        return effect.params[parameter]

    def parameter(self, name: str) -> EffectParameter:
        """The catalogue's entry of a parameter."""
        effect, parameter = self._find(name)
        return effect.type[parameter]

    def _find(self, name: str) -> tuple[Effect, str]:
        label, _, parameter = name.rpartition(".")
        for other, effect in self.labels():
            if other == label and parameter in effect.params:
                return effect, parameter
        hint = close(name, self.names) or f"there are {', '.join(self.names)}"
        raise InputError("the model has no such parameter", "", name, hint)

    @property
    def free_values(self) -> np.ndarray:
        """(n_free,) values of the free parameters."""
        return np.array([self[name].value for name in self.free_names])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(n_free,) least and largest values of the free parameters, their null values included."""
        lower, upper = [], []
        for effect in self.effects:
            for name, param in effect.params.items():
                if param.free:
                    known = effect.type[name]
                    null = [known.null_value] if known.null_value is not None else []
                    least, most = min([known.lower, *null]), max([known.upper, *null])
                    lo, hi = param.limits or (least, most)
                    lower.append(max(lo, least))
                    upper.append(min(hi, most))
        return np.array(lower), np.array(upper)

    def with_values(self, values: Sequence[float]) -> PlantModel:
        """A copy with other values of the free parameters, without covariance and fit summary.

        Parameters
        ----------
        values : (n_free,) array_like
        """
        model = copy.deepcopy(self)
        model.cov, model.cov_names, model.fit = None, None, None
        for name, value in zip(self.free_names, values, strict=True):
            model[name].value, model[name].std = float(value), None
        return model

    def stack(self) -> dict[str, dict[str, float]]:
        """{effect: {parameter: value}}."""
        return {
            label: {name: p.value for name, p in effect.params.items()} for label, effect in self.labels()
        }

    @property
    def has_controller(self) -> bool:
        """Whether the loop is simulated closed: the record's input is then the reference."""
        return any(effect.type.stage == "controller" for effect in self.effects)

    @property
    def looks_at_angle(self) -> bool:
        """Whether any effect depends on the angle of the axis. If none does, the mean angle is arbitrary."""
        return any(effect.type.c.looks_at_angle for effect in self.effects)

    # ---- other stacks --------------------------------------------------------------------------------

    def with_effect(
        self,
        effect: str | EffectType,
        params: Mapping[str, float],
        limits: Mapping[str, tuple[float, float]] | None = None,
        fixed: Sequence[str] = (),
    ) -> PlantModel:
        """A copy with one more effect, its values clipped to the bounds, without covariance and fit summary.

        Parameters
        ----------
        effect : str or EffectType
            Id of the catalogue, or a user-defined effect.
        params : mapping of float
            Values; the default of each is its typical value.
        limits : mapping of (lo, hi), optional
            Limits of a fit that are narrower than the catalogue's bounds.
        fixed : sequence of str
            Parameters that a fit does not change.
        """
        larger = copy.deepcopy(self)
        larger.cov, larger.cov_names, larger.fit = None, None, None
        added = {}
        custom = effect if isinstance(effect, EffectType) else None
        known = custom or find(effect)
        for parameter in known.parameters:
            limit = (limits or {}).get(parameter.name)
            lower, upper = limit or (parameter.lower, parameter.upper)
            value = float(np.clip(params.get(parameter.name, parameter.typical), lower, upper))
            added[parameter.name] = Param(value, parameter.name not in fixed, limits=limit)
        larger.effects.append(Effect(known.id, added, custom))
        return larger

    def without_effect(self, effect: str) -> PlantModel:
        """A copy without the effects of an id, without covariance and fit summary."""
        smaller = copy.deepcopy(self)
        smaller.cov, smaller.cov_names, smaller.fit = None, None, None
        smaller.effects = [each for each in smaller.effects if each.id != effect]
        return smaller

    # ---- prediction ----------------------------------------------------------------------------------

    def simulate(self, u: np.ndarray) -> Prediction:
        """Periodic steady-state response to a command that is held over each sample.

        Parameters
        ----------
        u : (N,) array_like
            One period of the command, or of the reference when the stack has a controller.

        Raises
        ------
        GsidError
            The values cannot be simulated.
        """
        return PeriodicPlant(self, u, self.fs_hz).run()

    def predict(self, measured: Record | Spectra, *, sensitivities: bool = False) -> Prediction:
        """Periodic steady-state response to a record's mean input.

        Parameters
        ----------
        measured : Record or Spectra
            A record is split into periods with the defaults of `gsid.frf`. Hold "zoh": its input is the
            command, held over each sample. Hold "none": its input is a signal without lines above half the
            sample rate.
        sensitivities : bool
            Whether to compute dY.

        Raises
        ------
        GsidError
            The values cannot be simulated.
        InputError
            The loop's rate is not the record's; a record that `gsid.spectra` refuses.
        TypeError
            Neither a record nor its spectra.
        ValueError
            Several records.
        """
        several = spectra_of(measured)
        if len(several) != 1:
            raise ValueError(f"predict takes one record at a time, got {len(several)}")
        return PeriodicPlant.of(self, several[0]).run(sensitivities=sensitivities)

    def drive_command(self, measured: Spectra, answer: Prediction) -> np.ndarray:
        """Command to the drive at each sample of a period; in closed loop the controller's output.

        Parameters
        ----------
        measured : Spectra
            Its mean input is the command, or the loop's reference.
        answer : Prediction
            The model's response to it.

        Returns
        -------
        (N,) float64
        """
        command = input_period(measured, 1)
        for effect in self.effects:
            if effect.type.c.control != ffi.NULL:
                command = _controlled(effect, command, answer, measured.fs_hz)
        return command

    def linear_response(
        self,
        measured: Spectra,
        use: np.ndarray | None = None,
        *,
        stack: Mapping[str, Mapping[str, float]] | None = None,
    ) -> LinearView:
        """Responses of the linear part at the lines of a record, with its sample rate and hold.

        Parameters
        ----------
        measured : Spectra
        use : (K,) bool, optional
            Mask of the lines to evaluate; default all.
        stack : mapping, optional
            Values instead of the model's, in the form that `stack` returns.

        Returns
        -------
        LinearView
        """
        return linear_view(
            self.stack() if stack is None else stack,
            measured.f_hz if use is None else measured.f_hz[use],
            measured.fs_hz,
            output_angle=self.output == "angle",
            radians_per_unit=RADIANS[self.angle_unit],
            held=measured.hold == "zoh" or self.has_controller,
        )

    # ---- files ---------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The model as the JSON of a model file."""

        def plain(param: Param) -> dict[str, Any]:
            std = {} if param.std is None else {"std": param.std if math.isfinite(param.std) else None}
            ends = [end if math.isfinite(end) else None for end in param.limits or ()]
            return {"value": param.value, "free": param.free} | std | ({"limits": ends} if ends else {})

        data: dict[str, Any] = {
            "gsid_model": FORMAT,
            "made_by": f"gsid {version()}",
            "fs_hz": self.fs_hz,
            "output": self.output,
            "angle_unit": self.angle_unit,
            "u_unit": self.u_unit,
            "y_unit": self.y_unit,
            "effects": [
                {"effect": effect.id, **effect.type.definition}
                | {"params": {name: plain(param) for name, param in effect.params.items()}}
                for effect in self.effects
            ],
        }
        if self.inertia_kg_m2 is not None:
            data["inertia_kg_m2"] = self.inertia_kg_m2
        if (cov := self.covariance) is not None:
            data["covariance"] = {"names": self.free_names, "matrix": cov.tolist()}
        if self.fit is not None:
            data["fit"] = self.fit
        if self.history:
            data["history"] = self.history
        return data

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "") -> PlantModel:
        """Make a model from the JSON of a model file.

        Parameters
        ----------
        data : dict
            As :meth:`to_dict` returns it. A parameter may be a plain number. It is then free, except for a
            controller, whose parameters are known. `limits` of a parameter are [least, greatest] and bound
            it in a fit; null leaves that end open.
        where : str
            File name, for messages.

        Raises
        ------
        InputError
            Something is missing or has the wrong form.
        """
        if not isinstance(data, dict) or data.get("gsid_model") != FORMAT:
            raise InputError(
                "not a model file", where, None, f'a model file is JSON with "gsid_model": {FORMAT}'
            )
        entries = data.get("effects")
        if not isinstance(entries, list):
            raise InputError("the model file has no list of effects", where, ", ".join(data), EXAMPLE)
        _check_keys(data, KEYS, where)
        if len(entries) > EFFECTS_MOST:
            most = f"{len(entries)}, at most {EFFECTS_MOST}"
            raise InputError("the model file has too many effects", where, most, "join those of one kind")
        model = cls.__new__(cls)
        model.fs_hz, model.effects = (
            data.get("fs_hz"),
            [_read_effect(entry, i, where) for i, entry in enumerate(entries)],
        )
        model.output, model.angle_unit = data.get("output", "rate"), data.get("angle_unit", "deg")
        model.u_unit, model.y_unit = data.get("u_unit", ""), data.get("y_unit", "")
        model.inertia_kg_m2 = data.get("inertia_kg_m2")
        model.fit, model.history = _read_story(data, where)
        model.cov, model.cov_names = None, None
        model._check(where)
        if "covariance" in data:
            model.cov_names = model.free_names
            model.cov = _read_covariance(data["covariance"], model.cov_names, where)
        return model

    def save(self, path: str | Path) -> None:
        """Write a model file (.json). An existing file is replaced atomically."""
        write_model_file(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> PlantModel:
        """Read a model file.

        Raises
        ------
        InputError
            The file cannot be read, is not JSON, or is not a stack of effects.
        """
        return cls.from_dict(read_model_file(path), str(path))

    # ---- print ---------------------------------------------------------------------------------------

    def _table(self) -> Table:
        title = f"PlantModel at {self.fs_hz:g} Hz, y is the {self.output} ({len(self.effects)} effects)"
        rows = []
        for effect in self.effects:
            for i, (name, param) in enumerate(effect.params.items()):
                row = (effect.id if i == 0 else "", name, str(param), self.unit_of(effect, name))
                rows.append((*row, *self.torques_of(effect, name)))
        return Table(("effect", "parameter", "value", "unit", *self.torque_head), rows, title=title)

    @property
    def torque_head(self) -> tuple[str, ...]:
        """Title of a column with torques; empty: the inertia is not known."""
        return () if self.inertia_kg_m2 is None else (f"with {self.inertia_kg_m2:.5g} kg m^2",)

    def torques_of(self, effect: Effect, name: str) -> tuple[str, ...]:
        """Cell of that column: the parameter as a torque; empty: the inertia is not known."""
        if self.inertia_kg_m2 is None:
            return ()
        value = effect.params[name].value
        how = self.inertia_kg_m2, self.angle_unit, self.u_unit
        return ("" if effect.type.definition else torque_text(effect.id, name, value, *how),)

    def unit_of(self, effect: Effect, name: str) -> str:
        """Unit of a parameter in this model's unit of angle."""
        unit = effect.type[name].unit
        return unit if " (" in unit else unit.replace("deg", self.angle_unit)  # "deg (whatever ...)" is one

    def __repr__(self) -> str:
        table = self._table()
        lines = [table.title]
        lines += [
            f"  {effect:22}{name:18}{value:28}{'  '.join(rest)}".rstrip()
            for effect, name, value, *rest in table.rows
        ]
        if self.fit is not None:
            lines.append(f"  cost per degree of freedom {self.fit.get('cost_per_dof', math.nan):.4g}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        cost = (self.fit or {}).get("cost_per_dof")
        text = "" if cost is None else f"Fitted; cost per degree of freedom {cost:.4g}."
        return self._table().html() + paragraphs(text)


def check_plant(model: object) -> None:
    """Raise TypeError unless the model is a stack of effects."""
    if not isinstance(model, PlantModel):
        raise TypeError(f"a stack of effects is needed, a PlantModel, got {type(model).__name__}")


def transport_delay_s(model: PlantModel) -> float | None:
    """Transport delay of a stack of effects [s]; None where it has none."""
    delays = [effect.params["delay_s"].value for effect in model.effects if effect.id == "transport_delay"]
    return sum(delays) if delays else None


# A model file has no other keys: a misspelt key must not be ignored.
KEYS = (
    *("gsid_model", "made_by", "fs_hz", "output", "angle_unit", "u_unit", "y_unit"),
    *("inertia_kg_m2", "effects", "covariance", "fit", "history"),
)
EFFECTS_MOST = 100  # the whole catalogue four times over
PARAM_KEYS = ("value", "free", "std", "limits")

EXAMPLE = 'write "effects": [{"effect": "rigid_body", "params": {"gain": 7.4}}, ...]'


def _is_number(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= sys.float_info.max  # whole numbers may be larger than any double


def _check_keys(entry: Mapping[str, Any], known: Sequence[str], where: str) -> None:
    for key in entry:
        if key not in known:
            hint = close(key, known) or f"there are {', '.join(known)}"
            raise InputError("unknown key in a model file", where, key, hint)


def _read_effect(entry: Any, index: int, where: str) -> Effect:
    where = f"{where} effects[{index}]".strip()
    if not isinstance(entry, dict) or not isinstance(entry.get("effect"), str):
        raise InputError("an effect is not an object with its id", where, entry, EXAMPLE)
    _check_keys(entry, entry_keys(entry["effect"]), where)
    params = entry.get("params", {})
    if not isinstance(params, dict):
        raise InputError("params is not an object of numbers", f"{where} {entry['effect']}", params, EXAMPLE)
    custom = of_entry(entry, where)
    known = custom or find(entry["effect"], where)
    free = known.stage != "controller"
    return Effect(
        entry["effect"],
        {name: _read_param(value, free, f"{where} {known.id}.{name}") for name, value in params.items()},
        custom,
    )


def _read_story(data: dict[str, Any], where: str) -> tuple[dict[str, Any] | None, list[dict[str, Any]]]:
    """Summary of the fit, and the steps by which the model was built."""
    fit, history = data.get("fit"), data.get("history", [])
    if not (fit is None or isinstance(fit, dict)):
        raise InputError("fit is not an object", where, fit, "leave it out")
    try:
        for key in ("cost", "cost_per_dof", "n_dof", "variance_dof"):
            number(fit or {}, key)
        text(fit or {}, "method")
        per_record = listed(fit or {}, "per_record")
        if not all(isinstance(record, dict) for record in per_record):
            raise ValueError("per_record is not a list of objects")
    except ValueError as error:
        raise InputError("fit is not usable", where, error, "leave it out") from error
    if not isinstance(history, list) or not all(isinstance(step, dict) for step in history):
        raise InputError("history is not a list of steps", where, history, "leave it out")
    return fit, history


def _read_covariance(covariance: Any, free_names: list[str], where: str) -> np.ndarray:
    try:
        matrix = np.array(covariance["matrix"], dtype=float)
        if covariance["names"] == free_names and matrix.shape == (len(free_names),) * 2:
            return matrix
    except (KeyError, TypeError, ValueError):
        pass
    hint = "leave the covariance out when parameters are added, made free or fixed by hand"
    raise InputError("the covariance is not that of the free parameters", where, ", ".join(free_names), hint)


def _read_param(value: Any, free: bool, where: str) -> Param:
    std = limits = None
    if isinstance(value, Mapping):
        _check_keys(value, PARAM_KEYS, where)
        if "std" in value:
            std = math.nan if value["std"] is None else value["std"]
        limits = _read_limits(value.get("limits"), where)
        value, free = value.get("value"), value.get("free", free)
    if (
        not _is_number(value)
        or not isinstance(free, bool)
        or not (std is None or isinstance(std, int | float))
    ):
        raise InputError(
            "a parameter is not a number", where, value, 'write 7.4 or {"value": 7.4, "free": true}'
        )
    if limits and free and not limits[0] <= value <= limits[1]:
        raise InputError("a value is outside its own limits", where, f"{value:g}", f"they are {limits}")
    return Param(float(value), free, std, limits)


def _read_limits(limits: Any, where: str) -> tuple[float, float] | None:
    if limits is None:
        return None
    if (
        isinstance(limits, list)
        and len(limits) == 2
        and all(end is None or _is_number(end) for end in limits)
    ):
        lo, hi = (
            float(open_end if end is None else end)
            for end, open_end in zip(limits, (-math.inf, math.inf), strict=True)
        )
        if lo < hi:
            return lo, hi
    hint = 'write "limits": [least, greatest]; null leaves an end to the catalogue'
    raise InputError("the limits of a parameter are not two rising numbers", where, limits, hint)


def _check_params(effect: Effect, where: str) -> None:
    known = effect.own or find(effect.id, where)
    where = f"{where} {effect.id}".strip()
    for name in effect.params:
        if name not in known.names:
            hint = close(name, known.names) or f"it has {', '.join(known.names) or 'none'}"
            raise InputError("unknown parameter", f"{where}.{name}", None, hint)
    for parameter in known.parameters:
        # A controller is complete without a parameter that may vanish.
        if known.stage == "controller" and parameter.null_value is not None:
            effect.params.setdefault(parameter.name, Param(parameter.null_value, free=False))
        if parameter.name not in effect.params:
            hint = f"a gimbal has {parameter.typical:g} {parameter.unit}".rstrip()
            raise InputError("a parameter is missing", f"{where}.{parameter.name}", None, hint)
        value = effect.params[parameter.name].value
        if value != parameter.null_value and not parameter.lower <= value <= parameter.upper:
            hint = f"it lies in {parameter.lower:g} .. {parameter.upper:g} {parameter.unit}".rstrip()
            raise InputError("a value is out of its bounds", f"{where}.{parameter.name}", f"{value:g}", hint)
    effect.params = {name: effect.params[name] for name in known.names}


def _controlled(effect: Effect, reference: np.ndarray, answer: Prediction, fs_hz: float) -> np.ndarray:
    item = ffi.new("gsid_plant_item *", {"effect": effect.type.c, "data": effect.type.data})
    for i, param in enumerate(effect.params.values()):
        item.value[i] = param.value
    law, samples = effect.type.c.control, effect.type.c.rate_samples
    n = samples(item) if samples != ffi.NULL else 0
    rate = (answer.angle - np.roll(answer.angle, n)) * fs_hz / n if n else answer.rate
    slopes = ffi.new("gsid_real[]", 3), ffi.new("gsid_real[]", len(item.value))
    signals = np.column_stack([reference, answer.angle, rate]).tolist()
    return np.array([law(item, signal, *slopes) for signal in signals])
