"""The figures of the studies by name, and what stands below each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..io.pages import picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAPTIONS = {
    "fig03": "Fig. 3. Time-varying positions of the AGV",
    "fig04": "Fig. 4. Heading of the AGV (the paper: steering angle)",
    "fig05": "Fig. 5. Path following tracking errors of the AGV",
    "fig06": "Fig. 6. Heading tracking errors of the AGV",
    "fig07": "Fig. 7. Path tracking graph of the AGV",
    "fig08": "Fig. 8. Control inputs of the AGV position, before the deadzone, proposed law",
    "fig09": "Fig. 9. Control input of the AGV orientation angle, before the deadzone, proposed law",
    "fig10": "Fig. 10. Adapted squared weight norm, position",
    "fig11": "Fig. 11. Adapted squared weight norm, heading",
    "fig12": "Fig. 12. Time-varying positions of the AGV under DFC and FTSMC",
    "fig13": "Fig. 13. Heading of the AGV under DFC and FTSMC",
    "fig14": "Fig. 14. Path following tracking errors under DFC and FTSMC",
    "fig15": "Fig. 15. Heading tracking errors under DFC and FTSMC",
    "fig16": "Fig. 16. Path tracking graph under DFC and FTSMC",
    "b1": "Where the network starts to matter: RMSE and largest network gain against b1 = b2",
    "bandwidth": "RMSE against closed-loop bandwidth, every law at matched gains",
    "readings": "All readings of R1, R5, R8, R9, each against the default",
    "lyapunov": "Lyapunov functions (34), (58) against their printed bounds (49), (71), and errors against bounds",
    "vacuity": "Ultimate bound over observed error on sampled scenarios; beyond 10 a bound is vacuous",
    "event": "Event-triggered law: commands held, and the intervals between updates",
    "fractional": "Order of the integral: RMSE of the fractional law against the paper's",
    "comparison": "Every law tuned by the same tuner to the same command budget, on unseen scenarios",
    "remedies": "Remedies against the deadzone, tuned to one command budget; lines reach to the largest error",
}


def caption(name: str, figure: Figure, command: str) -> Figure:
    """The figure with its caption and the command that makes it."""
    figure.supxlabel(f"{CAPTIONS[name]}. Made by: {command}", fontsize=7, color="0.25", x=0.01, ha="left")
    return figure


def image(name: str) -> str:
    """A figure with its caption."""
    return picture(f"{name}.png", f"{CAPTIONS[name]}.")
