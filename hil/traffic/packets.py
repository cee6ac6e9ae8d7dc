"""Captures in pcap and pcapng files, packet by packet, so that their size does not matter.

dpkt defines the records of the files. Its readers are not used: they give every packet the link type of the first
interface, hide the byte order, which usbmon's header shares, and trust every length. (python-pcapng, the alternative,
knows interfaces, but decodes every option and fails on valid ones, takes six times as long, and does not read classic
pcap.)
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

import dpkt
from dpkt import pcap, pcapng

from ...base.errors import InputFileError

__all__ = ["MAGICS", "Packet", "packets"]

LARGEST_PACKET_BYTES = 2**25
"""A longer packet has a corrupt length: a URB carries at most some 16 MiB."""


class Packet(NamedTuple):
    """A packet, with its file's metadata."""

    number: int  # from 1, as Wireshark counts
    link: int
    order: str  # of bytes, "<" or ">"
    data: bytes


class _Source:
    """A stream that returns only complete parts, and refuses a corrupt length."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def take(self, size: int) -> bytes:
        """Exactly so many bytes."""
        if data := self.take_or_end(size):
            return data
        raise ValueError("the file ends within it")

    def take_or_end(self, size: int) -> bytes:
        """Exactly so many bytes, or none at the end."""
        if not 0 < size <= LARGEST_PACKET_BYTES:
            raise ValueError(f"a length of {size} bytes is corrupt")
        data = self._stream.read(size)
        if 0 < len(data) < size:
            raise ValueError("the file ends within it")
        return data


_SECTION = struct.pack("<I", pcapng.PCAPNG_BT_SHB)  # reads the same both ways
_SECTION_ORDERS = {struct.pack(order + "I", pcapng.BYTE_ORDER_MAGIC): order for order in "<>"}
_INTERFACE, _PACKET, _OLD_PACKET = pcapng.PCAPNG_BT_IDB, pcapng.PCAPNG_BT_EPB, pcapng.PCAPNG_BT_PB
_BLOCKS = {
    ("<", _INTERFACE): pcapng.InterfaceDescriptionBlockLE,
    (">", _INTERFACE): pcapng.InterfaceDescriptionBlock,
    ("<", _PACKET): pcapng.EnhancedPacketBlockLE,
    (">", _PACKET): pcapng.EnhancedPacketBlock,
    ("<", _OLD_PACKET): pcapng.PacketBlockLE,
    (">", _OLD_PACKET): pcapng.PacketBlock,
}
_RECORDS = {struct.pack(">I", magic): record for magic, record in pcap.MAGIC_TO_PKT_HDR.items()}

MAGICS = (_SECTION, *_RECORDS)
"""The first bytes of the files that `packets` reads."""


def packets(stream: BinaryIO, name: str) -> Iterator[Packet]:
    """Every packet of a capture, with its number, link type and byte order.

    Raises `InputFileError` if the file is corrupt; packets before that are given.
    """
    source, number = _Source(stream), 1
    try:
        magic = source.take(4)
        for link, order, data in (_pcapng_packets if magic == _SECTION else _pcap_packets)(magic, source):
            yield Packet(number, link, order, data)
            number += 1
    except (dpkt.Error, ValueError, struct.error) as error:
        raise InputFileError(f"{name}, packet {number}: {str(error) or 'it is corrupt'}") from error


def _pcap_packets(magic: bytes, source: _Source) -> Iterator[tuple[int, str, bytes]]:
    if magic not in _RECORDS:
        raise ValueError(f"{magic.hex()} begins neither a pcap nor a pcapng file")
    order = ">" if magic[0] == 0xA1 else "<"
    head_type = pcap.FileHdr if order == ">" else pcap.LEFileHdr
    link = head_type(magic + source.take(head_type.__hdr_len__ - len(magic))).linktype
    while head := source.take_or_end(_RECORDS[magic].__hdr_len__):
        yield link, order, source.take(_RECORDS[magic](head).caplen)


def _pcapng_packets(magic: bytes, source: _Source) -> Iterator[tuple[int, str, bytes]]:
    order, interfaces = "<", list[int]()
    head = magic + source.take(4)
    while head:
        if head.startswith(_SECTION):
            head += source.take(4)
            if head[8:] not in _SECTION_ORDERS:
                raise ValueError(f"{head[8:].hex()} is no byte-order magic of a section")
            order, interfaces = _SECTION_ORDERS[head[8:]], []
        kind, size = struct.unpack_from(order + "II", head)
        if size % 4:
            raise ValueError(f"a block's length of {size} bytes is corrupt")
        data = head + source.take(size - len(head))
        if (order, kind) in _BLOCKS:
            block = _BLOCKS[order, kind](data)
            if kind == _INTERFACE:
                interfaces.append(block.linktype)
            elif block.iface_id >= len(interfaces) or block.caplen > size - block.__hdr_len__:
                raise ValueError(f"it claims {block.caplen} bytes of interface {block.iface_id}, which does not exist")
            else:
                yield interfaces[block.iface_id], order, block.pkt_data
        head = source.take_or_end(8)
