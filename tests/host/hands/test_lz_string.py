from __future__ import annotations

import base64

import lzstring
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from phasewire.host.hands.lz_string import END, MARKS, decompress

from tests.host.hands.leap_service import outcome

PLENTY = 10**6
TEXTS = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]))


def packed(text: str) -> str:
    result: str = lzstring.LZString().compressToBase64(text)
    return result


@given(TEXTS | st.text("ab", max_size=500) | st.text('0123456789.,[]" ', max_size=2000))
@example("")
@example("a")
@example("é" * 3 + "中" * 5)
def test_it_unpacks_what_lz_string_packs(text: str) -> None:
    assert decompress(packed(text), PLENTY) == text
    assert decompress(packed(text).rstrip("=") + "\n", PLENTY) == text


@given(TEXTS.filter(bool), st.data())
def test_what_is_cut_off_is_refused(text: str, data: st.DataObject) -> None:
    digits = packed(text).rstrip("=")
    cut = digits[: data.draw(st.integers(0, len(digits) - 1))]
    found = outcome(lambda: decompress(cut, PLENTY))
    assert found == text or "cut off" in str(found)  # the last digits may hold nothing


@pytest.mark.parametrize("digits", ["N4!g", "{}", "é", "N4Ig=Zg", "N4Ig ZgTg"])
def test_what_is_no_base64_is_refused(digits: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        decompress(digits, PLENTY)


def bits(*codes: tuple[int, int]) -> str:
    """Base64 of codes and how many bits each has."""
    stream = "".join(f"{code:0{count}b}"[::-1] for code, count in codes)
    stream += "0" * (-len(stream) % 24)
    return base64.b64encode(int(stream, 2).to_bytes(len(stream) // 8)).decode()


def bomb(codes: int) -> str:
    """A text of as, each code one longer than the one before it."""
    longer = [(known, known.bit_length()) for known in range(MARKS + 1, MARKS + 1 + codes)]
    return bits((0, 2), (ord("a"), 8), *longer, (END, (MARKS + 1 + codes).bit_length()))


def test_little_that_unpacks_to_much() -> None:
    assert decompress(bomb(3), PLENTY) == "a" * 10
    assert decompress(bomb(3), 10) == "a" * 10
    with pytest.raises(ValueError, match="it unpacks to more than 9 characters"):
        decompress(bomb(3), 9)
    assert len(bomb(20_000)) < 60_000
    with pytest.raises(ValueError, match="it unpacks to more than 1000000 characters"):
        decompress(bomb(20_000), PLENTY)  # two hundred million


def test_a_code_that_is_not_known_yet_is_refused() -> None:
    with pytest.raises(ValueError, match="it is damaged: code 3 stands where 3 strings are known"):
        decompress(bits((3, 2)), PLENTY)
    with pytest.raises(ValueError, match="it is damaged: code 7 stands where 4 strings are known"):
        decompress(bits((0, 2), (97, 8), (7, 3)), PLENTY)
