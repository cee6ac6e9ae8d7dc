"""LZ-string, the compression in which leapjs-playback writes recordings: LZ78 whose codes grow, in base64.

A code is either a string that was seen before or one of three marks; each code but the first adds a string, the one
before it and the first character of its own. A code has as many bits as the number of strings so far needs, the least
significant bit first. See `decompress`.
"""

from __future__ import annotations

import base64

__all__ = ["decompress"]

END = 2
"""The mark of the end. Marks 0 and 1 announce a new character of 8 or 16 bits."""
MARKS = 3
WINDOW_BYTES = 5
"""Hold any code, wherever in a byte it begins."""
_TURNED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def decompress(packed: str, most: int) -> str:
    """The text that ``LZString.compressToBase64`` packed.

    Parameters
    ----------
    packed : str
        Base64; some versions of LZ-string pad it with more or fewer signs than others.
    most : int
        How many characters the text may have; not many more are unpacked.

    Raises
    ------
    ValueError
        If it is no base64, is damaged or cut off, or holds more.
    """
    digits = packed.strip().rstrip("=")
    # Base64 has the first bit first in each byte; integers have it last, and so have codes.
    data = base64.b64decode(digits + "A" * (-len(digits) % 4), validate=True).translate(_TURNED)
    at, end = 0, 6 * len(digits)

    def take(bits: int) -> int:
        nonlocal at
        first = at >> 3
        value = int.from_bytes(data[first : first + WINDOW_BYTES], "little") >> (at & 7)
        at += bits
        if at > end:
            raise ValueError("it is cut off: the mark of its end is missing")
        return value & ((1 << bits) - 1)

    strings = [""] * MARKS
    last, size = "", 0
    text = []
    while (code := take(len(strings).bit_length())) != END:
        if code < END:
            string = chr(take(8 << code))
            strings.append(string)
        elif code < len(strings):
            string = strings[code]
        elif code == len(strings) and last:
            string = last + last[0]
        else:
            raise ValueError(f"it is damaged: code {code} stands where {len(strings)} strings are known")
        text.append(string)
        size += len(string)
        if size > most:
            raise ValueError(f"it unpacks to more than {most} characters")
        if last:
            strings.append(last + string[0])
        last = string
    return "".join(text)
