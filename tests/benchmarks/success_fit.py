"""How well the forecast of success holds, and the fit of its coefficients.

Flights first (seeds of their own, several grasps of each plan), then the fit:

    python -m tests.benchmarks.physics --tier pile --ranks 0 1 3 --seed0 2000 \\
        --records FILE
    python -m tests.benchmarks.success_fit FILE... [--write data/planning/success.json]

A FILE may also be the folder of ``debrisgrasp campaign --world mujoco``. Without
``--write`` nothing is changed: the table says how often grasps held whose forecast was
so and so, by the coefficients that flew, and by a new fit as it does on scenes that
were left out of it.
"""

from __future__ import annotations

import argparse
import itertools
import json
from datetime import date
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from debrisgrasp._files import write_atomic
from debrisgrasp.campaign import flight_of, load_records, wilson
from debrisgrasp.cli.tables import columns
from debrisgrasp.planning import SUCCESS_TERMS, SuccessModel
from debrisgrasp.planning.success import SCHEMA

from .report import begin, publish

EDGES = (0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
FOLDS = 8
DRAW = 0.3
"""How strongly weights, of terms in standard deviations, are drawn to those that flew,
per flight: a term that hardly varies in the flights keeps what earlier ones taught."""


def read(paths: list[Path]) -> list[dict[str, object]]:
    """Flights that have terms, of files of records and folders of campaigns."""
    rows: list[dict[str, object]] = []
    for path in paths:
        if path.is_dir():
            flights = map(flight_of, load_records(path))
            rows += [flight.as_dict() for flight in flights if flight]
        else:
            rows += map(json.loads, path.open())
    return [row for row in rows if row["terms"]]


def fitted(
    terms: np.ndarray, held: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, float]:
    """Weights, none of them below zero, and intercept of the likeliest model.

    The weights are drawn to those known before.

    Every term is such that more of it can't hurt; what a small sample says to the
    contrary is chance.
    """
    scale = terms.std(axis=0) + 1e-9
    start = known * scale
    sign = np.where(held, 1.0, -1.0)

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        odds = sign * (terms / scale @ x[:-1] + x[-1])
        slope = -sign * expit(-odds) / len(sign)
        off = x[:-1] - start
        value = np.logaddexp(0.0, -odds).mean() + DRAW * (off @ off)
        return value, np.append(
            terms.T / scale[:, None] @ slope + 2 * DRAW * off, slope.sum()
        )

    n = terms.shape[1]
    bounds: list[tuple[float | None, float | None]] = [(0.0, None)] * n + [(None, None)]
    found = minimize(loss, np.append(start, 0.0), jac=True, bounds=bounds).x
    return found[:-1] / scale, float(found[-1])


def left_out(
    terms: np.ndarray, held: np.ndarray, scene: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Forecast of each flight by a fit to the other scenes."""
    found = np.empty(len(held))
    fold = np.random.default_rng(0).permutation(scene.max() + 1)[scene] % FOLDS
    for k in range(FOLDS):
        weights, intercept = fitted(terms[fold != k], held[fold != k], known)
        found[fold == k] = expit(terms[fold == k] @ weights + intercept)
    return found


def reliability(forecast: np.ndarray, held: np.ndarray) -> str:
    """How often grasps held, by what was forecast."""
    rows = []
    for low, high in itertools.pairwise(EDGES):
        is_in = (forecast >= low) & (forecast < high + (high == 1.0))
        n, good = int(is_in.sum()), int(held[is_in].sum())
        if n:
            told = f"{forecast[is_in].mean():.0%}"
            least, most = wilson(good, n)
            share = f"{good / n:.0%}"
            bar = "#" * round(20 * good / n)
            span = f"{least:.0%} to {most:.0%}"
            rows.append([f"{low:.2f} to {high:.2f}", str(n), told, share, span, bar])
    return columns(["forecast", "flights", "mean", "held", "95 %", ""], rows)


def merits(forecast: np.ndarray, held: np.ndarray) -> dict[str, float]:
    """Brier score, log loss, area under the curve, and error of calibration."""
    sure = np.clip(forecast, 1e-6, 1 - 1e-6)
    good, bad = forecast[held], forecast[~held]
    higher = (good[:, None] > bad).mean() + 0.5 * (good[:, None] == bad).mean()
    groups = np.array_split(np.argsort(forecast), 10)
    gaps = [abs(forecast[g].mean() - held[g].mean()) for g in groups if len(g)]
    return {
        "brier": float(np.square(forecast - held).mean()),
        "log_loss": float(-np.log(np.where(held, sure, 1 - sure)).mean()),
        "area_under_curve": float(higher),
        "calibration_error": float(np.mean(gaps)),
    }


def worth(
    terms: np.ndarray, held: np.ndarray, scene: np.ndarray, known: np.ndarray
) -> str:
    """What a new fit is worth on scenes left out of it without each of the terms."""
    rows = []
    for name in ("-", *SUCCESS_TERMS):
        kept = np.array([other != name for other in SUCCESS_TERMS])
        found = merits(left_out(terms * kept, held, scene, known * kept), held)
        keys = ("brier", "log_loss", "area_under_curve")
        rows.append([name, *(f"{found[key]:.3f}" for key in keys)])
    return columns(["without", "Brier", "log loss", "area"], rows)


def main() -> None:
    """Print how well the forecasts hold; fit and write new coefficients if asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("records", type=Path, nargs="+", metavar="FILE")
    parser.add_argument("--write", type=Path, metavar="FILE", help="new coefficients")
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    try:
        rows = read(chosen.records)
    except (OSError, ValueError) as error:  # also of a folder without a campaign
        parser.error(str(error))
    if not rows:
        parser.error("no flight of a grasp is in the records")
    terms = np.array([row["terms"] for row in rows], dtype=float)
    held = np.array([row["outcome"] == "held" for row in rows])
    flown = np.array([row["probability"] for row in rows], dtype=float)
    names = [f"{row['tier']} {row['seed']}" for row in rows]
    scene = np.unique(names, return_inverse=True)[1]
    print(f"{len(rows)} flights in {scene.max() + 1} scenes, {held.mean():.0%} held\n")
    print("by the coefficients that flew\n" + reliability(flown, held) + "\n")
    figures = {f"flown_{k}": v for k, v in merits(flown, held).items()}
    if chosen.write is not None:
        if scene.max() + 1 < FOLDS or len(set(held)) < 2:
            parser.error(f"a fit needs {FOLDS} scenes, some held and some not")
        before = SuccessModel.load()
        refit = left_out(terms, held, scene, before.weights)
        print("by a new fit, on scenes left out of it\n" + reliability(refit, held))
        print("\n" + worth(terms, held, scene, before.weights) + "\n")
        figures |= {f"refit_{k}": v for k, v in merits(refit, held).items()}
        weights, intercept = fitted(terms, held, before.weights)
        # What earlier flights covered is in the weights, too.
        low = np.minimum(before.lower, terms.min(axis=0))
        high = np.maximum(before.upper, terms.max(axis=0))
        seeds = [int(str(row["seed"])) for row in rows]
        tiers = ", ".join(sorted({str(row["tier"]) for row in rows}))
        content = {
            "schema": SCHEMA,
            "date": date.today().isoformat(),
            "campaign": f"{len(rows)} flights in {scene.max() + 1} scenes of {tiers}, "
            f"seeds {min(seeds)} to {max(seeds)}, weights drawn to those of "
            f"{before.date}",
            "held": int(held.sum()),
            "intercept": round(intercept, 2),
            "terms": {
                name: {
                    "weight": float(f"{weights[k]:.3g}"),
                    "least": round(float(low[k]), 4),
                    "greatest": round(float(high[k]), 4),
                }
                for k, name in enumerate(SUCCESS_TERMS)
            },
        }
        write_atomic(chosen.write, json.dumps(content, indent=2) + "\n")
    publish(figures, chosen.json)


if __name__ == "__main__":
    begin(main)
