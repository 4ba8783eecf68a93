"""A warning about a fit, kept in its model file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gsid.base.json_files import number, text


@dataclass(frozen=True)
class FitWarning:
    """Why the intervals of a fit do not hold the truth.

    Attributes
    ----------
    what : str
        "equation_error_bias", "noisy_input_bias", "chosen_lines_bias" or "excess_cost".
    bias_over_std : float or None
        Largest expected shift of a parameter, or of the response at a fitted line, over its standard
        deviation; None for "excess_cost".
    use : str
        The method that is right here; "reference": the response through the reference (`--r`); for
        "excess_cost" what to try.
    text : str
        The same as a sentence.
    cost_per_dof : float or None
        "excess_cost": the squared errors over those that noise leaves of a right model.
    p_value : float or None
        "excess_cost": probability of errors this large or larger where the model is right.
    """

    what: str
    bias_over_std: float | None
    use: str
    text: str
    cost_per_dof: float | None = None
    p_value: float | None = None

    @property
    def short(self) -> str:
        """The same in a line of a table."""
        if self.bias_over_std is not None:
            return f"biased by {self.bias_over_std:.2g} sigma: use {self.use}"
        return f"cost {self.cost_per_dof:.3g} times that of noise: try {self.use}"

    def to_dict(self) -> dict[str, Any]:
        """The warning as JSON has it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> FitWarning:
        """A warning out of a model file.

        Raises
        ------
        ValueError
            A value is missing or of another kind.
        """
        words = {key: text(data, key) for key in ("what", "use", "text")}
        numbers = {key: number(data, key) for key in ("bias_over_std", "cost_per_dof", "p_value")}
        if numbers["bias_over_std"] is None and numbers["cost_per_dof"] is None:
            raise ValueError(f"the warning {words['what']!r} has neither bias_over_std nor cost_per_dof")
        return cls(**words, **numbers)
