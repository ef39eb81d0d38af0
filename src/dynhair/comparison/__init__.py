"""Methods and ablations, trained and measured on one capture under the same conditions."""

from dynhair.comparison.run import run_ablation, run_comparison

__all__ = ["run_ablation", "run_comparison"]
