"""The doors for other programs: pyusb in process, USB/IP, usbfs under umockdev, pseudo-terminals and TCP.

Each lets time pass and carries transfers or bytes without knowing their meaning.
"""
