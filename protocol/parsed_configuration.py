"""A device's configuration in pyusb's form (SPEC.md, chapter USB), for backends whose bus is not the computer's own."""

from __future__ import annotations

from array import array
from types import SimpleNamespace

from ..base.errors import ReplyError
from .codes import DescriptorType
from .descriptors import Configuration, Descriptor, Endpoint, Interface

__all__ = ["ParsedConfiguration", "parsed"]

_KINDS: dict[int, type[Descriptor]] = {
    DescriptorType.CONFIGURATION: Configuration,
    DescriptorType.INTERFACE: Interface,
    DescriptorType.ENDPOINT: Endpoint,
}


def parsed(descriptor: Descriptor) -> SimpleNamespace:
    """A descriptor in pyusb's form: an object with the fields of the standard, without any others after it."""
    size, kind = descriptor.encode()[:2]
    return SimpleNamespace(bLength=size, bDescriptorType=kind, **vars(descriptor), extra_descriptors=array("B"))


class ParsedConfiguration:
    """A configuration in pyusb's form: interfaces and endpoints, each with the bytes of the other descriptors after it.

    Parameters
    ----------
    data : bytes
        The chain, as the device gives it.

    Raises
    ------
    ReplyError
        If it does not begin with a configuration, or one of the three kinds breaks its layout.
    """

    def __init__(self, data: bytes) -> None:
        self._tree: list[SimpleNamespace] = []
        at = 0
        while at < len(data):
            piece = data[at : at + max(data[at], 2)]
            if kind := _KINDS.get(int.from_bytes(piece[1:2], "little")):
                self._tree.append(parsed(kind.decode(piece)))
            elif self._tree:
                self._tree[-1].extra_descriptors.extend(piece)
            at += len(piece)
        if not self._tree or self._tree[0].bDescriptorType != DescriptorType.CONFIGURATION:
            raise ReplyError(f"{data[:32].hex()}… does not begin with a configuration")

    @property
    def head(self) -> SimpleNamespace:
        """The configuration itself."""
        return self._tree[0]

    def settings(self, interface: int) -> list[SimpleNamespace]:
        """The settings of an interface."""
        return [
            each
            for each in self._tree
            if each.bDescriptorType == DescriptorType.INTERFACE and each.bInterfaceNumber == interface
        ]

    def endpoint(self, interface: int, setting: int, index: int) -> SimpleNamespace:
        """An endpoint of an interface's setting, by its place in it; raises `IndexError` if there is none."""
        found = self._tree[self._tree.index(self.settings(interface)[setting]) + 1 + index]
        if found.bDescriptorType != DescriptorType.ENDPOINT:
            raise IndexError(f"interface {interface} has no endpoint {index}")
        return SimpleNamespace(**vars(found), bRefresh=0, bSynchAddress=0)
