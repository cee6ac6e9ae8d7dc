from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest
from phasewire import Hand
from phasewire.host.finding.findings import CheckVerdict
from phasewire.host.finding.tracker_checks import TRACKER_CHECKS, Watched, examine_tracker, watch
from phasewire.host.hands import HandFrame, TrackedHand
from phasewire.host.hands.liveness import Stale
from phasewire.host.hands.sources import LiveHands, PlayedHands

from tests.host.hands.clocks import Clock

GOOD = {
    "source": "ok",
    "news": "ok",
    "rate": "ok",
    "drops": "ok",
    "latency": "ok",
    "hands": "ok",
    "size": "ok",
    "place": "ok",
}
GOOD["repairs"] = "ok"


def frames(
    count: int = 100, rate: float = 100, centre: Iterable[float] = (0, 0, 0.2), length: float = 0.19
) -> list[HandFrame]:
    hand = TrackedHand(Hand.flat(tuple(centre), length=length), 3)
    return [HandFrame(1000 + number / rate, (hand,), number) for number in range(count)]


def watched(seen: Iterable[HandFrame], late: float = 0.002) -> Watched:
    every = tuple(seen)
    return Watched(every, tuple(frame.time + late for frame in every), 1.0, live=True)


def verdicts(found: Watched) -> dict[str, str]:
    return {finding.name: finding.verdict.value for finding in examine_tracker(found)}


def judged(found: Watched, name: str) -> tuple[str, str, str]:
    judgement = TRACKER_CHECKS[name](found)
    assert bool(judgement.advice) == (judgement.verdict in (CheckVerdict.WARN, CheckVerdict.FAIL))
    return judgement.verdict.value, judgement.seen, judgement.advice


def test_a_good_tracker_passes_every_check() -> None:
    found = watched(frames())
    assert verdicts(found) == GOOD
    assert judged(found, "rate")[1] == "100 frames/s, 10 ms apart at most"
    assert judged(found, "latency")[1].startswith("2.0 ms median, 2.0 ms for 99 %, 2.0 ms worst")
    assert judged(found, "hands")[1] == "in view in 100% of the frames, 1 at a time, right in 100, 1 id"
    assert judged(found, "place")[1].startswith("palms at (0, 0, 200) mm, 100% of them")


def test_a_tracker_without_frames_gets_advice() -> None:
    nothing = replace(watched([]), idle=3.0, seconds=3.0)
    assert {name for name, verdict in verdicts(nothing).items() if verdict == "fail"} == {"rate"}
    assert judged(nothing, "rate")[1] == "0 frames came in 3.0 s, and none for 3.0 s"
    assert "plug the tracker in" in judged(nothing, "rate")[2]
    assert judged(watched(frames(1)), "rate")[0] == "fail"
    assert judged(replace(watched(frames()), idle=1.1), "rate")[0] == "fail"
    assert judged(replace(watched(frames(1)), live=False), "rate")[1] == "there are too few frames"


@pytest.mark.parametrize(("rate", "verdict"), [(19, "fail"), (30, "warn"), (61, "ok")])
def test_rates(rate: float, verdict: str) -> None:
    assert verdicts(watched(frames(100, rate))) == GOOD | {"rate": verdict}


def test_a_gap_is_found_at_the_end_too() -> None:
    seen = frames()
    late = [replace(frame, time=frame.time + 0.08 * (frame.number > 50)) for frame in seen]
    assert judged(watched(late), "rate")[:2] == (
        "warn",
        "93 frames/s, 90 ms apart at most; touch is silent after 50 ms without one",
    )
    assert judged(replace(watched(seen), idle=0.3), "rate")[0] == "warn"


@pytest.mark.parametrize(("kept", "missing", "verdict"), [(1, 0, "ok"), (2, 99, "fail")])
def test_frames_that_the_tracker_counted_and_that_did_not_come(kept: int, missing: int, verdict: str) -> None:
    found = watched(frames(199, 200)[::kept])
    assert found.missing == missing
    assert judged(found, "drops")[0] == verdict
    played = replace(found, live=False)
    assert judged(played, "drops")[0] == ("ok" if verdict == "ok" else "warn")


def test_a_tracker_that_restarts_its_count_has_lost_no_frame() -> None:
    seen = frames(4)
    jumping = [replace(frame, number=number) for frame, number in zip(seen, (5, 6, 1, 900_000), strict=True)]
    assert watched(jumping).missing == 0


def test_hands_in_the_wrong_unit() -> None:
    note = "hand 4 is left out: its knuckles are 0.066 mm wide; its tracker seems to give metres"
    empty = [replace(frame, hands=(), notes=(note.replace("66", f"{frame.number}"),)) for frame in frames()]
    found = watched(empty)
    assert judged(found, "hands")[1].startswith("no hand could be used; hand 4 is left out")
    assert judged(found, "repairs")[1].endswith("metres (100 × in 100 frames)")
    assert "no accident" in judged(found, "hands")[2] == judged(found, "repairs")[2]


def test_sizes_of_hands() -> None:
    assert judged(watched(frames(length=0.19 * 0.6)), "size")[0] == "warn"
    verdict, seen, advice = judged(watched(frames(length=0.1893 * 1.5)), "size")
    assert (verdict, seen) == ("warn", "palms of 145 mm, 1.50 of the mean hand's")
    assert advice.endswith("correct the scale in a pose file: 0.67")


def test_a_hand_that_is_always_elsewhere_needs_a_pose_file() -> None:
    verdict, seen, advice = judged(watched(frames(centre=(0.03, 0.3, -0.1))), "place")
    assert verdict == "fail"
    assert seen == "palms at (30, 300, -100) mm, 0% of them where they can feel something"
    assert "--pose" in advice
    assert advice.endswith("move it by (-30, -300, 270) mm")
    for centre in ((0, 0, 0.04), (0, 0, -0.2), (0.11, 0.11, 0.2), (0, 0, 0.46)):
        assert judged(watched(frames(centre=centre)), "place")[0] == "fail"
    half = frames(30) + [replace(frame, number=frame.number + 30) for frame in frames(70, centre=(0, 0, 0.6))]
    assert judged(watched(half), "place")[0] == "warn"


def test_notes_about_the_source_come_first() -> None:
    assert judged(replace(watched(frames()), notes=("no tracker is plugged in",)), "source")[:2] == (
        "warn",
        "no tracker is plugged in",
    )


# Watching


class Live(LiveHands):
    def __init__(self, given: list[HandFrame], clock: Clock) -> None:
        super().__init__("live", 100)
        self.given, self.clock = given, clock

    def next_frame(self, timeout: float) -> HandFrame | None:
        if not self.given:
            self.clock.sleep(timeout)
            return super().next_frame(0)
        frame = self.given.pop(0)
        self.clock.now = max(self.clock.now, frame.time + 0.003)
        return frame


def test_a_stalled_tracker_is_watched_no_longer() -> None:
    clock = Clock()
    found = watch(Live(frames(50), clock), 2.0, clock=clock)
    assert found.seconds == pytest.approx(2)
    assert found.longest_gap == pytest.approx(1.5, abs=0.01)
    nothing = watch(Live([], clock), 1.0, clock=clock)
    assert nothing.frames == ()
    assert nothing.idle == pytest.approx(1)


def test_frames_that_are_no_news_are_counted_by_their_reason_and_not_handed_on() -> None:
    clock, got = Clock(), list[HandFrame]()
    seen = frames(60)
    late = [replace(frame, time=seen[39].time) for frame in seen[40:50]]
    found = watch(Live([*seen[:40], *late, *[late[-1]] * 50], clock), 1.0, got.append, clock)
    assert tuple(got) == found.frames == tuple(seen[:40])
    verdict, says, advice = judged(found, "news")
    assert (verdict, says) == (
        "fail",
        "60 of 100 frames were no news: 10 had a new number but the time of the one before, 50 repeated the one before",
    )
    assert "start the tracker's software again" in advice
    assert judged(replace(found, stale={Stale.AGE: 1}), "news")[0] == "warn"
    assert judged(replace(found, live=False), "news")[0] == "skipped"


def test_a_recording_is_read_at_once_up_to_a_time() -> None:
    clock = Clock()
    found = watch(PlayedHands("played", iter(frames(1000)), 100, clock), 2.0, clock=clock)
    assert (len(found.frames), found.live, clock.now) == (201, False, 1000)
    assert found.seconds == pytest.approx(2)
    short = watch(PlayedHands("played", iter(frames(10)), 100, clock), 2.0, clock=clock)
    assert len(short.frames) == 10
