"""A warning about a fit, kept in its model file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gsid.base.json_files import number, text


@dataclass(frozen=True)
class FitWarning:
    """Reason why the confidence intervals of a fit are not valid.

    Attributes
    ----------
    what : str
        "equation_error_bias", "noisy_input_bias", "chosen_lines_bias" or "excess_cost".
    bias_over_std : float or None
        Largest expected bias of a parameter, or of the response at a fitted line, over its standard
        deviation; None for "excess_cost".
    use : str
        Method to use instead; "reference" means the response measured with the reference (`--r`). For
        "excess_cost", what to try.
    text : str
        The warning as a sentence.
    cost_per_dof : float or None
        For "excess_cost", the squared errors over those expected from noise for a correct model.
    p_value : float or None
        For "excess_cost", the probability of errors this large or larger if the model is correct.
    """

    what: str
    bias_over_std: float | None
    use: str
    text: str
    cost_per_dof: float | None = None
    p_value: float | None = None

    @property
    def short(self) -> str:
        """The warning as a short text for tables."""
        if self.bias_over_std is not None:
            return f"biased by {self.bias_over_std:.2g} sigma: use {self.use}"
        return f"cost {self.cost_per_dof:.3g} times that of noise: try {self.use}"

    def to_dict(self) -> dict[str, Any]:
        """Return the warning as a dict for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> FitWarning:
        """Make a warning from an entry of a model file.

        Raises
        ------
        ValueError
            A value is missing or has the wrong type.
        """
        words = {key: text(data, key) for key in ("what", "use", "text")}
        numbers = {key: number(data, key) for key in ("bias_over_std", "cost_per_dof", "p_value")}
        if numbers["bias_over_std"] is None and numbers["cost_per_dof"] is None:
            raise ValueError(f"the warning {words['what']!r} has neither bias_over_std nor cost_per_dof")
        return cls(**words, **numbers)
