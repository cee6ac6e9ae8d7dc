"""The live page: what happens on and above the array, in a browser, while it happens, and the controls to change it.

A `Snapshot` is what there is to see at one moment. The playing thread takes a capture; the tap's thread makes a
snapshot of it, the view's thread paints it, and the server's thread sends the newest to each page that is ready.
`Studio` plays what pages ask for; `View` alone shows what a program gives it. This room sends no block itself: it calls
`host`, and reads captures.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
