import pytest
from phasewire.hil.conformance.tools.examples import example

from tests.specification import hex_examples


def test_every_example_is_read() -> None:
    assert {name: example(name) for name in hex_examples()} == hex_examples()


def test_what_is_no_example_is_named() -> None:
    with pytest.raises(ValueError, match=r"no example 'USB_NOTHING'; it has PULSES"):
        example("USB_NOTHING")
