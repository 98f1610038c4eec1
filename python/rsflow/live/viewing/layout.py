"""What the viewer shows at first sight: the picture large, plots below, figures and timing beside it."""

from __future__ import annotations

from typing import Any

from .plots import CLOCK, TIME

__all__ = ["blueprint"]

# Plots follow the last so many seconds of a live source.
_FOLLOWED_S = 30.0


def blueprint(rrb: Any, *, velocity: bool, live: bool, follow: bool) -> Any:
    """Make the layout; `rrb` is ``rerun.blueprint``.

    `velocity`: with a camera and a height. `live`: of a source that is waited for. `follow`: the plots show the last
    while alone.
    """
    ranges: dict[str, Any] = {}
    if follow:
        start = rrb.TimeRangeBoundary.cursor_relative(seconds=-_FOLLOWED_S)
        shown = rrb.VisibleTimeRange(CLOCK, start=start, end=rrb.TimeRangeBoundary.cursor_relative())
        ranges = {"time_ranges": [shown]}

    def plot(origin: str, name: str, *, legend: bool = False) -> Any:
        return rrb.TimeSeriesView(
            origin=origin, name=name, plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend), **ranges
        )

    motion = (
        plot("velocity", "Velocity in m/s", legend=True)
        if velocity
        else plot("displacement", "Displacement in pixels a frame", legend=True)
    )
    left = rrb.Vertical(
        rrb.Spatial2DView(origin="camera", name="What moves, and how fast"),
        rrb.Horizontal(
            motion,
            plot("light/brightness", "Brightness"),
            plot("light/gain", "Gain of light"),
            column_shares=[2, 1, 1],
        ),
        row_shares=[3, 1],
    )
    right = rrb.Vertical(
        rrb.Tabs(
            rrb.TextDocumentView(origin="figures", name="Figures"),
            rrb.TextLogView(origin="notes", name="Notes"),
        ),
        # A file is not waited for, so that it has no delay.
        plot("timing/delay_ms", "Delay in ms") if live else plot("things/count", "Things that move"),
        plot("timing/frame_rate_hz", "Frames a second"),
        row_shares=[4, 1, 1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 1]),
        rrb.TimePanel(
            state="collapsed", timeline=CLOCK if live else TIME, **({"play_state": "following"} if follow else {})
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )
