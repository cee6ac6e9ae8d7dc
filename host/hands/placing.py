"""Hands of a source where they are: in the array's coordinates, with numbers that stay."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import Self

from .following import Follower
from .frames import HandFrame
from .pose import Pose
from .sources import HandSource

__all__ = ["PlacedHands"]


class PlacedHands:
    """The frames of another source, after its pose is applied and its hands are followed; a `HandSource` itself.

    Parameters
    ----------
    source : HandSource
        The source, which is closed with this one.
    pose : Pose, optional
        The pose that leads from its coordinates to the array's; by default they are the same.
    """

    def __init__(self, source: HandSource, pose: Pose | None = None) -> None:
        self._source, self._pose, self._follower = source, pose, Follower()

    @property
    def name(self) -> str:
        """That of the source."""
        return self._source.name

    @property
    def notes(self) -> tuple[str, ...]:
        """Those of the source."""
        return self._source.notes

    @property
    def rate(self) -> float:
        """Frames per second that can be expected."""
        return self._source.rate

    @property
    def live(self) -> bool:
        """Whether frames come by themselves."""
        return self._source.live

    @property
    def ended(self) -> bool:
        """Whether no further frame will come."""
        return self._source.ended

    def next_frame(self, timeout: float) -> HandFrame | None:
        """The newest frame; see `HandSource`."""
        frame = self._source.next_frame(timeout)
        return None if frame is None else self._placed(frame)

    def __iter__(self) -> Iterator[HandFrame]:
        return self

    def __next__(self) -> HandFrame:
        return self._placed(next(self._source))

    def _placed(self, frame: HandFrame) -> HandFrame:
        return self._follower.follow(frame if self._pose is None else self._pose.apply(frame))

    def close(self) -> None:
        """Stop the source."""
        self._source.close()

    def __enter__(self) -> Self:
        self._source.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._source.__exit__(kind, error, traceback)
