"""What is in the file of a firmware image (SPEC.md, chapter FWU)."""

from __future__ import annotations

from ...base.errors import ImageError
from ..codes import ImageReason
from ..firmware import parse
from .description import Description, Violation, few

__all__ = ["describe_image"]


def describe_image(file: bytes) -> Description:
    """Describe the file of a firmware image (chapter FWU). Who signed it is not judged."""
    try:
        image = parse(file)
    except ImageError as error:
        reason = ImageReason(error.reason)
        finding = Violation(reason.name, reason.clause, str(error))
        return Description("firmware image", few(file), {}, (finding,))
    segments = [{"target": target.name, "bytes": len(data)} for target, data in image.segments]
    signed = "not signed" if image.signature is None else f"signed with key {image.signature.key_id.hex()}"
    return Description(
        "firmware image",
        f"version {image.version} for {image.hardware.name}, {len(segments)} segments, {signed}",
        {
            "version": str(image.version),
            "hardware": image.hardware.name,
            "protocol": image.protocol,
            "segments": segments,
            "key_id": None if image.signature is None else image.signature.key_id.hex(),
        },
    )
