"""Raw lines to a device under test: they send what they are told to, right or wrong, and show all that comes back.

The host's transports do what is right; these must be able to do what is wrong.
"""

from __future__ import annotations
