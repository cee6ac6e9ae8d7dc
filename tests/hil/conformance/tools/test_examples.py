import pytest
from phasewire.hil.conformance.tools.examples import example

from tests.specification import hex_examples


def test_every_example_is_read() -> None:
    assert {name: example(name) for name in hex_examples()} == hex_examples()


def test_an_example_is_the_bytes_of_the_text() -> None:
    assert example("USB_QUALIFIER") == b"\x0a\x06\x01\x02\xef\x02\x01\x40\x01\x00"
    assert len(example("USB_MS_OS")) == 338


def test_what_is_no_example_is_named() -> None:
    with pytest.raises(ValueError, match=r"no example 'USB_NOTHING'; it has PULSES"):
        example("USB_NOTHING")
