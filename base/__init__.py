"""What every room uses and no room owns: errors, units, files, pictures, compiled code, and the bus of libusb."""
