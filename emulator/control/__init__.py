"""The controller: it judges blocks, plans changes, sends them along the chain and watches over the processors.

It knows no USB and no serial line; who brings blocks is a `door.Door`.
"""
