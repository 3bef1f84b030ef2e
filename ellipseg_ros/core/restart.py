"""The restart rule: whether a window can go on with the next sweep."""

from typing import NamedTuple

from ellipseg_ros.core.fields import (
    MAX_FIELDS_BYTES,
    Layout,
    clashing_field,
    joined_layout,
    layout_of,
    too_wide,
)
from ellipseg_ros.records import SECOND, Sweep


class StreamState(NamedTuple):
    """What decides, of the sweeps since the last restart."""

    newest_ns: int  # newest stamp
    frame_id: str
    layout: Layout  # of the fields


class RestartRule:
    """Decides from the stamps, frames and fields of a stream where a window must restart."""

    def __init__(self) -> None:
        self._state: StreamState | None = None

    def reset(self) -> None:
        """Forget the stream: the next sweep restarts nothing by itself."""
        self._state = None

    @property
    def newest_ns(self) -> int:
        """The newest stamp since the last restart; 0 before the first sweep."""
        return self._state.newest_ns if self._state else 0

    def take(self, sweep: Sweep, max_lateness_ns: int) -> str:
        """Take the next sweep; return why the window must restart with it, or an empty text.

        max_lateness_ns: how far a stamp may lie behind the newest.
        """
        state = self._state
        reason = sweep.restart
        if state is not None and not reason:
            reason = _restart_reason(state, sweep, max_lateness_ns)
        self._state = _next_state(None if reason else state, sweep)
        return reason


def _next_state(state: StreamState | None, sweep: Sweep) -> StreamState:
    layout = layout_of(sweep.fields)
    if state is None:
        return StreamState(sweep.stamp_ns, sweep.frame_id, layout)
    newest = max(state.newest_ns, sweep.stamp_ns)
    return StreamState(newest, state.frame_id, joined_layout(state.layout, layout))


def _restart_reason(state: StreamState, sweep: Sweep, max_lateness_ns: int) -> str:
    if sweep.frame_id != state.frame_id:
        return f"the frame changed from {state.frame_id!r} to {sweep.frame_id!r}"
    layout = layout_of(sweep.fields)
    name = clashing_field(state.layout, layout)
    if name:
        return f"the count of field {name!r} changed"
    if too_wide(state.layout, layout):
        return (
            "the fields changed, and with those before they take more than "
            f"{MAX_FIELDS_BYTES} bytes"
        )
    behind = state.newest_ns - sweep.stamp_ns
    if behind > max_lateness_ns:
        return f"the stamps jumped back by {behind / SECOND:.3f} s"
    return ""
