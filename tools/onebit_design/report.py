"""What onebit-design tells: design.json, and the same for a person on the terminal."""

import math

import numpy as np

from . import conditions, prediction
from .choose import Choice
from .conditions import Figures
from .formats import Formats
from .prediction import Prediction
from .simulate import Ensemble
from .system import System


def plain(value):
    """For JSON: arrays as lists, complex numbers as [real, imaginary], what is not finite null."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def figures_entries(
    system: System, figures: Figures, choices: list[Choice], formats: Formats
) -> dict:
    """The figures of the theorems, under the names of design.json."""
    net, horizon = figures.network, figures.horizon
    return {
        "name": system.name,
        "K1": system.K1,
        "K2": system.K2,
        "P": figures.P,
        "lambda_2": net.lambda_2,
        "lambda_G": net.lambda_G,
        "lambda_QW": net.lambda_QW,
        "lambda_QL": net.lambda_QL,
        "alpha": net.alpha,
        "f_M": figures.f_M,
        "pi": net.pi,
        "pi_min": net.pi_min,
        "beta_consensus": figures.beta_consensus,
        "beta_rate": figures.beta_rate,
        "gamma_min": figures.gamma_min,
        "t0_min": figures.t0_min,
        "d_max": net.d_max,
        "eigenvalues": list(figures.eigenvalues.astype(complex)),
        "horizon": {
            "t": horizon.t,
            "plant_error": conditions.PLANT_ERROR,
            "eigenvalue_error": horizon.eigenvalue_error,
            "sensitivity": {"A": horizon.A, "B": horizon.B},
            "largest_entry": horizon.entry,
            "largest_share": horizon.entry_share,
            "t_with_exact_zeros_and_ones": horizon.exact_t,
        },
        "conditions": [vars(condition) for condition in figures.conditions],
        "chosen": {
            choice.name: {"value": choice.value, "reason": choice.reason} for choice in choices
        },
        "fixed": vars(formats),
    }


def _clock(t: float, period: float) -> str:
    if math.isinf(t):
        return "never"
    seconds = t * period
    for unit, size in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"t = {t:.4g} ({seconds / size:.3g} {unit})"
    return f"t = {t:.4g} ({seconds:.3g} s)"


def _verdict(figures: Figures) -> str:
    failing = [condition.name for condition in figures.conditions if not condition.holds]
    if not failing:
        return "All hold: the theorems promise consensus at the rate 1/t."
    promise = (
        "consensus, but not the rate 1/t"
        if all(name.endswith("for the rate 1/t") for name in failing)
        else "nothing (they are sufficient, not necessary)"
    )
    return f"Not met: {'; '.join(failing)}. The theorems promise {promise}."


def figures_lines(
    system: System, figures: Figures, choices: list[Choice], formats: Formats
) -> list[str]:
    n = len(system.B)
    graphs = f", {len(system.graphs)} graphs" if len(system.graphs) > 1 else ""
    net, horizon = figures.network, figures.horizon
    lines = [
        f"{system.name}: {system.agents} agents of {n} state{'s' if n > 1 else ''}, "
        f"{len(system.links)} directed links{graphs}, a step every {system.period:g} s",
        "",
        "Gains",
        f"  K1 = [{' '.join(f'{value:.6g}' for value in system.K1)}]",
        f"  K2 = [{' '.join(f'{value:.6g}' for value in system.K2)}]",
        f"  beta = {system.beta:g}, gamma = {system.gamma:g}, t0 = {system.t0}, "
        f"c = {system.threshold:g}, M = {system.bound:g}, sigma = {system.sigma:g}",
        *(f"  chose {choice.name} = {choice.value:g}: {choice.reason}" for choice in choices),
        "",
        f"Conditions (lambda_2 = {net.lambda_2:.6g}, lambda_G = {net.lambda_G:.6g}, "
        f"alpha = {net.alpha:.6g}, f_M = {figures.f_M:.6g}, pi_min = {net.pi_min:.4g})",
    ]
    width = max(len(condition.name) for condition in figures.conditions)
    for condition in figures.conditions:
        verdict = "holds" if condition.holds else "FAILS"
        mend = f"; to mend it, {condition.mend}" if condition.mend else ""
        lines.append(f"  {verdict}  {condition.name:<{width}}  {condition.margin}{mend}")
    lines += [
        f"  {_verdict(figures)}",
        "",
        f"Horizon: entries of A and B off by {conditions.PLANT_ERROR:.1%} each, at worst, move the "
        f"eigenvalue 1 by {horizon.eigenvalue_error:.2g};",
        f"  the group then holds together until about {_clock(horizon.t, system.period)}. "
        f"{horizon.entry_share:.0%} of it is {horizon.entry}'s.",
        "  If entries that are 0 or 1 exactly are exact in the machine too: "
        f"{_clock(horizon.exact_t, system.period)}.",
        "",
        f"Fixed point: states {formats.state} fraction bits (worst case "
        f"{formats.state_range:.4g}), control {formats.control} ({formats.control_range:.4g}), "
        f"K1 {formats.stabilizing}, K2/sigma {formats.compression}"
        f"{'' if formats.chosen else '; states and control as the file says'}",
    ]
    return lines


def prediction_lines(predicted: Prediction | None) -> list[str]:
    if predicted is None:
        return ["Prediction: none, its cost grows as the cube of agents and links"]
    return ["Prediction", *(f"  {line}" for line in prediction.report_lines(predicted))]


def _compared(predicted: Prediction | None, ensemble: Ensemble) -> list[dict]:
    """Predicted and simulated disagreement at the rows from which on the prediction holds."""
    if predicted is None:
        return []
    at = dict(zip(predicted.row_steps, predicted.mse, strict=True))
    rows = []
    for row in ensemble.rows:
        step, simulated, error = int(row["step"]), float(row["mse"]), float(row["mse_se"])
        # The ensemble may be shorter; its last row is then not one of the prediction's.
        if predicted.valid_from is not None and step >= predicted.valid_from and step in at:
            expected = float(at[step])
            rows.append(
                {
                    "step": step,
                    "predicted": expected,
                    "simulated": simulated,
                    "standard_error": error,
                    "standard_errors_apart": (simulated - expected) / error if error else 0.0,
                }
            )
    return rows


def simulation_entries(predicted: Prediction | None, ensemble: Ensemble | None) -> dict | None:
    if ensemble is None:
        return None
    return {
        "runs": ensemble.runs,
        "steps": ensemble.steps,
        "warnings": ensemble.warnings,
        "rows": _compared(predicted, ensemble),
    }


def simulation_lines(
    predicted: Prediction | None, ensemble: Ensemble | None, why_not: str
) -> list[str]:
    if ensemble is None:
        return [f"Predicted against simulated: not simulated ({why_not})"]
    lines = [
        "Predicted against simulated disagreement: "
        f"{ensemble.runs} runs of {ensemble.steps:,} steps"
    ]
    last = ensemble.rows[-1]
    lines.append(
        f"  step {int(last['step']):>9,}  disagreement {float(last['mse']):.4g}, mean squared "
        f"distance from the initial average {float(last['average_error']):.4g}"
    )
    rows = _compared(predicted, ensemble)
    if predicted is None:
        lines.append("  not predicted")
    elif not rows:
        lines.append("  the prediction does not hold yet within these steps")
    else:
        # About two rows a decade are enough to read.
        shown = [*rows[:-1:10], rows[-1]]
        lines += [
            f"  step {row['step']:>9,}  predicted {row['predicted']:.4g}  simulated "
            f"{row['simulated']:.4g} +- {row['standard_error']:.2g}  "
            f"({row['standard_errors_apart']:+.1f} standard errors)"
            for row in shown
        ]
        inside = sum(abs(row["standard_errors_apart"]) <= 2 for row in rows)
        lines.append(
            f"  {inside} of {len(rows)} rows from step {rows[0]['step']:,} on are within 2 "
            "standard errors (few runs judge their own error poorly where runs differ much)"
        )
    lines += [f"  onebit-sim says: {line}" for line in ensemble.warnings]
    return lines
