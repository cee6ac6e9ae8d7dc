"""What the boards are made of: processors, the links and switches between them, the sync line.

It knows nothing of the controller before them.
"""
