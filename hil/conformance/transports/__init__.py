"""Raw lines to a device under test: they send anything, valid or not, and show every answer.

The host's transports only do what is right; these must be able to do what is wrong.
"""

from __future__ import annotations
